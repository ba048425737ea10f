# SPDX-License-Identifier: BSD-3-Clause
"""A cache of compiled kernels that knows all that a kernel was compiled from.

numba's own cache compares the file of the kernel alone. Constants and kernels of other files are compiled in too: with
one of them changed, by an update in place, a kernel from the cache computes something else, and no error says so.
"""

import hashlib
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba.core.caching import FunctionCache

_PACKAGE = __name__.partition(".")[0]


class KernelCache(FunctionCache):
    """numba's cache of one kernel, whose index is void when anything that was compiled in has changed."""

    _is_stamped = False

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """As numba's."""
        self._stamp()
        return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]

    def save_overload(self, sig: Any, data: Any) -> None:
        """As numba's."""
        self._stamp()
        super().save_overload(sig, data)  # type: ignore[no-untyped-call]

    def _stamp(self) -> None:
        """Add the digest to the stamp of the file; only now, as the module of the kernel is complete."""
        if not self._is_stamped:
            self._cache_file._source_stamp = (self._cache_file._source_stamp, digest_of(self._py_func))
            self._is_stamped = True


def digest_of(kernel: FunctionType) -> str:
    """A digest of a kernel's code, of the constants in it, and of the kernels that it calls."""
    digest, seen, waiting = hashlib.sha256(), {kernel}, [kernel]
    while waiting:
        function = waiting.pop()
        names: list[str] = []
        _add_code(digest, function.__code__, names)
        for name, value in _values_of(names, function.__globals__):
            called = getattr(value, "py_func", None)
            if called is None:
                digest.update(f"{name}={_constant(value)}".encode())
            elif called not in seen:
                seen.add(called)
                waiting.append(called)
    return digest.hexdigest()


def _add_code(digest: Any, code: CodeType, names: list[str]) -> None:
    digest.update(code.co_code)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            _add_code(digest, constant, names)
        else:
            digest.update(repr(constant).encode())
    names.extend(code.co_names)


def _values_of(names: list[str], namespace: dict[str, Any]) -> list[tuple[str, Any]]:
    """The values of names in a module, and, of this package's modules among them, in those modules."""
    found = [(name, namespace[name]) for name in names if name in namespace]
    modules = [value for _, value in found if isinstance(value, ModuleType) and value.__name__.startswith(_PACKAGE)]
    return found + [(name, vars(module)[name]) for module in modules for name in names if name in vars(module)]


def _constant(value: Any) -> str:
    """A constant as text; of anything else that does not change a kernel, its kind alone."""
    match value:
        case bool() | int() | float() | str() | tuple():
            return repr(value)
        case np.ndarray():
            return f"{value.dtype}{value.shape}{value.tobytes().hex()}"
        case type():
            return f"{value.__name__}{getattr(value, '_fields', ())}"
        case _:
            return type(value).__name__

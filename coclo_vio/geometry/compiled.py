# SPDX-License-Identifier: BSD-3-Clause
"""Compilation of numerical kernels by numba, where numba is there: once, then from a cache beside the source.

A kernel works on plain arrays and has a readable NumPy form elsewhere, which tests compare it with. Where numba cannot
be imported, or the environment variable ``COCLO_VIO_NUMBA`` is 0, ``IS_COMPILED`` is False and callers take that form.
Kernels index element by element: slices that are assigned and array expressions double the time of compilation.
"""

import logging
import os
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from typing import Any, TypeVar, cast

_njit: Any = None
_event: Any = None
_new_cache: Any = None
if os.environ.get("COCLO_VIO_NUMBA") != "0":
    with suppress(ImportError):
        _njit, _event = import_module("numba").njit, import_module("numba.core.event")
        _new_cache = import_module("coclo_vio.geometry.kernel_cache").KernelCache

IS_COMPILED = _njit is not None

_LOG = logging.getLogger(__name__)
_Kernel = TypeVar("_Kernel", bound=Callable[..., object])


def compiled(kernel: _Kernel) -> _Kernel:
    """The kernel, compiled at its first call or loaded from the cache; unchanged without numba."""
    return _compiled(kernel, releases_gil=False)


def compiled_without_gil(kernel: _Kernel) -> _Kernel:
    """As ``compiled``, but other Python threads run meanwhile: for kernels of a tenth of a millisecond and more."""
    return _compiled(kernel, releases_gil=True)


def _compiled(kernel: _Kernel, *, releases_gil: bool) -> _Kernel:
    if not IS_COMPILED:
        return kernel
    dispatcher = _njit(error_model="numpy", nogil=releases_gil, no_cfunc_wrapper=True)(kernel)
    with suppress(RuntimeError):  # there is no folder to which the cache could be written
        dispatcher._cache = _new_cache(kernel)
    return cast(_Kernel, dispatcher)


def inlined(kernel: _Kernel) -> _Kernel:
    """A part of one kernel, compiled with it: in half the time of one compiled by itself."""
    return cast(_Kernel, _njit(inline="always", error_model="numpy")(kernel)) if IS_COMPILED else kernel


if IS_COMPILED:

    class _Announcement(_event.Listener):  # type: ignore[misc]
        """One line in the log before the first kernel of this package is compiled; none where all are cached."""

        def on_start(self, event: Any) -> None:
            package = __name__.partition(".")[0]
            if event.data["dispatcher"].py_func.__module__.partition(".")[0] == package:
                _event.unregister("numba:compile", self)
                _LOG.warning("compiling the kernels of %s, once: this takes 20 to 50 s", package)

        def on_end(self, event: Any) -> None:
            pass

    _event.register("numba:compile", _Announcement())

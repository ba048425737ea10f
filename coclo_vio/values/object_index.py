# SPDX-License-Identifier: BSD-3-Clause
"""Everything that a fresh estimator is made of, numbered in an order that is the same in every process."""

import enum
import types
from collections import deque
from collections.abc import Iterator
from functools import partial
from itertools import count
from typing import Any

import numpy as np

from coclo_vio.values.object_fields import fields_of

ATOMS = (bool, int, float, complex, str, bytes, type(None), enum.Enum, np.generic, types.ModuleType, type, count, slice)
"""What has no parts, or none that change."""
_CONTAINERS = (list, tuple, set, frozenset, deque)


class ObjectIndex:
    """The objects below a root, each once.

    A checkpoint refers by number to those that it cannot or need not hold: they are the same in another process whose
    estimator was made of the same configuration.

    Attributes:
        objects: in order; held, so that no later object gets the address of one of them.
    """

    def __init__(self, root: object) -> None:
        self.objects: list[Any] = []
        self._numbers: dict[int, int] = {}
        waiting = [root]
        while waiting:
            thing = waiting.pop()
            if isinstance(thing, ATOMS) or id(thing) in self._numbers:
                continue
            self._numbers[id(thing)] = len(self.objects)
            self.objects.append(thing)
            waiting.extend(parts_of(thing))

    def number(self, thing: object) -> int | None:
        """The number of an object; None where it was made later."""
        return self._numbers.get(id(thing))

    @property
    def classes(self) -> dict[str, type]:
        """The classes of the objects, by ``module:name``."""
        kinds = {type(thing) for thing in self.objects} | {thing for thing in self.objects if isinstance(thing, type)}
        return {f"{kind.__module__}:{kind.__qualname__}": kind for kind in kinds}

    def signature(self) -> list[str]:
        """The classes of all objects in order: what two fresh estimators of one configuration have in common."""
        return [f"{type(thing).__module__}:{type(thing).__qualname__}" for thing in self.objects]


def parts_of(thing: object) -> Iterator[object]:
    """What an object holds: elements, keys and values, fields, what a function has captured."""
    if isinstance(thing, _CONTAINERS):
        yield from thing
    elif isinstance(thing, dict):
        for key, value in thing.items():
            yield from (key, value)
        if hasattr(thing, "__dict__"):
            yield from vars(thing).values()
    elif isinstance(thing, partial):
        yield from (thing.func, thing.args, thing.keywords)
    elif isinstance(thing, types.MethodType):
        yield thing.__self__
    elif isinstance(thing, types.FunctionType):
        yield from cells_of(thing).values()
    elif has_fields(thing):
        yield from fields_of(thing).values()


def cells_of(function: types.FunctionType) -> dict[str, Any]:
    """What a function has captured, by name."""
    held = {}
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        try:
            held[name] = cell.cell_contents
        except ValueError:  # not set yet
            continue
    return held


def has_fields(thing: object) -> bool:
    """Whether an object is of a class written in Python, whose state is its fields; arrays and libraries' are not."""
    kind = type(thing)
    return kind.__module__ != "builtins" and not _is_foreign(kind) and not isinstance(thing, np.ndarray)


def _is_foreign(kind: type) -> bool:
    root = kind.__module__.partition(".")[0]
    return root in _FOREIGN


_FOREIGN = frozenset(
    {
        "gtsam",
        "pinocchio",
        "cv2",
        "numpy",
        "numba",
        "threading",
        "_thread",
        "queue",
        "concurrent",
        "logging",
        "functools",
    }
    | {"collections", "itertools", "weakref", "_queue", "_weakref", "llvmlite", "ctypes", "_ctypes", "multiprocessing"}
)

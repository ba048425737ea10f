# SPDX-License-Identifier: BSD-3-Clause
"""The state of any object as JSON and arrays, exact and without pickle; ``tree_reader`` reads it.

A tree is walked by fields: every object once, so that what two parts share they share again. Objects that were there
when the root was fresh are referred to by their number (``object_index``) where they cannot change or cannot be
written, such as a library's model; the others are filled in place, so that whoever holds them holds the right one.

A class whose fields are not its state says so by two methods, ``checkpoint_fields`` and ``restore_fields``.
"""

import enum
import types
from array import array
from collections import Counter, deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from pydantic import BaseModel

from coclo_vio.values.array_store import ArrayWriter
from coclo_vio.values.arrays import Array
from coclo_vio.values.object_fields import CheckpointUnsupported, fields_of, name_of
from coclo_vio.values.object_index import ObjectIndex, cells_of, has_fields

_PLAIN = (bool, int, float, str, type(None))


@runtime_checkable
class Checkpointed(Protocol):
    """An object whose state is not just its fields."""

    def checkpoint_fields(self) -> dict[str, Any]:
        """What has to be kept."""

    def restore_fields(self, fields: dict[str, Any]) -> None:
        """Take what was kept."""


class Foreign(Protocol):
    """Writes and reads the objects of a library."""

    def changes(self, thing: Any) -> bool:
        """Whether an object is of a class that changes once it is made."""

    def write(self, thing: Any) -> str | None:
        """An object as text; None where that is not possible."""

    def read(self, kind: str, text: str) -> Any:
        """The object of a class of the library."""


class TreeWriter:
    """Writes objects below a root."""

    def __init__(self, index: ObjectIndex, foreign: Mapping[str, Foreign]) -> None:
        """Begin.

        Args:
            index: of the root when it was fresh.
            foreign: for the objects of libraries, by the library's name.
        """
        self.table: list[Any] = []
        self.arrays = ArrayWriter()
        self.classes: dict[str, list[str]] = {}
        self._index, self._foreign = index, foreign
        self._numbers: dict[int, int] = {}
        self._kept: list[object] = []

    def node(self, thing: Any) -> Any:
        """An object as plain values.

        Raises:
            CheckpointUnsupported: it cannot be kept.
        """
        kind = type(thing)
        if kind in _PLAIN:
            return thing
        number = self._numbers.get(id(thing))
        if number is not None:
            return ["r", number]
        leaf = self._leaf(thing, kind)
        if leaf is not None:
            return leaf
        number = self._numbers[id(thing)] = len(self.table)
        self._kept.append(thing)
        self.table.append(None)
        self.table[number] = self._entry(thing, kind)
        return ["r", number]

    def _leaf(self, thing: Any, kind: type) -> list[Any] | None:
        """What has no parts and no identity; None for everything else."""
        simple = _SIMPLE.get(kind)
        leaf: list[Any] | None = None
        if simple is not None:
            leaf = simple(thing)
        elif isinstance(thing, enum.Enum):
            leaf = ["enum", name_of(kind), thing.name]
        elif isinstance(thing, np.generic):
            leaf = ["scalar", thing.dtype.str, thing.tobytes().hex()]
        elif isinstance(thing, type) or (isinstance(thing, types.FunctionType) and self._index.number(thing) is None):
            leaf = ["class", name_of(thing)]
        return leaf

    def _entry(self, thing: Any, kind: type) -> list[Any]:
        """What the table has of an object."""
        fresh = self._index.number(thing)
        write = _CONTAINERS.get(kind)
        if write is not None:
            entry = [kind.__name__, *write(self, thing)]
        elif kind is np.ndarray:
            entry = self._array(thing, fresh)
        elif fresh is not None and isinstance(thing, BaseModel):
            entry = ["fresh", fresh]
        elif isinstance(thing, types.FunctionType):
            entry = ["function", fresh, self.fields(cells_of(thing))]
        elif isinstance(thing, BaseModel):
            entry = ["model", name_of(kind), self.fields(thing.__dict__)]
        elif isinstance(thing, tuple):
            entry = ["named", name_of(kind), *_elements(self, thing)]
        elif isinstance(thing, BaseException):
            entry = ["error", name_of(kind), [self.node(each) for each in thing.args]]
        elif isinstance(thing, (list, dict, set, frozenset, deque, array, *_PLAIN)):
            raise CheckpointUnsupported(f"{kind.__qualname__} is a container of a class of its own")
        elif not has_fields(thing):
            entry = self._foreign_entry(thing, kind, fresh)
        else:
            special = isinstance(thing, Checkpointed)
            fields = thing.checkpoint_fields() if special else fields_of(thing)
            self.classes[name_of(kind)] = sorted(fields)
            entry = ["object", fresh, name_of(kind), special, self.fields(fields)]
        return entry

    def _array(self, thing: Array, fresh: int | None) -> list[Any]:
        if fresh is not None and not thing.flags.writeable and thing.base is None:
            return ["fresh", fresh]
        if thing.dtype.hasobject:
            raise CheckpointUnsupported("an array of objects")
        return ["ndarray", *self.arrays.write(thing)]

    def fields(self, values: Mapping[str, Any]) -> list[Any]:
        """Names and nodes."""
        found = []
        for name, value in values.items():
            try:
                found.append([name, self.node(value)])
            except CheckpointUnsupported as error:
                raise type(error)(f"{name}: {error}") from error
        return found

    def _foreign_entry(self, thing: Any, kind: type, fresh: int | None) -> Any:
        library = kind.__module__.partition(".")[0]
        foreign = self._foreign.get(library)
        if fresh is not None and (foreign is None or not foreign.changes(thing)):
            return ["fresh", fresh]
        text = None if foreign is None else foreign.write(thing)
        if text is not None:
            return ["foreign", library, f"{kind.__module__}:{kind.__qualname__}", text]
        raise CheckpointUnsupported(f"{kind.__module__}.{kind.__qualname__} cannot be kept")


def _future(writer: TreeWriter, future: "Future[Any]") -> list[Any]:
    """A result that is due later; it is waited for."""
    error = future.exception()
    return [True, writer.node(error)] if error is not None else [False, writer.node(future.result())]


def _pairs(writer: TreeWriter, mapping: Mapping[Any, Any]) -> list[Any]:
    return [[[writer.node(key), writer.node(value)] for key, value in mapping.items()]]


def _elements(writer: TreeWriter, elements: Any) -> list[Any]:
    return [[writer.node(element) for element in elements]]


_SIMPLE: dict[type, Callable[[Any], Any]] = {
    bytes: lambda thing: ["bytes", thing.hex()],
    complex: lambda thing: ["complex", thing.real, thing.imag],
    slice: lambda thing: ["slice", thing.start, thing.stop, thing.step],
    count: lambda thing: ["count", int(repr(thing)[len("count(") : -1])],
}
_CONTAINERS: dict[type, Callable[[TreeWriter, Any], list[Any]]] = {
    list: _elements,
    tuple: _elements,
    set: _elements,
    frozenset: _elements,
    dict: _pairs,
    Counter: _pairs,
    deque: lambda writer, thing: [thing.maxlen, *_elements(writer, thing)],
    array: lambda writer, thing: [thing.typecode, thing.tobytes().hex()],
    partial: lambda writer, thing: [writer.node(each) for each in (thing.func, thing.args, thing.keywords)],
    types.MethodType: lambda writer, thing: [writer.node(thing.__self__), thing.__name__],
    Future: _future,
    type(Path()): lambda writer, thing: [str(thing)],
    types.MappingProxyType: lambda writer, thing: [writer.node(dict(thing))],
}

# SPDX-License-Identifier: BSD-3-Clause
"""The state of any object as JSON and arrays, and back: exact, without pickle.

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

from coclo_vio.values.array_store import ArrayReader, ArrayWriter
from coclo_vio.values.object_fields import CheckpointUnsupported, fields_of, name_of, named, set_fields
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
        simple = _SIMPLE.get(kind)
        if simple is not None:
            return simple(thing)
        if isinstance(thing, enum.Enum):
            return ["enum", name_of(kind), thing.name]
        if isinstance(thing, np.generic):
            return ["scalar", thing.dtype.str, thing.tobytes().hex()]
        if isinstance(thing, type):
            return ["class", name_of(thing)]
        if isinstance(thing, types.FunctionType) and self._index.number(thing) is None:
            return ["class", name_of(thing)]
        number = self._numbers[id(thing)] = len(self.table)
        self._kept.append(thing)
        self.table.append(None)
        self.table[number] = self._entry(thing, kind)
        return ["r", number]

    def _entry(self, thing: Any, kind: type) -> Any:
        fresh = self._index.number(thing)
        write = _CONTAINERS.get(kind)
        if write is not None:
            return [kind.__name__, *write(self, thing)]
        if kind is np.ndarray:
            if fresh is not None and not thing.flags.writeable and thing.base is None:
                return ["fresh", fresh]
            if thing.dtype.hasobject:
                raise CheckpointUnsupported("an array of objects")
            return ["ndarray", *self.arrays.write(thing)]
        if fresh is not None and isinstance(thing, BaseModel):
            return ["fresh", fresh]
        if isinstance(thing, types.FunctionType):
            return ["function", fresh, self.fields(cells_of(thing))]
        if isinstance(thing, BaseModel):
            return ["model", name_of(kind), self.fields(thing.__dict__)]
        if isinstance(thing, tuple):
            return ["named", name_of(kind), *_elements(self, thing)]
        if isinstance(thing, BaseException):
            return ["error", name_of(kind), [self.node(each) for each in thing.args]]
        if isinstance(thing, (list, dict, set, frozenset, deque, array, *_PLAIN)):
            raise CheckpointUnsupported(f"{name_of(kind)} is a container of a class of its own")
        if not has_fields(thing):
            return self._foreign_entry(thing, kind, fresh)
        special = isinstance(thing, Checkpointed)
        fields = thing.checkpoint_fields() if special else fields_of(thing)
        self.classes[name_of(kind)] = sorted(fields)
        return ["object", fresh, name_of(kind), special, self.fields(fields)]

    def fields(self, values: Mapping[str, Any]) -> list[Any]:
        """Names and nodes."""
        found = []
        for name, value in values.items():
            try:
                found.append([name, self.node(value)])
            except CheckpointUnsupported as error:
                raise CheckpointUnsupported(f"{name}: {error}") from error
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


class TreeReader:
    """Reads what a ``TreeWriter`` wrote, into a fresh root."""

    def __init__(
        self, table: list[Any], arrays: ArrayReader, index: ObjectIndex, foreign: Mapping[str, Foreign]
    ) -> None:
        """Begin.

        Args:
            table: of the writer.
            arrays: of the writer.
            index: of the root, fresh.
            foreign: for the objects of libraries, by the library's name.
        """
        self._table, self._arrays, self._fresh, self._foreign = table, arrays, index.objects, foreign
        self._known = index.classes
        self._made: dict[int, Any] = {}

    def value(self, node: Any) -> Any:
        """The object of a node.

        Raises:
            DatasetError: it names a class that this version does not have.
        """
        if not isinstance(node, list):
            return node
        tag, *rest = node
        if tag != "r":
            return self._simple(tag, rest)
        number = rest[0]
        if number not in self._made:
            tag, *rest = self._table[number]
            made = self._entry(number, tag, rest)
            self._made[number] = made
        return self._made[number]

    def _simple(self, tag: str, rest: list[Any]) -> Any:
        match tag:
            case "bytes":
                return bytes.fromhex(rest[0])
            case "complex":
                return complex(*rest)
            case "slice":
                return slice(*rest)
            case "count":
                return count(rest[0])
            case "enum":
                return named(rest[0], self._known)[rest[1]]
            case "scalar":
                return np.frombuffer(bytes.fromhex(rest[1]), np.dtype(rest[0]))[0]
            case _:
                return named(rest[0], self._known)

    def _entry(self, number: int, tag: str, rest: list[Any]) -> Any:
        read = _READERS.get(tag)
        if read is not None:
            return read(self, rest)
        if tag in ("list", "dict", "Counter", "set", "deque"):
            return self._filled(number, tag, rest)
        if tag == "function":
            function = self._fresh[rest[0]]
            self._made[number] = function
            values = dict(rest[1])
            for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
                if name in values:
                    cell.cell_contents = self.value(values[name])
            return function
        fresh, name, special, fields = rest
        thing = self._fresh[fresh] if fresh is not None else object.__new__(named(name, self._known))
        self._made[number] = thing
        values = {key: self.value(node) for key, node in fields}
        if special:
            thing.restore_fields(values)
        else:
            set_fields(thing, values)
        return thing

    def _filled(self, number: int, tag: str, rest: list[Any]) -> Any:
        """A container that may hold itself."""
        made: Any = deque(maxlen=rest[0]) if tag == "deque" else _EMPTY[tag]()
        self._made[number] = made
        if tag in ("dict", "Counter"):
            for key, value in rest[0]:
                made[self.value(key)] = self.value(value)
        else:
            add = made.add if tag == "set" else made.append
            for node in rest[-1]:
                add(self.value(node))
        return made

    def values(self, nodes: list[Any]) -> list[Any]:
        """The objects of nodes."""
        return [self.value(node) for node in nodes]

    def fresh(self, number: int) -> Any:
        """An object of the fresh root."""
        return self._fresh[number]

    def array(self, place: list[Any]) -> Any:
        """An array."""
        return self._arrays.read(place)

    def of_class(self, name: str) -> Any:
        """A class of this package."""
        return named(name, self._known)

    def of_library(self, library: str, kind: str, text: str) -> Any:
        """An object of a library."""
        return self._foreign[library].read(kind, text)


def _read_future(reader: TreeReader, rest: list[Any]) -> "Future[Any]":
    future: Future[Any] = Future()
    if rest[0]:
        future.set_exception(reader.value(rest[1]))
    else:
        future.set_result(reader.value(rest[1]))
    return future


def _read_array(reader: TreeReader, rest: list[Any]) -> "array[Any]":
    made: array[Any] = array(rest[0])
    made.frombytes(bytes.fromhex(rest[1]))
    return made


def _read_partial(reader: TreeReader, rest: list[Any]) -> "partial[Any]":
    function, arguments, keywords = reader.values(rest)
    return partial(function, *arguments, **keywords)


def _read_model(reader: TreeReader, rest: list[Any]) -> Any:
    return reader.of_class(rest[0]).model_construct(**{name: reader.value(node) for name, node in rest[1]})


_EMPTY: dict[str, Callable[[], Any]] = {"list": list, "dict": dict, "Counter": Counter, "set": set}
_READERS: dict[str, Callable[[TreeReader, list[Any]], Any]] = {
    "fresh": lambda reader, rest: reader.fresh(rest[0]),
    "ndarray": lambda reader, rest: reader.array(rest),
    "tuple": lambda reader, rest: tuple(reader.values(rest[0])),
    "named": lambda reader, rest: tuple.__new__(reader.of_class(rest[0]), reader.values(rest[1])),
    "frozenset": lambda reader, rest: frozenset(reader.values(rest[0])),
    "array": _read_array,
    "partial": _read_partial,
    "method": lambda reader, rest: getattr(reader.value(rest[0]), rest[1]),
    "Future": _read_future,
    type(Path()).__name__: lambda reader, rest: Path(rest[0]),
    "mappingproxy": lambda reader, rest: types.MappingProxyType(reader.value(rest[0])),
    "model": _read_model,
    "error": lambda reader, rest: reader.of_class(rest[0])(*reader.values(rest[1])),
    "foreign": lambda reader, rest: reader.of_library(*rest),
}

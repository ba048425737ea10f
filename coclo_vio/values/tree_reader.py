# SPDX-License-Identifier: BSD-3-Clause
"""Reads what ``tree_writer`` wrote, into an object that is fresh."""

import types
from array import array
from collections import Counter, deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from coclo_vio.values.array_store import ArrayReader
from coclo_vio.values.object_fields import named, set_fields
from coclo_vio.values.object_index import ObjectIndex
from coclo_vio.values.tree_writer import Foreign


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
        read = _LEAVES.get(tag)
        return named(rest[0], self._known) if read is None else read(self, rest)

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


_LEAVES: dict[str, Callable[[TreeReader, list[Any]], Any]] = {
    "bytes": lambda _, rest: bytes.fromhex(rest[0]),
    "complex": lambda _, rest: complex(*rest),
    "slice": lambda _, rest: slice(*rest),
    "count": lambda _, rest: count(rest[0]),
    "enum": lambda reader, rest: reader.of_class(rest[0])[rest[1]],
    "scalar": lambda _, rest: np.frombuffer(bytes.fromhex(rest[1]), np.dtype(rest[0]))[0],
}
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

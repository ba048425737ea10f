# SPDX-License-Identifier: BSD-3-Clause
"""A bag file, ROS 1 or ROS 2, sound or cut off: its topics, and its messages as a stream of bytes.

Errors of ``rosbags``, of its compressions and of its databases become a ``DatasetError`` here.
"""

from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import ExitStack
from functools import lru_cache
from pathlib import Path

from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from coclo_vio.datasets.rosbag.storage import files
from coclo_vio.datasets.rosbag.storage.message_set import BagTopic, MessageSet, RawMessage
from coclo_vio.datasets.rosbag.storage.storage import Storage
from coclo_vio.values.errors import DatasetError, shortened

_IDL_RULE = "=" * 80 + "\n"
_SERIALIZATIONS = ("cdr", "ros1")
_MOST_DEFINITIONS = 64  # of messages, whose compiled decoders are kept


class BagFile(MessageSet):
    """A bag that can be read from its beginning any number of times.

    Attributes:
        path: the file, or the folder with ``metadata.yaml``.
    """

    def __init__(self, path: Path, *, allow_partial: bool) -> None:
        """List the topics.

        Args:
            path: a path that ``files.is_rosbag`` accepts.
            allow_partial: read a damaged bag up to the damage.

        Raises:
            DatasetError: the bag is damaged and ``allow_partial`` is not set.
        """
        self.path = files.bag_in(path)
        super().__init__(str(self.path), is_ros1=files.is_ros1(self.path), allow_partial=allow_partial)
        self._metadata = files.metadata_of(self.path)
        self._is_cut = False
        self._types: dict[str, tuple[str, Typestore | None]] = {}
        connections = self._readable(self._survey())
        self._definitions = {connection.topic: connection for connection in reversed(connections)}
        counts: Counter[str] = Counter()
        for connection in connections:
            if self._is_read(connection):
                counts[connection.topic] += connection.msgcount
            else:
                read = self._definitions[connection.topic].msgtype
                self.notes.append(
                    f"{connection.topic} has messages of two types; those of {read} are read, not {connection.msgtype}"
                )
        self.topics = {
            name: BagTopic(name, self._definitions[name].msgtype, counts[name]) for name in sorted(self._definitions)
        }

    def messages(self, names: Collection[str]) -> Iterator[RawMessage]:
        """The messages of the topics ``names`` in the order of arrival, streamed; no other topic is opened.

        Raises:
            DatasetError: the bag is damaged and partial reading is not allowed.
        """
        if not names:
            return
        with ExitStack() as stack:
            for storage in self._storages():
                storage.open()
                stack.callback(storage.close)
                yield from self._messages_of(storage, names)

    def _survey(self) -> list[Connection]:
        """The connections of all files; determines whether the bag is sound."""
        try:
            files.check_lengths(self.path)
            return self._connections(files.sound_readers(self.path, self._metadata.compression))
        except Exception as error:
            reason = files.reason_of(error)
            if files.is_foreign(reason):
                raise DatasetError(f"{self.path} is not a bag of ROS: {reason}") from error
            self.damage = f"the bag is damaged or cut off ({reason})"
            if not self._allow_partial:
                raise self._damaged() from error
        self._is_cut = True
        try:
            return self._connections(files.partial_readers(self.path, self._metadata.compression))
        except Exception as error:
            reason = files.reason_of(error)
            if files.is_foreign(reason):
                raise DatasetError(f"{self.path} is not a bag of ROS: {reason}") from error
            raise DatasetError(f"nothing can be read of {self.path}: {reason}; copy it again") from error

    def _readable(self, connections: list[Connection]) -> list[Connection]:
        """Those of a serialization that is read; notes on the others, and on metadata that does not fit the files.

        Raises:
            DatasetError: there is none.
        """
        connections = [each for each in connections if isinstance(each.topic, str) and isinstance(each.msgtype, str)]
        formats = [getattr(each.ext, "serialization_format", "") or "cdr" for each in connections]
        known = [each for each, form in zip(connections, formats, strict=True) if form in _SERIALIZATIONS]
        others = sorted(set(formats) - set(_SERIALIZATIONS))
        if others and not known:
            raise DatasetError(
                f"{self.path}: its messages are serialized as {', '.join(map(shortened, others))}; only cdr, the "
                "format of ROS 2, is read: record it again with the default rmw_serialization_format"
            )
        if others:
            self.notes.append(f"topics serialized as {', '.join(map(shortened, others))} are not read, only cdr")
        metadata = self._metadata
        count = sum(each.msgcount for each in connections)
        self.notes += metadata.notes
        if metadata.messages is not None and count and metadata.messages != count:
            self.notes.append(f"metadata.yaml counts {metadata.messages} messages, the files hold {count}")
        return known

    def _is_read(self, connection: Connection) -> bool:
        """Whether a connection has the type of its topic, which another connection may have set."""
        known = self._definitions.get(connection.topic)
        return known is not None and known.msgtype == connection.msgtype

    def _connections(self, storages: list[Storage]) -> list[Connection]:
        found = []
        for storage in storages:
            storage.open()
            try:
                found += [connection._replace(owner=None) for connection in storage.connections]
            finally:
                storage.close()
        return found

    def _storages(self) -> list[Storage]:
        return (
            files.partial_readers(self.path, self._metadata.compression)
            if self._is_cut
            else files.sound_readers(self.path, self._metadata.compression)
        )

    def _messages_of(self, storage: Storage, names: Collection[str]) -> Iterator[RawMessage]:
        connections = [each for each in storage.connections if each.topic in names and self._is_read(each)]
        if not connections:
            return
        stream = storage.messages(connections)
        while True:
            try:
                connection, received_ns, data = next(stream)
            except StopIteration:
                return
            except Exception as error:  # the type depends on what the damaged chunk or page holds
                self.damage = self.damage or f"the bag is damaged in the middle ({files.reason_of(error)})"
                if not self._allow_partial:
                    raise self._damaged() from error
                return
            yield RawMessage(connection.topic, received_ns, bytes(data))

    def _damaged(self) -> DatasetError:
        return DatasetError(
            f"{self.path}: {self.damage}; --allow-partial (dataset.allow_partial) reads what is before it"
        )

    def typed(self, topic: str) -> tuple[str, Typestore]:
        """The type of a topic and its message definitions."""
        msgtype, store = self._types.get(topic, ("", None))
        if store is None:
            connection = self._definitions[topic]
            msgtype, store = connection.msgtype, typestore_of(connection.msgdef, connection.msgtype, self.is_ros1)
            self._types[topic] = (msgtype, store)
        return msgtype, store


@lru_cache(maxsize=_MOST_DEFINITIONS)
def typestore_of(definition: MessageDefinition, msgtype: str, is_ros1: bool) -> Typestore:
    """The message definitions of a topic: those in the bag, otherwise those of the distribution (Noetic, Humble).

    Topics of one definition share them, since ``rosbags`` compiles a decoder for each.
    """
    if definition.format == MessageDefinitionFormat.NONE:
        return get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    store = get_typestore(Stores.EMPTY)
    if definition.format == MessageDefinitionFormat.MSG:
        store.register(get_types_from_msg(definition.data, msgtype))
        return store
    parts = [part.split("\n", 1)[1] for part in definition.data.split(_IDL_RULE)[1:]] or [definition.data]
    for part in parts:
        store.register(get_types_from_idl(part))
    return store

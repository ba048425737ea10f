# SPDX-License-Identifier: BSD-3-Clause
"""An MCAP file that is being written: its messages as their records, or the chunks they are in, become complete."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2.storage_mcap import decompress
from rosbags.typesys.store import Typestore

from coclo_vio.datasets.rosbag.storage import mcap  # noqa: F401 -- bounds what a chunk unpacks to
from coclo_vio.datasets.rosbag.storage.bag_file import typestore_of
from coclo_vio.values.errors import DatasetError, shortened

_MAGIC = b"\x89MCAP0\r\n"
_RECORD = struct.Struct("<BQ")
_MOST_RECORD = 1 << 30  # bytes
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x03, 0x04, 0x05, 0x06, 0x0F
_FORMATS = {"ros2msg": MessageDefinitionFormat.MSG, "ros2idl": MessageDefinitionFormat.IDL}


class GrownMessage(NamedTuple):
    """A message of the file: its topic, type, number among those of its topic, time in the log, and CDR."""

    topic: str
    msgtype: str
    sequence: int
    logged_ns: int
    data: bytes


class GrowingMcap:
    """Reads what has been appended since it was last asked.

    Attributes:
        is_complete: whether the writer has closed the file.
        refused: what could not be read since it was last asked, a reason each.
    """

    def __init__(self, path: Path) -> None:
        """Open the file.

        Raises:
            DatasetError: it cannot be opened.
        """
        try:
            self._file = path.open("rb")
        except OSError as error:
            raise DatasetError(f"cannot read {shortened(path)}: {error.strerror}") from error
        self._path = path
        self._position = 0
        self._schemas: dict[int, tuple[str, MessageDefinition]] = {}
        self._channels: dict[int, tuple[str, int]] = {}
        self._definitions: dict[str, tuple[str, MessageDefinition]] = {}
        self._counts: dict[str, int] = {}
        self.is_complete = False
        self.refused: list[str] = []

    def messages(self) -> Iterator[GrownMessage]:
        """The messages that are new, in file order; what cannot be read is in ``refused``.

        Raises:
            DatasetError: it is no MCAP file.
        """
        if self._position == 0:
            self._file.seek(0)
            head = self._file.read(len(_MAGIC))
            if not _MAGIC.startswith(head):
                raise DatasetError(
                    f"{self._path} does not begin with the magic bytes of an MCAP file; give an MCAP file"
                )
            if len(head) < len(_MAGIC):
                return
            self._position = len(_MAGIC)
        while (record := self._next()) is not None:
            yield from self._of_record(*record)

    def typed(self, topic: str) -> tuple[str, Typestore]:
        """The type of a topic and the definitions that the file has of it."""
        msgtype, definition = self._definitions[topic]
        return msgtype, typestore_of(definition, msgtype, False)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _next(self) -> tuple[int, bytes] | None:
        """The next record, or None where it is not complete yet, or where there will be none."""
        if self.is_complete:
            return None
        self._file.seek(self._position)
        head = self._file.read(_RECORD.size)
        if len(head) < _RECORD.size:
            return None
        kind, size = _RECORD.unpack(head)
        if size > _MOST_RECORD or kind == 0:
            self.refused.append(f"a record of {size} bytes at byte {self._position}: what follows cannot be read")
            self.is_complete = True
            return None
        body = self._file.read(size)
        if len(body) < size:
            return None
        self._position += _RECORD.size + size
        return kind, body

    def _of_record(self, kind: int, body: bytes) -> Iterator[GrownMessage]:
        try:
            match kind:
                case 0x03:
                    self._add_schema(body)
                case 0x04:
                    self._add_channel(body)
                case 0x05:
                    yield self._message(body)
                case 0x06:
                    yield from self._of_chunk(body)
                case 0x0F:
                    self.is_complete = True
        except Exception as error:  # each compression has its own error for damaged data
            self.refused.append(f"a record cannot be read: {shortened(error)}")

    def _of_chunk(self, body: bytes) -> Iterator[GrownMessage]:
        _, _, size, crc = struct.unpack_from("<QQQI", body)
        compression, at = _string(body, 28)
        (packed,) = struct.unpack_from("<Q", body, at)
        data = decompress(body[at + 8 : at + 8 + packed], compression, size, crc)
        at = 0
        while at + _RECORD.size <= len(data):
            kind, length = _RECORD.unpack_from(data, at)
            at += _RECORD.size
            if kind in (_SCHEMA, _CHANNEL, _MESSAGE):
                yield from self._of_record(kind, data[at : at + length])
            at += length

    def _add_schema(self, body: bytes) -> None:
        (number,) = struct.unpack_from("<H", body)
        name, at = _string(body, 2)
        encoding, at = _string(body, at)
        (length,) = struct.unpack_from("<I", body, at)
        text = body[at + 4 : at + 4 + length].decode("utf-8")
        form = _FORMATS.get(encoding, MessageDefinitionFormat.NONE)
        self._schemas[number] = name, MessageDefinition(form, text)

    def _add_channel(self, body: bytes) -> None:
        number, schema = struct.unpack_from("<HH", body)
        topic, _ = _string(body, 4)
        self._channels[number] = topic, schema
        if schema in self._schemas:
            self._definitions.setdefault(topic, self._schemas[schema])

    def _message(self, body: bytes) -> GrownMessage:
        channel, _, logged_ns, _ = struct.unpack_from("<HIQQ", body)
        topic, _ = self._channels[channel]
        self._counts[topic] = self._counts.get(topic, 0) + 1
        return GrownMessage(topic, self._definitions[topic][0], self._counts[topic], logged_ns, body[22:])


def _string(body: bytes, at: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", body, at)
    return body[at + 4 : at + 4 + length].decode("utf-8"), at + 4 + length

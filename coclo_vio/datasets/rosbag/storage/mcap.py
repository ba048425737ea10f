# SPDX-License-Identifier: BSD-3-Clause
"""The readable part of MCAP files that were cut off; ``rosbags`` refuses a file without its footer.

Format: "MCAP format specification", mcap.dev/spec.
"""

import os
import struct
from collections import Counter
from collections.abc import Collection, Generator
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

from rosbags.interfaces import Connection
from rosbags.interfaces.typing import RPath
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.storage_mcap import DECOMPRESSORS, McapReader, decompress

from coclo_vio.datasets.rosbag.storage.unpack import unpacked, unpacked_prefix

_MAGIC = b"\x89MCAP0\r\n"
_CHUNK, _DATA_END = 0x06, 0x0F
_RECORD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQI")
_Message = tuple[Connection, int, bytes]


# Those of the library unpack whatever a chunk expands to; they are given its recorded size and do not use it.
DECOMPRESSORS.update({name: partial(unpacked, name) for name in DECOMPRESSORS})


def has_profile_of_ros2(path: Path) -> bool:
    """Whether an MCAP file says that it is of ROS 2; other recorders write files of ROS 2 without saying so."""
    with path.open("rb") as file:
        head = file.read(len(_MAGIC) + _RECORD.size + 64)
    start = len(_MAGIC) + _RECORD.size
    (length,) = struct.unpack_from("<I", head.ljust(start + 4, b"\0"), start)
    return not head.startswith(_MAGIC) or head[start + 4 : start + 4 + length] == b"ros2"


class _Span(NamedTuple):
    """A range of bytes that holds complete records."""

    file: BinaryIO
    start: int
    end: int


class CutMcapReader(McapReader):
    """An MCAP file that was cut off: the complete records before the cut, those of a cut chunk among them.

    Attributes:
        break_pos: the byte at which reading stops.
    """

    def __init__(self, path: RPath) -> None:
        super().__init__(path)
        self.break_pos = 0
        self._file: BinaryIO | None = None
        self._spans: list[_Span] = []

    def open(self) -> None:
        """Read the file through once.

        Raises:
            ReaderError: not an MCAP file, or no message in it.
        """
        self._file = self.bio = self.path.open("rb")
        if self.bio.read(len(_MAGIC)) != _MAGIC:
            raise ReaderError("it does not begin with the magic bytes of an MCAP file")
        tail = self._find_break()
        self._spans = [_Span(self._file, len(_MAGIC), self.break_pos)]
        if tail:
            self._spans.append(_Span(BytesIO(tail), 0, _end_of_complete_records(tail)))
        counts: Counter[int] = Counter()
        for span in self._spans:
            self._select(span)
            self.meta_scan()
            counts.update(self.statistics.channel_message_counts if self.statistics else {})
        if not counts:
            raise ReaderError(f"it is cut off at byte {self.break_pos}, before the first message")
        self.connections = [connection._replace(msgcount=counts[connection.id]) for connection in self.connections]

    def close(self) -> None:
        """Close the file."""
        self.bio, self._file = self._file, None
        super().close()

    def messages(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> Generator[_Message, None, None]:
        """Messages of ``connections`` in file order, up to the cut."""
        for span in self._spans:
            self._select(span)
            yield from self.messages_scan(connections, start, stop)

    def _select(self, span: _Span) -> None:
        self.bio, self.data_start, self.data_end = span

    def _find_break(self) -> bytes:
        """Set ``break_pos`` to the end of the last complete record; returns the unpacked part of a chunk cut there."""
        file = self._file
        if file is None:
            raise ReaderError("the file is not open")
        total = file.seek(0, os.SEEK_END)
        file.seek(len(_MAGIC))
        while True:
            self.break_pos = file.tell()
            head = file.read(_RECORD.size)
            if len(head) < _RECORD.size:
                return b""
            op, size = _RECORD.unpack(head)
            is_complete = file.tell() + size <= total
            if op == _CHUNK:
                body = file.read(size) if is_complete else file.read()
                if not is_complete or not _is_sound(body):
                    return _unpacked_prefix(body)
            elif op == _DATA_END or not is_complete:
                return b""
            else:
                file.seek(size, os.SEEK_CUR)


def _chunk_parts(body: bytes) -> tuple[int, int, str, bytes]:
    """Unpacked size, checksum, compression and packed data of a chunk record, which may be cut off."""
    _, _, size, crc = _CHUNK_HEAD.unpack_from(body)
    (length,) = struct.unpack_from("<I", body, _CHUNK_HEAD.size)
    start = _CHUNK_HEAD.size + 4
    compression = body[start : start + length].decode("ascii")
    return size, crc, compression, body[start + length + 8 :]


def _is_sound(body: bytes) -> bool:
    try:
        size, crc, compression, data = _chunk_parts(body)
        decompress(data, compression, size, crc)
    except Exception:  # each compression has its own error for damaged data
        return False
    return True


def _unpacked_prefix(body: bytes) -> bytes:
    try:
        _, _, compression, data = _chunk_parts(body)
        return unpacked_prefix(compression, data)
    except (struct.error, ValueError):
        return b""


def _end_of_complete_records(data: bytes) -> int:
    end = 0
    while end + _RECORD.size <= len(data):
        op, size = _RECORD.unpack_from(data, end)
        after = end + _RECORD.size + size
        if op == 0 or after > len(data):  # there is no record of the kind 0
            break
        end = after
    return end

# SPDX-License-Identifier: BSD-3-Clause
"""ROS 1 bags read chunk by chunk: in constant memory, and without the index where a bag was cut off.

``rosbags`` holds 150 bytes of index a message (a quarter of a gigabyte for an hour at 500 Hz) and refuses a bag without
an index. Here only the table of chunks is held, and a chunk is opened when its messages are due. Format: "ROS bag
format 2.0", wiki.ros.org/Bags/Format/2.0.
"""

import heapq
import os
from collections import Counter
from collections.abc import Collection, Generator, Iterator
from contextlib import suppress
from functools import partial
from io import BytesIO
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag1.reader import (
    Chunk,
    ChunkInfo,
    Header,
    IndexData,
    Reader,
    ReaderError,
    RecordType,
    read_bytes,
    read_uint32,
)

from coclo_vio.datasets.rosbag.storage.sized_file import SizedFile, SizedPath
from coclo_vio.datasets.rosbag.storage.unpack import check_size, unpacked, unpacked_prefix

_MAGIC = b"#ROSBAG V2.0\n"
_NO_TIME_NS = 2**63 - 1
_Message = tuple[Connection, int, bytes]


class ChunkReader(Reader):
    """A ROS 1 bag: messages in the order of arrival, one chunk in memory at a time."""

    _may_break = False

    def __init__(self, path: Path) -> None:
        super().__init__(SizedPath(path))

    def open(self) -> None:
        """Read the table of chunks.

        Raises:
            ReaderError: it is damaged or missing.
        """
        super().open()
        counts: Counter[int] = Counter()
        for info in self.chunk_infos:
            counts.update(info.connection_counts)
        self.connections = [connection._replace(msgcount=counts[connection.id]) for connection in self.connections]

    def read_chunk(self) -> Chunk:
        """Place and size of the chunk at the current position, and how it is unpacked.

        Raises:
            ReaderError: the header is damaged.
        """
        if self.bio is None:
            raise ReaderError("the bag is not open")
        header = Header.read(self.bio, RecordType.CHUNK)
        compression, size, packed = header.get_string("compression"), header.get_uint32("size"), read_uint32(self.bio)
        datapos = self.bio.tell()
        self.bio.seek(packed, os.SEEK_CUR)
        return Chunk(packed, datapos, partial(unpacked, compression, size=size))

    def read_index_data(self, pos: int, indexes: dict[int, list[IndexData]]) -> None:
        """Skip the index of single messages, which is not needed here."""

    def messages(
        self, connections: Collection[Connection] = (), start: int | None = None, stop: int | None = None
    ) -> Generator[_Message, None, None]:
        """Messages of ``connections`` in the order of their times; chunks without any of them stay closed.

        Raises:
            ReaderError: a chunk is damaged.
        """
        by_id = {connection.id: connection for connection in connections}
        held: list[tuple[int, int, _Message]] = []
        number = 0
        for info in sorted(self.chunk_infos, key=lambda info: info.start_time):
            if not any(info.connection_counts.get(connection_id) for connection_id in by_id):
                continue
            while held and held[0][0] < info.start_time:
                yield heapq.heappop(held)[2]
            for connection_id, time_ns, data in self._messages_in(info.pos):
                if connection_id in by_id:
                    number += 1
                    heapq.heappush(held, (time_ns, number, (by_id[connection_id], time_ns, data)))
        while held:
            yield heapq.heappop(held)[2]

    def _messages_in(self, chunk_pos: int) -> Iterator[tuple[int, int, bytes]]:
        """Connection, time and data of the messages in a chunk, in file order."""
        for _, header, data in _records(self._opened(self.chunks[chunk_pos]), may_break=self._may_break):
            if header.get_uint8("op") == RecordType.MSGDATA:
                yield header.get_uint32("conn"), header.get_time("time"), data

    def _opened(self, chunk: Chunk) -> BytesIO:
        if self.bio is None:
            raise ReaderError("the bag is not open")
        self.bio.seek(chunk.datapos)
        check_size(chunk.datasize)
        return BytesIO(chunk.decompressor(read_bytes(self.bio, chunk.datasize)))


class CutChunkReader(ChunkReader):
    """A ROS 1 bag that was cut off: its readable part, found by reading it through.

    Attributes:
        break_pos: the byte at which reading stops.
    """

    _may_break = True

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.break_pos = 0

    def open(self) -> None:
        """Read the bag through once and index the chunks.

        Raises:
            ReaderError: not a ROS 1 bag, or no message in it.
        """
        self.bio = SizedFile(Path(str(self.path)))
        if self.bio.readline() != _MAGIC:
            raise ReaderError("it does not begin with the magic bytes of a ROS 1 bag")
        with suppress(ReaderError, OSError, EOFError, ValueError, RuntimeError):
            while True:
                self.break_pos = self.bio.tell()
                self._take_record()
        counts: Counter[int] = Counter()
        for info in self.chunk_infos:
            counts.update(info.connection_counts)
        if not counts:
            raise ReaderError(f"it is cut off at byte {self.break_pos}, before the first message")
        self.connections = [connection._replace(msgcount=counts[connection.id]) for connection in self.connections]

    def _take_record(self) -> None:
        """Read one record outside the chunks.

        Raises:
            ReaderError: the file ends.
        """
        if self.bio is None:
            raise ReaderError("the bag is not open")
        pos = self.bio.tell()
        header = Header.read(self.bio)
        if header.get_uint8("op") != RecordType.CHUNK:
            read_bytes(self.bio, read_uint32(self.bio))
            return
        size, datapos = read_uint32(self.bio), self.bio.tell()
        check_size(size)
        available = len(self.bio.read(size))
        self.chunks[pos] = Chunk(available, datapos, partial(unpacked_prefix, header.get_string("compression")))
        self._survey(pos, self.chunks[pos])
        self.break_pos = datapos + available
        self.bio.seek(self.break_pos)
        if available < size:
            raise ReaderError("the last chunk is cut off")

    def _survey(self, pos: int, chunk: Chunk) -> None:
        """Index the connections and times in a chunk."""
        known = {connection.id for connection in self.connections}
        counts: Counter[int] = Counter()
        times_ns: list[int] = []
        inside = self._opened(chunk)
        for start, header, _ in _records(inside, may_break=True):
            match header.get_uint8("op"):
                case RecordType.CONNECTION if header.get_uint32("conn") not in known:
                    known.add(header.get_uint32("conn"))
                    self.connections.append(self._connection_at(inside, start))
                case RecordType.MSGDATA:
                    counts[header.get_uint32("conn")] += 1
                    times_ns.append(header.get_time("time"))
        first_ns, last_ns = min(times_ns, default=_NO_TIME_NS), max(times_ns, default=0)
        self.chunk_infos.append(ChunkInfo(pos, first_ns, last_ns + 1, dict(counts)))

    def _connection_at(self, inside: BytesIO, start: int) -> Connection:
        """The connection whose record is at ``start`` of a chunk; ``rosbags`` reads it only from its own file."""
        after, outer = inside.tell(), self.bio
        inside.seek(start)
        self.bio = inside
        try:
            return self.read_connection()
        finally:
            self.bio = outer
            inside.seek(after)


def _records(inside: BytesIO, *, may_break: bool) -> Iterator[tuple[int, Header, bytes]]:
    """Start, header and data of the records of an opened chunk, up to its end or to where it is cut off."""
    end = len(inside.getbuffer())
    while (start := inside.tell()) < end:
        try:
            header = Header.read(inside)
            data = read_bytes(inside, read_uint32(inside))
        except ReaderError:
            if may_break:
                return
            raise
        yield start, header, data

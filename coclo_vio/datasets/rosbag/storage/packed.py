# SPDX-License-Identifier: BSD-3-Clause
"""ROS 2 bags whose files or messages are compressed by zstd as a whole."""

import tempfile
from collections.abc import Callable, Collection, Iterator
from pathlib import Path

from rosbags.interfaces import Connection

from coclo_vio.datasets.rosbag.storage.storage import Storage
from coclo_vio.datasets.rosbag.storage.unpack import unpacked, zstd

_MOST_TIMES = 200  # a file may expand so many times; databases of images and joints expand ten times
_PIECE = 2**20


class PackedFile:
    """A file that is unpacked into a temporary folder while it is open."""

    def __init__(self, path: Path, reader: Callable[[Path], Storage]) -> None:
        self._path = path
        self._reader = reader
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._storage: Storage | None = None

    @property
    def connections(self) -> list[Connection]:
        """The connections of the open file."""
        return [] if self._storage is None else self._storage.connections

    def open(self) -> None:
        """Unpack the file and read its connections.

        Raises:
            ValueError: it expands to more than 200 times its size.
        """
        self._folder = tempfile.TemporaryDirectory(prefix="coclo_vio_bag")
        plain = Path(self._folder.name) / self._path.name.removesuffix(".zstd")
        try:
            self._unpack(plain)
            self._storage = self._reader(plain)
            self._storage.open()
        except BaseException:
            self._storage = None
            self._folder.cleanup()
            raise

    def close(self) -> None:
        """Close the file and remove the unpacked one."""
        if self._storage is not None:
            self._storage.close()
        if self._folder is not None:
            self._folder.cleanup()
        self._storage = self._folder = None

    def messages(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        """Messages of ``connections``, as they are in the unpacked file."""
        if self._storage is not None:
            yield from self._storage.messages(connections)

    def _unpack(self, plain: Path) -> None:
        left = max(_PIECE, _MOST_TIMES * self._path.stat().st_size)
        with zstd.open(self._path, "rb") as source, plain.open("wb") as target:
            while piece := source.read(_PIECE):
                left -= len(piece)
                if left < 0:
                    raise ValueError(f"{self._path.name} expands to more than {_MOST_TIMES} times its size")
                target.write(piece)


class PackedMessages:
    """A file whose messages are compressed one by one."""

    def __init__(self, storage: Storage) -> None:
        self._storage = storage

    @property
    def connections(self) -> list[Connection]:
        """The connections of the open file."""
        return self._storage.connections

    def open(self) -> None:
        """Read the connections."""
        self._storage.open()

    def close(self) -> None:
        """Close the file."""
        self._storage.close()

    def messages(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        """Messages of ``connections``, unpacked.

        Raises:
            ValueError: a message cannot be unpacked within bounds.
        """
        for connection, received_ns, data in self._storage.messages(connections):
            yield connection, received_ns, unpacked("zstd", data, None)

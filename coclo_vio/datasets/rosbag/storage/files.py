# SPDX-License-Identifier: BSD-3-Clause
"""Which files form a bag, and their readers: of ``rosbags`` for sound files, of this package for damaged ones."""

import re
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Protocol

from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader as Ros2Reader

from coclo_vio.datasets.rosbag.storage.chunks import ChunkReader, CutChunkReader
from coclo_vio.datasets.rosbag.storage.mcap import CutMcapReader
from coclo_vio.datasets.rosbag.storage.sqlite import CutSqliteReader, check_length
from coclo_vio.values.errors import DatasetError, listing

LAYOUT = "a .bag, .mcap or .db3 file, or a folder with metadata.yaml"

_METADATA = "metadata.yaml"
_ROS2_SUFFIXES = (".mcap", ".db3")
_MAX_REASON_LENGTH = 200
_REASONS = {
    "Bag index looks damaged": "its index is missing",
    "Bag is not indexed": "it was never closed and has no index",
    "Could not read uint": "it ends too early",
    "File end magic is invalid": "its end is missing",
    "database disk image is malformed": "pages of its database are missing or damaged",
}


class Storage(Protocol):
    """The common interface of the readers of ``rosbags`` and of those of damaged files."""

    @property
    def connections(self) -> list[Connection]:
        """The connections of an open file; a topic may have several."""

    def open(self) -> None:
        """Read the connections."""

    def close(self) -> None:
        """Close the file."""

    def messages(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        """Messages of ``connections`` with the time at which they were received, ns."""


def is_rosbag(path: Path) -> bool:
    """Whether ``path`` is a bag, or a folder that holds one."""
    if path.is_dir():
        if (path / _METADATA).is_file():
            return "rosbag2_bagfile_information" in (path / _METADATA).read_text(encoding="utf-8", errors="replace")
        return bool(_ros2_files(path) or list(path.glob("*.bag")))
    return path.suffix in {".bag", *_ROS2_SUFFIXES}


def bag_in(path: Path) -> Path:
    """The bag at ``path``: itself, or the only ROS 1 bag in the folder.

    Raises:
        DatasetError: several bags in the folder.
    """
    if not path.is_dir() or (path / _METADATA).is_file() or _ros2_files(path):
        return path
    bags = sorted(path.glob("*.bag"))
    if len(bags) != 1:
        named = listing(bag.name for bag in bags)
        raise DatasetError(f"{path} holds {len(bags)} bags ({named}); pass the path of one of them")
    return bags[0]


def is_ros1(path: Path) -> bool:
    """Whether a bag (a path from ``bag_in``) is of ROS 1."""
    return path.suffix == ".bag"


def sound_readers(path: Path) -> list[Storage]:
    """Readers of a sound bag."""
    if is_ros1(path):
        return [ChunkReader(path)]
    if path.is_dir() and not (path / _METADATA).is_file():
        return [Ros2Reader(file) for file in _ros2_files(path)]
    return [Ros2Reader(path)]


def partial_readers(path: Path) -> list[Storage]:
    """Readers of the readable part of a bag, file by file: sound files by the readers of ``rosbags``."""
    if is_ros1(path):
        return [CutChunkReader(path)]
    return [_reader_of(file) for file in (_ros2_files(path) if path.is_dir() else [path])]


def check_lengths(path: Path) -> None:
    """Check that no database of a bag was cut off.

    Raises:
        ReaderError: a database is shorter than its header states.
    """
    for file in _ros2_files(path) if path.is_dir() else [path]:
        if file.suffix == ".db3":
            check_length(file)


def reason_of(error: Exception) -> str:
    """The message of a library's error, without path and brackets, as part of a sentence."""
    known = next((reason for message, reason in _REASONS.items() if message in str(error)), None)
    if known is not None:
        return known
    reason = re.sub(r"Cannot open database [^:]*: |[()'\n]", "", str(error)).strip(" .,")
    reason = reason if len(reason) <= _MAX_REASON_LENGTH else reason[:_MAX_REASON_LENGTH] + " ..."
    return reason or type(error).__name__


def _ros2_files(folder: Path) -> list[Path]:
    """The data files of a ROS 2 bag in the order in which they were recorded (``_0``, ``_1``, ... ``_10``)."""
    files = [file for file in folder.iterdir() if file.suffix in _ROS2_SUFFIXES]
    return sorted(files, key=lambda file: (len(file.name), file.name))


def _reader_of(file: Path) -> Storage:
    sound = Ros2Reader(file)
    try:
        check_lengths(file)
        sound.open()
    except Exception:  # the library has no common error for damaged files
        return CutMcapReader(file) if file.suffix == ".mcap" else CutSqliteReader(file)
    sound.close()
    return sound

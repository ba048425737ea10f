# SPDX-License-Identifier: BSD-3-Clause
"""Which files are a bag, and what reads them: ``rosbags``' readers where they are sound, ours where they are not."""

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

LOOKS_FOR = "a rosbag: a .bag, .mcap or .db3 file, or a folder with metadata.yaml"

_METADATA = "metadata.yaml"
_ROS2_SUFFIXES = (".mcap", ".db3")
_LONGEST_REASON = 200
_PLAINLY = {
    "Bag index looks damaged": "its index is missing",
    "Bag is not indexed": "it was never closed and has no index",
    "Could not read uint": "it ends too early",
    "File end magic is invalid": "its end is missing",
    "database disk image is malformed": "pages of its database are missing or damaged",
}


class Storage(Protocol):
    """What the readers of ``rosbags`` and those of cut files have in common."""

    @property
    def connections(self) -> list[Connection]:
        """The topics, once it is open; a topic may have several."""

    def open(self) -> None:
        """Find out what there is."""

    def close(self) -> None:
        """Let go of the file."""

    def messages(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        """Messages with the time at which they were received, ns."""


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
        DatasetError: several bags.
    """
    if not path.is_dir() or (path / _METADATA).is_file() or _ros2_files(path):
        return path
    bags = sorted(path.glob("*.bag"))
    if len(bags) != 1:
        named = listing(bag.name for bag in bags)
        raise DatasetError(f"{path} holds {len(bags)} bags ({named}); give the path of one of them")
    return bags[0]


def is_ros1(path: Path) -> bool:
    """Whether a bag that ``bag_in`` gave is of ROS 1."""
    return path.suffix == ".bag"


def whole(path: Path) -> list[Storage]:
    """Readers of a bag as it should be."""
    if is_ros1(path):
        return [ChunkReader(path)]
    if path.is_dir() and not (path / _METADATA).is_file():
        return [Ros2Reader(file) for file in _ros2_files(path)]
    return [Ros2Reader(path)]


def remaining(path: Path) -> list[Storage]:
    """Readers of what is left of a bag, file by file: those that are sound as they should be."""
    if is_ros1(path):
        return [CutChunkReader(path)]
    return [_sound_or_cut(file) for file in (_ros2_files(path) if path.is_dir() else [path])]


def check_lengths(path: Path) -> None:
    """See that no database of a bag was cut off.

    Raises:
        ReaderError: one was.
    """
    for file in _ros2_files(path) if path.is_dir() else [path]:
        if file.suffix == ".db3":
            check_length(file)


def in_plain_words(error: Exception) -> str:
    """What a library says, without the path and its brackets, as part of a sentence."""
    known = next((ours for theirs, ours in _PLAINLY.items() if theirs in str(error)), None)
    if known is not None:
        return known
    said = re.sub(r"Cannot open database [^:]*: |[()'\n]", "", str(error)).strip(" .,")
    said = said if len(said) <= _LONGEST_REASON else said[:_LONGEST_REASON] + " ..."
    return said or type(error).__name__


def _ros2_files(folder: Path) -> list[Path]:
    """The data files of a ROS 2 bag in the order in which they were recorded (``_0``, ``_1``, ... ``_10``)."""
    files = [file for file in folder.iterdir() if file.suffix in _ROS2_SUFFIXES]
    return sorted(files, key=lambda file: (len(file.name), file.name))


def _sound_or_cut(file: Path) -> Storage:
    sound = Ros2Reader(file)
    try:
        check_lengths(file)
        sound.open()
    except Exception:  # whatever a damaged file makes the library say
        return CutMcapReader(file) if file.suffix == ".mcap" else CutSqliteReader(file)
    sound.close()
    return sound

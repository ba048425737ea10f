# SPDX-License-Identifier: BSD-3-Clause
"""Which files form a bag, and their readers: of ``rosbags`` for sound files, of this package for damaged ones."""

import re
from collections.abc import Callable
from pathlib import Path

from rosbags.rosbag2 import Reader as Ros2Reader

from coclo_vio.datasets.rosbag.storage.chunks import ChunkReader, CutChunkReader
from coclo_vio.datasets.rosbag.storage.folder_metadata import METADATA, Compression, FolderMetadata, read_metadata
from coclo_vio.datasets.rosbag.storage.mcap import CutMcapReader, has_profile_of_ros2
from coclo_vio.datasets.rosbag.storage.packed import PackedFile, PackedMessages
from coclo_vio.datasets.rosbag.storage.sized_file import SizedPath
from coclo_vio.datasets.rosbag.storage.sqlite import CutSqliteReader, check_length
from coclo_vio.datasets.rosbag.storage.storage import Storage
from coclo_vio.values.errors import DatasetError, listing

LAYOUT = "a .bag, .mcap or .db3 file, or a folder with metadata.yaml"

_ROS2_SUFFIXES = (".mcap", ".db3")
_MAX_REASON_LENGTH = 200
_METADATA_HEAD = 4096
_ONLY_ROS = ", only those of ROS (ros2msg, ros2idl) are read"
_REASONS = {
    "Bag index looks damaged": "its index is missing",
    "Bag is not indexed": "it was never closed and has no index",
    "Could not read uint": "it ends too early",
    "File end magic is invalid": "its end is missing",
    "jsonschema": "its messages are JSON" + _ONLY_ROS,
    "protobuf": "its messages are of protobuf" + _ONLY_ROS,
    "flatbuffer": "its messages are of flatbuffers" + _ONLY_ROS,
    "database disk image is malformed": "pages of its database are missing or damaged",
}


def is_rosbag(path: Path) -> bool:
    """Whether ``path`` is a bag, or a folder that holds one."""
    if path.is_dir():
        return bool(ros2_files(path) or list(path.glob("*.bag")) or _is_metadata(path / METADATA))
    return path.suffix in {".bag", *_ROS2_SUFFIXES}


def bag_in(path: Path) -> Path:
    """The bag at ``path``: itself, or the only ROS 1 bag in the folder.

    Raises:
        DatasetError: several bags in the folder, or none.
    """
    if not path.is_dir() or ros2_files(path):
        return path
    bags = sorted(path.glob("*.bag"))
    if not bags:
        raise DatasetError(f"{path} holds {METADATA} and no .mcap or .db3 file; copy the bag's files into the folder")
    if len(bags) != 1:
        named = listing(bag.name for bag in bags)
        raise DatasetError(f"{path} holds {len(bags)} bags ({named}); pass the path of one of them")
    return bags[0]


def is_ros1(path: Path) -> bool:
    """Whether a bag (a path from ``bag_in``) is of ROS 1."""
    return path.suffix == ".bag"


def metadata_of(path: Path) -> FolderMetadata:
    """The metadata of a bag, if it is a folder."""
    return read_metadata(path, [file.name for file in ros2_files(path)]) if path.is_dir() else FolderMetadata()


def sound_readers(path: Path, compression: Compression) -> list[Storage]:
    """Readers of a sound bag, file by file; ``compression`` is that of its metadata."""
    return [ChunkReader(path)] if is_ros1(path) else _readers(path, compression, _sound_reader)


def partial_readers(path: Path, compression: Compression) -> list[Storage]:
    """Readers of the readable part of a bag, file by file: sound files by the readers of ``rosbags``."""
    return [CutChunkReader(path)] if is_ros1(path) else _readers(path, compression, _reader_of)


def _readers(path: Path, compression: Compression, reader: Callable[[Path], Storage]) -> list[Storage]:
    files = ros2_files(path) if path.is_dir() else [path]
    match compression:
        case "file":
            return [PackedFile(file, reader) for file in files]
        case "message":
            return [PackedMessages(reader(file)) for file in files]
    return [reader(file) for file in files]


def check_lengths(path: Path) -> None:
    """Check that no database of a bag was cut off.

    Raises:
        ReaderError: a database is shorter than its header states.
    """
    for file in ros2_files(path) if path.is_dir() else [path]:
        if file.suffix == ".db3":
            check_length(file)


def is_foreign(reason: str) -> bool:
    """Whether a reason of ``reason_of`` says that the file is sound, but of other tools than ROS."""
    return reason.endswith(_ONLY_ROS)


def reason_of(error: Exception) -> str:
    """The message of a library's error, without path and brackets, as part of a sentence."""
    known = next((reason for message, reason in _REASONS.items() if message in str(error)), None)
    if known is not None:
        return known
    reason = re.sub(r"Cannot open database [^:]*: |[()'\"]", "", " ".join(str(error).split())).strip(" .,")
    reason = reason if len(reason) <= _MAX_REASON_LENGTH else reason[:_MAX_REASON_LENGTH] + " ..."
    return reason or type(error).__name__


def ros2_files(folder: Path) -> list[Path]:
    """The data files of a ROS 2 bag in the order in which they were recorded (``_0``, ``_1``, ... ``_10``)."""
    files = [file for file in folder.iterdir() if Path(file.name.removesuffix(".zstd")).suffix in _ROS2_SUFFIXES]
    return sorted(files, key=lambda file: (len(file.name), file.name))


def _sound_reader(file: Path) -> Storage:
    if file.suffix != ".mcap":
        return Ros2Reader(file)
    return Ros2Reader(SizedPath(file)) if has_profile_of_ros2(file) else CutMcapReader(SizedPath(file))


def _reader_of(file: Path) -> Storage:
    sound = _sound_reader(file)
    try:
        check_lengths(file)
        sound.open()
    except Exception:  # the library has no common error for damaged files
        return CutMcapReader(SizedPath(file)) if file.suffix == ".mcap" else CutSqliteReader(file)
    sound.close()
    return sound


def _is_metadata(file: Path) -> bool:
    try:
        with file.open(encoding="utf-8", errors="replace") as text:
            return "rosbag2_bagfile_information" in text.read(_METADATA_HEAD)
    except OSError:
        return False

# SPDX-License-Identifier: BSD-3-Clause
"""A rosbag being written: ROS 1, or ROS 2 as MCAP, SQLite file or folder. The only importer of rosbags' writers.

The same messages make the same bytes: no wall clock, no random number goes into the file. The bag gets
its own name only when it is complete.
"""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, Literal

from rosbags.interfaces import Connection, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag1 import WriterError as Ros1Error
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.rosbag2 import WriterError as Ros2Error
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from coclo_vio.values.errors import DatasetError, TimestampError
from coclo_vio.values.units import NS_PER_S

TF_MESSAGE = "tf2_msgs/msg/TFMessage"

_LAST_SECOND = {1: 2**32 - 1, 2: 2**31 - 1}  # of a stamp: uint32 in ROS 1, int32 in ROS 2
_METADATA_VERSION: Literal[8] = 8  # read by ROS 2 Iron and later; an MCAP file by every ROS 2
_FOREVER = QosTime(9_223_372_036, 854_775_807)
_LATCHED = Qos(
    QosHistory.KEEP_LAST,
    1,
    QosReliability.RELIABLE,
    QosDurability.TRANSIENT_LOCAL,
    _FOREVER,
    _FOREVER,
    QosLiveliness.AUTOMATIC,
    _FOREVER,
    False,
)


class NewBag:
    """An open bag.

    Attributes:
        ros: 1 or 2.
        types: the message classes by name, such as ``sensor_msgs/msg/Imu``.
    """

    def __init__(self, writer: Ros1Writer | Ros2Writer) -> None:
        self._writer = writer
        self.ros: Literal[1, 2] = 1 if isinstance(writer, Ros1Writer) else 2
        self._store = _typestore(self.ros)
        self.types: dict[str, Any] = dict(self._store.types)
        self._topics: dict[str, Connection] = {}

    def write(self, topic: str, stamp_ns: int, message: Any, *, is_latched: bool = False) -> None:
        """Append a message; its stamp is also its time of arrival. A topic is made with its first message.

        Args:
            topic: its name.
            stamp_ns: time in nanoseconds.
            message: an instance of one of ``types``.
            is_latched: whether late subscribers get the last message too.

        Raises:
            TimestampError: a stamp that ROS cannot hold.
        """
        if not 0 <= stamp_ns // NS_PER_S <= _LAST_SECOND[self.ros]:
            raise TimestampError(
                f"{topic}: ROS {self.ros} cannot hold the stamp {stamp_ns} ns: its seconds go from 0 to "
                f"{_LAST_SECOND[self.ros]}; shift the recording's clock, or write an EuRoC folder"
            )
        connection = self._topics.get(topic)
        if connection is None:
            connection = self._topics[topic] = self._connect(topic, message.__msgtype__, is_latched=is_latched)
        serialize: Callable[[Any, str], Any] = (
            self._store.serialize_ros1 if self.ros == 1 else self._store.serialize_cdr
        )
        self._writer.write(connection, stamp_ns, serialize(message, message.__msgtype__))

    def _connect(self, topic: str, msgtype: str, *, is_latched: bool) -> Connection:
        if isinstance(self._writer, Ros1Writer):
            return self._writer.add_connection(topic, msgtype, typestore=self._store, latching=int(is_latched))
        profiles = [_LATCHED] if is_latched else []
        return self._writer.add_connection(topic, msgtype, typestore=self._store, offered_qos_profiles=profiles)


class RawBag:
    """An MCAP bag that is written where it stays, of messages that are serialized already; not compressed.

    What was written until the last ``flush`` can be read if nothing else is done.
    """

    def __init__(self, folder: Path) -> None:
        """Make the folder with ``<name of the folder>.mcap``.

        Raises:
            DatasetError: the folder exists or cannot be made.
        """
        self._folder = folder
        self._topics: dict[str, Connection] = {}
        try:
            self._writer = Ros2Writer(folder, version=_METADATA_VERSION, storage_plugin=StoragePlugin.MCAP)
            self._writer.open()
        except (Ros2Error, OSError) as error:
            raise DatasetError(f"cannot write the bag {folder}: {error}; choose another folder") from error

    def write(self, topic: str, msgtype: str, received_ns: int, data: bytes, store: Typestore) -> None:
        """Append a message.

        Args:
            topic: its name.
            msgtype: its type.
            received_ns: its time of arrival, ns.
            data: CDR.
            store: has the definition of the type.

        Raises:
            DatasetError: it cannot be written.
        """
        try:
            connection = self._topics.get(topic)
            if connection is None:
                connection = self._topics[topic] = self._writer.add_connection(topic, msgtype, typestore=store)
            self._writer.write(connection, received_ns, data)
        except (Ros2Error, OSError, TypesysError) as error:
            raise DatasetError(f"cannot write {topic} to the bag {self._folder}: {error}") from error

    def flush(self) -> None:
        """Hand everything to the operating system."""
        storage = self._writer.storage
        if isinstance(storage, McapWriter):
            if storage.chunk.bio.tell():
                storage.close_chunk()
            storage.bio.flush()

    def close(self) -> None:
        """Complete the bag.

        Raises:
            DatasetError: it cannot be written.
        """
        try:
            self._writer.close()
        except (Ros2Error, OSError) as error:
            raise DatasetError(f"cannot complete the bag {self._folder}: {error}") from error


@contextmanager
def new_bag(path: Path) -> Iterator[NewBag]:
    """A bag to be written at ``path``: ``.bag`` is ROS 1, ``.mcap`` and ``.db3`` one file of ROS 2, no suffix a folder.

    Chunks are compressed (lz4 in ROS 1, zstd in MCAP), because joint names repeat in every message.

    Raises:
        DatasetError: another suffix, a path that exists, or one that cannot be written.
    """
    check_bag_path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as folder:
            writer, written = _KINDS[path.suffix](Path(folder), path)
            with writer:
                yield NewBag(writer)
            written.replace(path)
    except (Ros1Error, Ros2Error, SerdeError) as error:
        raise DatasetError(f"cannot write the bag {path}: {error}") from error
    except OSError as error:
        raise DatasetError(f"cannot write the bag {path}: {error.strerror}; choose another path") from error


def check_bag_path(path: Path) -> None:
    """Check that a bag can be written at ``path``, before there is anything to write.

    Raises:
        DatasetError: the suffix is not that of a bag, or the path exists.
    """
    if path.suffix not in _KINDS:
        raise DatasetError(
            f"{path} ends in {path.suffix}, not the suffix of a bag; use .bag (ROS 1), .mcap or .db3 (ROS 2), or "
            "none (ROS 2 folder)"
        )
    if path.exists():
        raise DatasetError(f"{path} exists already; delete it, or choose another path")


def _ros1(folder: Path, path: Path) -> tuple[Ros1Writer, Path]:
    writer = Ros1Writer(folder / path.name)
    writer.set_compression(Ros1Writer.CompressionFormat.LZ4)
    return writer, folder / path.name


def _mcap(folder: Path, path: Path) -> tuple[Ros2Writer, Path]:
    writer = Ros2Writer(folder / path.stem, version=_METADATA_VERSION, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    return writer, folder / path.stem / path.name


def _sqlite_file(folder: Path, path: Path) -> tuple[Ros2Writer, Path]:
    return Ros2Writer(folder / path.stem, version=_METADATA_VERSION), folder / path.stem / path.name


def _sqlite_folder(folder: Path, path: Path) -> tuple[Ros2Writer, Path]:
    return Ros2Writer(folder / path.name, version=_METADATA_VERSION), folder / path.name


_KINDS: dict[str, Callable[[Path, Path], tuple[Ros1Writer | Ros2Writer, Path]]] = {
    ".bag": _ros1,
    ".mcap": _mcap,
    ".db3": _sqlite_file,
    "": _sqlite_folder,
}


@cache
def _typestore(ros: Literal[1, 2]) -> Typestore:
    """The message types, one store for all bags, since ``rosbags`` compiles an encoder of each type in each store."""
    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    if ros == 1:  # the Noetic store of rosbags lacks it
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n", TF_MESSAGE))
    return store

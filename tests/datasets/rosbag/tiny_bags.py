# SPDX-License-Identifier: BSD-3-Clause
"""Bags written message by message with the writers of rosbags, independent of this package's writer."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

START_NS = 1_700_000_000_123_456_789
STEP_NS = 10_000_000
KINDS = ("walk.bag", "walk.mcap", "walk.db3", "walk")
JOINTS = ("left_hip_joint", "left_knee_joint", "right_hip_joint", "right_knee_joint")


@cache
def _typestore(*, is_ros1: bool) -> Typestore:
    """The message types, one store for all bags: it compiles the code of each type once."""
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    if is_ros1:
        transforms = "geometry_msgs/TransformStamped[] transforms\n"
        store.register(get_types_from_msg(transforms, "tf2_msgs/msg/TFMessage"))
    return store


class TinyBag:
    """Messages for one bag; other fields are zero, a dotted name such as ``header.frame_id`` sets an inner field."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.is_ros1 = path.suffix == ".bag"
        self.store = _typestore(is_ros1=self.is_ros1)
        self._messages: list[tuple[str, int, Any]] = []

    def make(self, msgtype: str, stamp_ns: int = 0, **fields: Any) -> Any:
        message = self._blank(msgtype)
        if hasattr(message, "header"):
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
        for name, value in fields.items():
            owner, *inner = [message, *name.split("__")]
            for part in inner[:-1]:
                owner = getattr(owner, part)
            last = inner[-1] if hasattr(owner, inner[-1]) else inner[-1].upper()
            setattr(owner, last, np.array(value, dtype=np.float64) if isinstance(value, tuple) else value)
        return message

    def add(self, topic: str, msgtype: str, stamp_ns: int, *, received_ns: int | None = None, **fields: Any) -> None:
        message = self.make(msgtype, stamp_ns, **fields)
        self._messages.append((topic, stamp_ns if received_ns is None else received_ns, message))

    def add_joints(self, stamp_ns, names=JOINTS, topic="/joint_states", received_ns=None, **fields):
        """Angles 0.1, 0.2, ... by the joints' index in ``JOINTS``; velocity and torque on request."""
        fields.setdefault("position", tuple(angle_of(name) for name in names))
        self.add(topic, "sensor_msgs/msg/JointState", stamp_ns, received_ns=received_ns, name=list(names), **fields)

    def add_imu(self, stamp_ns, topic="/imu", rate_x=0.5, received_ns=None, **fields):
        self.add(
            topic,
            "sensor_msgs/msg/Imu",
            stamp_ns,
            received_ns=received_ns,
            angular_velocity__x=rate_x,
            linear_acceleration__z=9.81,
            **fields,
        )

    def add_image(self, stamp_ns, topic, pixels, encoding="mono8", **fields):
        rows, columns = pixels.shape[:2]
        data = np.ascontiguousarray(pixels).view(np.uint8).ravel()
        step = data.size // rows
        fields = {"height": rows, "width": columns, "encoding": encoding, "step": step, "data": data} | fields
        self.add(topic, "sensor_msgs/msg/Image", stamp_ns, **fields)

    @property
    def last_message(self) -> Any:
        return self._messages[-1][2]

    def received_last(self, received_ns: int) -> None:
        """Set the time of arrival of the message added last."""
        topic, _, message = self._messages[-1]
        self._messages[-1] = (topic, received_ns, message)

    def transform(self, parent, child, xyz, quat_xyzw=(0.0, 0.0, 0.0, 1.0), stamp_ns=START_NS):
        message = self.make("geometry_msgs/msg/TransformStamped", stamp_ns, header__frame_id=parent)
        message.child_frame_id = child
        place(message.transform.translation, message.transform.rotation, xyz, quat_xyzw)
        return message

    def add_tf(self, *transforms):
        message = self.make("tf2_msgs/msg/TFMessage")
        message.transforms = list(transforms)
        self._messages.append(("/tf_static", START_NS, message))

    def write(self, **options: Any) -> Path:
        """Write in the order of adding; ``chunk`` bytes for ROS 1, ``compress`` for MCAP."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if self.is_ros1:
            self._write_ros1(**options)
        else:
            self._write_ros2(**options)
        return self.path

    def _write_ros1(self, chunk: int | None = None, compression: str | None = None) -> None:
        writer = Ros1Writer(self.path)
        if compression is not None:
            writer.set_compression(Ros1Writer.CompressionFormat[compression])
        if chunk is not None:
            writer.chunk_threshold = chunk
        with writer:
            self._write_to(writer, self.store.serialize_ros1)

    def _write_ros2(self, compress: bool = False) -> None:
        plugin = StoragePlugin.MCAP if self.path.suffix == ".mcap" else StoragePlugin.SQLITE3
        folder = self.path if self.path.suffix == "" else self.path.with_name("written") / self.path.stem
        folder.parent.mkdir(exist_ok=True)
        writer = Ros2Writer(folder, version=9, storage_plugin=plugin)
        if compress:
            writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            self._write_to(writer, self.store.serialize_cdr)
        if folder != self.path:
            (folder / self.path.name).rename(self.path)

    def _write_to(self, writer: Any, serialize: Any) -> None:
        connections: dict[str, Any] = {}
        for topic, received_ns, message in self._messages:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=self.store)
            writer.write(connections[topic], received_ns, serialize(message, kind))

    def _blank(self, msgtype: str) -> Any:
        _, fields = self.store.fielddefs[msgtype]
        return self.store.types[msgtype](**{name: self._zero(*kind) for name, kind in fields})

    def _zero(self, node: Nodetype, of: Any) -> Any:
        if node == Nodetype.BASE:
            return {"string": "", "bool": False}.get(of[0], 0.0 if "float" in of[0] else 0)
        if node == Nodetype.NAME:
            return self._blank(of)
        (inner, base), length = of
        if inner == Nodetype.BASE and base[0] != "string":
            return np.zeros(length if node == Nodetype.ARRAY else 0, dtype=base[0])
        return []


def place(translation: Any, rotation: Any, xyz: Any, quat_xyzw: Any) -> None:
    """Set a position and a quaternion of a message."""
    translation.x, translation.y, translation.z = xyz
    rotation.x, rotation.y, rotation.z, rotation.w = quat_xyzw


def angle_of(joint: str) -> float:
    """The angle that ``TinyBag.add_joints`` writes for a joint."""
    return 0.1 * (1 + JOINTS.index(joint)) if joint in JOINTS else 9.0

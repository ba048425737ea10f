# SPDX-License-Identifier: BSD-3-Clause
"""A first look into a bag: one message of every topic that may play a role, before any is chosen."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from coclo_vio.datasets.rosbag.storage.bag_file import BagFile
from coclo_vio.values.errors import DatasetError, listing
from coclo_vio.values.units import NS_PER_S

JOINT_STATE = "sensor_msgs/msg/JointState"
IMU = "sensor_msgs/msg/Imu"
IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
TRANSFORM = "geometry_msgs/msg/TransformStamped"
POSE = "geometry_msgs/msg/PoseStamped"
POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
WRENCH = "geometry_msgs/msg/WrenchStamped"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")

_DECODED = frozenset({JOINT_STATE, IMU, CAMERA_INFO, TRANSFORM, POSE, POSE_WITH_COVARIANCE, ODOMETRY, WRENCH})
_LOOKS = {IMU: 100, JOINT_STATE: 50}  # an IMU's rate, and joints that come in parts, take several messages


@dataclass(frozen=True, slots=True)
class Glance:
    """What a bag holds at first sight.

    Attributes:
        types: the type of every topic that has messages, as the configuration takes it.
        counts: how many messages it has.
        first: the first message of every topic of a type that is read, images left out.
        stamps_ns: header stamps at the beginning of every IMU topic.
        entries: the names at the beginning of every JointState topic, in the order of their appearance.
        entries_with_velocity: those of them that came with a velocity.
    """

    types: Mapping[str, str]
    counts: Mapping[str, int]
    first: Mapping[str, Any]
    stamps_ns: Mapping[str, tuple[int, ...]]
    entries: Mapping[str, tuple[str, ...]]
    entries_with_velocity: Mapping[str, frozenset[str]]

    def of_type(self, *msgtypes: str) -> tuple[str, ...]:
        """The topics of these types, by name."""
        return tuple(topic for topic, msgtype in self.types.items() if msgtype in msgtypes)

    def frame(self, topic: str) -> str:
        """``frame_id`` of the topic's first message, without a leading slash; empty where there is none."""
        message = self.first.get(topic)
        return "" if message is None else str(message.header.frame_id).lstrip("/")

    def rate_hz(self, topic: str) -> float | None:
        """The median rate at the beginning of an IMU topic, or None where it cannot be told."""
        stamps_ns = self.stamps_ns.get(topic, ())
        if len(stamps_ns) < 3:
            return None
        period_ns = float(np.median(np.diff(stamps_ns)))
        return NS_PER_S / period_ns if period_ns > 0 else None


def glance_at(bag: BagFile, types: Mapping[str, str], joint_entries: Sequence[str] = ()) -> Glance:
    """Read a bag until some messages of each topic have come by.

    Args:
        bag: the bag.
        types: the type to take a topic for, where it is not the one that the bag names.
        joint_entries: names of the entries of a JointState that carries none.

    Raises:
        DatasetError: no message at all, or one that does not fit its type.
    """
    is_counted = bag.damage is None and any(topic.count for topic in bag.topics.values())
    there = {
        name: types.get(name, topic.msgtype) for name, topic in bag.topics.items() if topic.count or not is_counted
    }
    if not there:
        raise DatasetError(f"{bag.path} holds no message; its topics are: {listing(bag.topics)}")
    first: dict[str, Any] = {}
    stamps_ns: defaultdict[str, list[int]] = defaultdict(list)
    joints: defaultdict[str, _Entries] = defaultdict(_Entries)
    wanted = {name: _LOOKS.get(msgtype, 1) for name, msgtype in there.items() if msgtype in _DECODED}
    for topic, _, data in bag.messages(set(wanted)):
        if topic not in wanted:
            continue
        if topic not in first or there[topic] == JOINT_STATE:
            message = bag.readable(topic, data)
            if message is None:
                continue
            first.setdefault(topic, message)
            if there[topic] == JOINT_STATE:
                joints[topic].add(message, joint_entries)
        if there[topic] == IMU:
            stamps_ns[topic].append(bag.header_stamp_ns(topic, data))
        wanted[topic] -= 1
        if wanted[topic] == 0:
            del wanted[topic]
            if not wanted:
                break
    return Glance(
        there,
        {name: topic.count for name, topic in bag.topics.items()},
        first,
        {name: tuple(stamps) for name, stamps in stamps_ns.items()},
        {name: tuple(entries.names) for name, entries in joints.items()},
        {name: frozenset(entries.with_velocity) for name, entries in joints.items()},
    )


@dataclass(slots=True)
class _Entries:
    """The names seen in JointState messages, and which of them came with a velocity."""

    names: dict[str, None] = field(default_factory=dict)
    with_velocity: set[str] = field(default_factory=set)

    def add(self, message: Any, joint_entries: Sequence[str]) -> None:
        names = message.name or joint_entries
        self.names.update(dict.fromkeys(names))
        self.with_velocity.update(names[: len(message.velocity)])

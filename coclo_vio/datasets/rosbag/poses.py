# SPDX-License-Identifier: BSD-3-Clause
"""Poses in a bag: static transforms between named frames (REP 105), and the body's poses from a tracking system."""

import math
from collections import deque
from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from coclo_vio.datasets.ground_truth import without_lost
from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.datasets.rosbag.config import RosbagConfig
from coclo_vio.datasets.rosbag.storage.message_set import MessageSet
from coclo_vio.datasets.rosbag.timing import BagClock
from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array, is_finite
from coclo_vio.values.errors import DatasetError, TimestampError, shortened
from coclo_vio.values.trajectory import GroundTruth, Trajectory

_BODY_FRAMES = ("base_link", "base", "trunk", "body", "torso", "pelvis", "base_footprint")
_SHORTEST_QUATERNION, _LONGEST_QUATERNION = 0.5, 2.0
_FARTHEST_M = 1e9


class FrameTree:
    """Static transforms between frames, and chains of them."""

    def __init__(self, transforms: Iterable[Any] = ()) -> None:
        """Build the tree from TransformStamped messages; those without a rotation are left out."""
        self._T: dict[str, dict[str, Array]] = {}
        for transform in transforms:
            parent, child = str(transform.header.frame_id).lstrip("/"), str(transform.child_frame_id).lstrip("/")
            T_parent_child = pose_of(transform.transform.translation, transform.transform.rotation)
            if T_parent_child is not None:
                self._T.setdefault(parent, {})[child] = T_parent_child
                self._T.setdefault(child, {})[parent] = se3.inverse(T_parent_child)

    @property
    def frames(self) -> tuple[str, ...]:
        """All known frames."""
        return tuple(self._T)

    def body(self, *names: str | None) -> str:
        """The body's frame: the first of ``names`` that is not None, otherwise the first usual name in the tree."""
        named = next((name for name in names if name), None)
        return named or next((name for name in _BODY_FRAMES if name in self._T), _BODY_FRAMES[0])

    def between(self, a: str, b: str) -> Array | None:
        """``T_a_b`` (4, 4) along the chain between two frames, or None."""
        if a == b:
            return np.eye(4)
        reached = {a: np.eye(4)}
        frontier = deque([a])
        while frontier:
            frame = frontier.popleft()
            for neighbour, T_frame_neighbour in self._T.get(frame, {}).items():
                if neighbour not in reached:
                    reached[neighbour] = reached[frame] @ T_frame_neighbour
                    frontier.append(neighbour)
        return reached.get(b)


def read_frames(bag: MessageSet, topic: str) -> FrameTree:
    """The static transforms on a TFMessage topic, read to the end of the bag; an empty tree without that topic.

    Raises:
        DatasetError: the topic holds another type.
    """
    if topic not in bag.topics:
        return FrameTree()
    messages = (bag.readable(topic, data) for _, _, data in bag.messages([topic]))
    try:
        return FrameTree(transform for message in messages for transform in getattr(message, "transforms", ()))
    except (AttributeError, TypeError) as error:
        raise DatasetError(
            f"{bag.origin}: the messages on {topic} are no TFMessage ({shortened(error)}); name the topic of the "
            "static transforms in dataset.rosbag.topics.tf_static"
        ) from error


def pose_of(position: Any, orientation: Any) -> Array | None:
    """The transform (4, 4) of ROS's position and quaternion; None without a finite rotation."""
    numbers = _numbers_of(position, orientation)
    return None if numbers is None else se3.transform(so3.from_quat_xyzw(numbers[3:]), numbers[:3])


def _numbers_of(position: Any, orientation: Any) -> Array | None:
    """[position, quaternion xyzw] (7,); None without a rotation, or with a position that is none on earth."""
    quat_xyzw = (orientation.x, orientation.y, orientation.z, orientation.w)
    numbers = np.array([position.x, position.y, position.z, *quat_xyzw])
    if not is_finite(numbers) or not _SHORTEST_QUATERNION < math.hypot(*quat_xyzw) < _LONGEST_QUATERNION:
        return None
    if max(abs(position.x), abs(position.y), abs(position.z)) > _FARTHEST_M:
        return None
    return numbers


def read_truth(bag: MessageSet, topic: str, config: RosbagConfig, clock: BagClock, tally: ReadTally) -> GroundTruth:
    """The body's poses from those of the tracked object on ``topic`` (TransformStamped, PoseStamped, Odometry).

    ``T_world_body = T_world_object @ T_object_body``, where ``T_body_object`` is configured.

    Raises:
        TimestampError: no complete pose.
        DatasetError: a message without a pose.
    """
    stamps_ns: list[int] = []
    poses: list[Array] = []  # [position, quaternion xyzw]
    for message in bag.messages([topic]):
        stamp_ns = clock.stamp_ns(message)
        if stamp_ns is None:
            continue
        decoded = bag.readable(topic, message.data)
        pose = None if decoded is None else _pose_in(decoded, topic)
        if pose is None:
            tally.dropped["ground truth: pose empty or NaN"] += 1
        elif stamps_ns and stamp_ns <= stamps_ns[-1]:
            tally.dropped["ground truth: stamp repeated or out of order"] += 1
        else:
            stamps_ns.append(stamp_ns)
            poses.append(pose)
    if not poses:
        raise TimestampError(
            f"{bag.origin} holds no complete pose on {topic}; name another topic, or '' for none, in "
            "dataset.rosbag.topics.ground_truth"
        )
    T_body_object = _mounting(config)
    numbers = np.array(poses)
    T_world_object = se3.transform(so3.from_quat_xyzw(numbers[:, 3:]), numbers[:, :3])
    trajectory = without_lost(Trajectory(np.array(stamps_ns, dtype=np.int64), T_world_object), tally)
    if not np.array_equal(T_body_object, np.eye(4)):
        trajectory = Trajectory(trajectory.stamps_ns, trajectory.T_world_body @ se3.inverse(T_body_object))
    return GroundTruth(trajectory, has_stamps=True, source=topic)


def _pose_in(message: Any, topic: str) -> Array | None:
    """[position, quaternion xyzw] (7,); None where they are not finite or no rotation (the tracker lost the object)."""
    try:
        if hasattr(message, "transform"):
            return _numbers_of(message.transform.translation, message.transform.rotation)
        pose = getattr(message.pose, "pose", message.pose)
        return _numbers_of(pose.position, pose.orientation)
    except (AttributeError, TypeError) as error:
        raise DatasetError(
            f"a message on {topic} holds no pose; the types that are read are TransformStamped, PoseStamped, "
            "PoseWithCovarianceStamped and Odometry"
        ) from error


def _mounting(config: RosbagConfig) -> Array:
    """``T_body_object``, (4, 4)."""
    rotation = Rotation.from_euler("xyz", config.rotation_body_object_rpy_rad).as_matrix()
    return se3.transform(rotation, np.array(config.object_position_body_m))

# SPDX-License-Identifier: BSD-3-Clause
"""Ground truth in a bag: poses of a tracked object on the body, as Vicon and its like publish them."""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from coclo_vio.arrays import Array
from coclo_vio.datasets.report import ReadTally
from coclo_vio.datasets.rosbag.clock import BagClock
from coclo_vio.datasets.rosbag.config import RosbagConfig
from coclo_vio.datasets.rosbag.frames import pose_of
from coclo_vio.datasets.rosbag.storage.bag_file import BagFile
from coclo_vio.errors import DatasetError, TimestampError
from coclo_vio.geometry import se3
from coclo_vio.trajectory import GroundTruth, Trajectory


def read_truth(bag: BagFile, topic: str, config: RosbagConfig, clock: BagClock, tally: ReadTally) -> GroundTruth:
    """The body's poses from those of the object on ``topic`` (TransformStamped, PoseStamped, Odometry).

    ``T_world_body = T_world_object @ T_object_body``, the object mounted as the configuration says.

    Raises:
        TimestampError: no pose with a stamp of its own.
        DatasetError: a message that holds no pose.
    """
    stamps_ns: list[int] = []
    poses: list[Array] = []
    for message in bag.messages([topic]):
        stamp_ns = clock.stamp_ns(message)
        if stamp_ns is None:
            continue
        decoded = bag.readable(topic, message.data)
        pose = None if decoded is None else _pose_in(decoded, topic)
        if pose is None:
            tally.dropped["ground truth: empty or NaN"] += 1
        elif stamps_ns and stamp_ns <= stamps_ns[-1]:
            tally.dropped["ground truth: stamp repeated or out of order"] += 1
        else:
            stamps_ns.append(stamp_ns)
            poses.append(pose)
    if not poses:
        raise TimestampError(
            f"{bag.path} holds no complete pose on {topic}; choose another, or '' for none, in "
            "dataset.rosbag.topics.ground_truth"
        )
    T_body_object = _mounting(config)
    T_world_body = np.array(poses)
    if not np.array_equal(T_body_object, np.eye(4)):
        T_world_body = T_world_body @ se3.inverse(T_body_object)
    return GroundTruth(Trajectory(np.array(stamps_ns, dtype=np.int64), T_world_body), has_stamps=True, source=topic)


def _pose_in(message: Any, topic: str) -> Array | None:
    """The pose (4, 4), or None where it is not finite or has no rotation (an object that was lost)."""
    if hasattr(message, "transform"):
        return pose_of(message.transform.translation, message.transform.rotation)
    pose = getattr(message, "pose", None)
    pose = getattr(pose, "pose", pose)
    if pose is None or not hasattr(pose, "orientation"):
        raise DatasetError(
            f"a message on {topic} holds no pose; TransformStamped, PoseStamped, PoseWithCovarianceStamped and "
            "Odometry are read"
        )
    return pose_of(pose.position, pose.orientation)


def _mounting(config: RosbagConfig) -> Array:
    """``T_body_object``, (4, 4)."""
    rotation = Rotation.from_euler("xyz", config.rotation_body_object_rpy_rad).as_matrix()
    return se3.transform(rotation, np.array(config.object_position_body_m))

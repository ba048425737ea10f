# SPDX-License-Identifier: BSD-3-Clause
"""Estimated trajectories as a rosbag for Foxglove and RViz: odometry, paths and transforms, in REP 105's frames.

=============================== ============= =========================================================================
``/<estimator>/odometry``       Odometry      pose of the body in ``odom``, twist in ``base_link``
``/<estimator>/path``           Path          the same, thinned, in one message at the start
``/ground_truth/path``          Path          the reference in ``map``
``/tf``                         TFMessage     ``odom`` to ``base_link``, ``map`` to ``ground_truth``
``/tf_static``                  TFMessage     ``map`` to ``odom``: alignment of the estimate with the reference
=============================== ============= =========================================================================

REP 105 allows a frame one parent, so of several estimators the first has ``odom`` and ``base_link``, a further one
``<estimator>/odom`` and ``<estimator>/base_link``.
"""

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from coclo_vio.datasets.rosbag.writing.messages import BagMessages
from coclo_vio.datasets.rosbag.writing.new_bag import new_bag
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.trajectory import Trajectory

MAP_FRAME = "map"
ODOM_FRAME = "odom"
BODY_FRAME = "base_link"
TRUTH_FRAME = "ground_truth"

_UNKNOWN = np.zeros((6, 6))
_PATH_STEP_NS = 100_000_000

Message = tuple[int, str, Any]  # stamp in ns, topic, message


@dataclass(frozen=True, slots=True, eq=False)
class EstimatedTrajectory:
    """The trajectory of one estimator.

    Attributes:
        name: name of the estimator.
        trajectory: poses of the body in the estimator's world (``odom``).
        angular_velocity_body: rad/s, body axes, (N, 3), or None where unknown.
        T_map_odom: maps the estimator's world to that of the reference, (4, 4).
    """

    name: str
    trajectory: Trajectory
    angular_velocity_body: Array | None
    T_map_odom: Array


def write_result_bag(path: Path, estimates: Sequence[EstimatedTrajectory], reference: Trajectory | None = None) -> Path:
    """Write estimated trajectories, and the reference they are compared with, as a bag.

    Args:
        path: as ``write_bag`` takes it: ``.bag``, ``.mcap``, ``.db3`` or no suffix.
        estimates: one for each estimator, at least one.
        reference: the ground truth on the estimators' clock, in ``map``.

    Returns:
        ``path``.

    Raises:
        DatasetError: no estimate; or the path exists, has another suffix or cannot be written.
        TimestampError: a stamp that ROS cannot hold.
    """
    if not estimates:
        raise DatasetError(f"there is no estimate to write to {path}; run an estimator first")
    with new_bag(path) as bag:
        make = BagMessages(bag)
        trajectories = [estimate.trajectory for estimate in estimates] + ([] if reference is None else [reference])
        first_ns = min(int(trajectory.stamps_ns[0]) for trajectory in trajectories)
        named = [
            (estimate, *frames_of(estimate.name, is_first=number == 0)) for number, estimate in enumerate(estimates)
        ]
        alignments = [make.transform(first_ns, MAP_FRAME, odom, estimate.T_map_odom) for estimate, odom, _ in named]
        bag.write("/tf_static", first_ns, make.tf(alignments), is_latched=True)
        for estimate, odom, _ in named:
            message = make.path(first_ns, odom, _thinned(estimate.trajectory))
            bag.write(f"/{estimate.name}/path", first_ns, message, is_latched=True)
        streams = [_of_estimate(make, estimate, odom, body) for estimate, odom, body in named]
        if reference is not None:
            message = make.path(first_ns, MAP_FRAME, _thinned(reference))
            bag.write("/ground_truth/path", first_ns, message, is_latched=True)
            streams.append(_of_reference(make, reference))
        for stamp_ns, topic, message in heapq.merge(*streams, key=lambda item: item[0]):
            bag.write(topic, stamp_ns, message)
    return path


def ros_pose_covariance(covariance: Array, R_odom_body: Array) -> Array:
    """ROS's pose covariance (6, 6), of [position m, rotation rad] in odom axes, from a right/local one.

    ``T = T_mean exp([phi, rho])`` moves the origin by ``R rho`` and turns the body by ``exp(R phi)`` from the left (to
    first order), which are the error of position and the turn about fixed axes that
    ``geometry_msgs/PoseWithCovariance`` holds. So ``C_ros = J C J^T`` with ``J = [[0, R], [R, 0]]``.

    Args:
        covariance: of the error [rotation rad, position m], right/local, (6, 6).
        R_odom_body: maps body axes to odom, (3, 3).
    """
    J = np.zeros((6, 6))
    J[:3, 3:] = J[3:, :3] = R_odom_body
    return np.asarray(J @ covariance @ J.T)


def frames_of(name: str, *, is_first: bool, odom: str = ODOM_FRAME, body: str = BODY_FRAME) -> tuple[str, str]:
    """The frames of an estimator's world and of its body: REP 105 allows a frame one parent."""
    return (odom, body) if is_first else (f"{name}/{odom}", f"{name}/{body}")


def _thinned(trajectory: Trajectory) -> Iterator[tuple[int, Array]]:
    """Poses a tenth of a second or more apart, the first and the last among them."""
    stamps_ns = trajectory.stamps_ns.tolist()
    last_ns = stamps_ns[0] - _PATH_STEP_NS
    for number, (stamp_ns, pose) in enumerate(zip(stamps_ns, trajectory.T_world_body, strict=True)):
        if stamp_ns - last_ns >= _PATH_STEP_NS or number == len(stamps_ns) - 1:
            last_ns = stamp_ns
            yield stamp_ns, pose


def _of_estimate(make: BagMessages, estimate: EstimatedTrajectory, odom: str, body: str) -> Iterator[Message]:
    """Odometry and transform of every pose.

    The velocity's covariance is not in a run folder: all zeros, which is ROS's unknown.
    """
    trajectory = estimate.trajectory
    velocity_odom = np.zeros((len(trajectory), 3)) if trajectory.velocity_world is None else trajectory.velocity_world
    angular = (
        np.zeros((len(trajectory), 3)) if estimate.angular_velocity_body is None else estimate.angular_velocity_body
    )
    for row, (stamp_ns, pose) in enumerate(zip(trajectory.stamps_ns.tolist(), trajectory.T_world_body, strict=True)):
        R = pose[:3, :3]
        covariances = trajectory.covariance
        covariance = _UNKNOWN if covariances is None else ros_pose_covariance(covariances[row], R)
        twist = make.twist(R.T @ velocity_odom[row], angular[row])
        header = make.header(stamp_ns, odom)
        odometry = make.odometry(header, body, (make.pose(pose), covariance), (twist, _UNKNOWN))
        yield stamp_ns, f"/{estimate.name}/odometry", odometry
        yield stamp_ns, "/tf", make.tf([make.transform(stamp_ns, odom, body, pose)])


def _of_reference(make: BagMessages, reference: Trajectory) -> Iterator[Message]:
    for stamp_ns, pose in zip(reference.stamps_ns.tolist(), reference.T_world_body, strict=True):
        yield stamp_ns, "/tf", make.tf([make.transform(stamp_ns, MAP_FRAME, TRUTH_FRAME, pose)])

# SPDX-License-Identifier: BSD-3-Clause
"""Rigid transforms that align an estimate with its ground truth: pure functions, ``T_reference_estimate`` (4, 4).

All take two trajectories on the same stamps. An odometry starts at an arbitrary pose, so its world differs from
the ground truth's by a position and a heading; ``SE(3)`` alignment removes an error of the vertical too.
"""

from dataclasses import replace
from typing import Literal

import numpy as np

from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.trajectory import Trajectory

Alignment = Literal["yaw_position", "se3", "start", "none"]


def heading_error_rad(estimate: Trajectory, reference: Trajectory) -> Array:
    """What to turn the estimate by about z, rad in -pi..pi, (N,), to bring it nearest to the reference's attitude.

    With ``D = R_reference_body R_estimate_body^T`` it is the yaw of the largest ``trace(R_z^T D)``,
    ``atan2(D_yx - D_xy, D_xx + D_yy)``. No axis of the body enters, so a body whose x axis is vertical (EuRoC's IMU)
    has a heading error like any other.
    """
    turn = reference.rotations @ np.swapaxes(estimate.rotations, 1, 2)
    return np.arctan2(turn[:, 1, 0] - turn[:, 0, 1], turn[:, 0, 0] + turn[:, 1, 1])


def tie_start(estimate: Trajectory, reference: Trajectory, window_s: float) -> Array:
    """Position and yaw tied over the first ``window_s`` seconds, while the robot stands.

    The yaw is the circular mean of the heading differences, the position the difference of the means; where the
    robot already moves, the pairs still differ by a constant.
    """
    head = estimate.times_s <= window_s
    angles = heading_error_rad(estimate, reference)[head]
    rotation = so3.about_z(float(np.arctan2(np.sin(angles).mean(), np.cos(angles).mean())))
    translation = reference.positions[head].mean(axis=0) - rotation @ estimate.positions[head].mean(axis=0)
    return se3.transform(rotation, translation)


def tie_attitude(estimate: Trajectory, reference: Trajectory, window_s: float) -> Array:
    """Position and whole attitude tied over the first ``window_s`` seconds: where the estimate is not level."""
    head = estimate.times_s <= window_s
    turn = reference.rotations[head] @ np.swapaxes(estimate.rotations[head], 1, 2)
    rotation = nearest_rotation(turn.sum(axis=0))
    translation = reference.positions[head].mean(axis=0) - rotation @ estimate.positions[head].mean(axis=0)
    return se3.transform(rotation, translation)


def level_body(estimate: Trajectory, reference: Trajectory, window_s: float) -> Trajectory:
    """The reference with its body frame turned so that both bodies have the same tilt over the first seconds.

    Markers are seldom mounted square to the robot. The constant ``R_tracked_body`` is the mean of
    ``R_reference^T R_z R_estimate`` with the yaw ``R_z`` of ``tie_start``: positions and headings stay as they are.
    """
    head = estimate.times_s <= window_s
    turn = tie_start(estimate, reference, window_s)[:3, :3]
    mounting = np.swapaxes(reference.rotations[head], 1, 2) @ turn @ estimate.rotations[head]
    R_tracked_body = nearest_rotation(mounting.sum(axis=0))
    return replace(reference, T_world_body=reference.T_world_body @ se3.transform(R_tracked_body, np.zeros(3)))


def level_body_by_all(estimate: Trajectory, reference: Trajectory) -> Trajectory:
    """As ``level_body``, by all poses, each with its own heading: markers are as they are all the time.

    A tilt of the estimate that stays the same all the time is removed too.
    """
    turns = so3.exp(heading_error_rad(estimate, reference)[:, None] * np.array([0.0, 0.0, 1.0]))
    mounting = np.swapaxes(reference.rotations, 1, 2) @ turns @ estimate.rotations
    R_tracked_body = nearest_rotation(mounting.sum(axis=0))
    return replace(reference, T_world_body=reference.T_world_body @ se3.transform(R_tracked_body, np.zeros(3)))


def align_yaw_position(estimate: Trajectory, reference: Trajectory) -> Array:
    """Position and yaw of least squared distance between positions.

    With centred positions e and r the yaw is ``atan2(sum(e_x r_y - e_y r_x), sum(e_x r_x + e_y r_y))`` (Zhang,
    Scaramuzza, "A tutorial on quantitative trajectory evaluation", 2018, section IV). Without motion in the plane
    no yaw is better than another: zero.
    """
    centre_e, centre_r = estimate.positions.mean(axis=0), reference.positions.mean(axis=0)
    e, r = estimate.positions - centre_e, reference.positions - centre_r
    sine = float((e[:, 0] * r[:, 1] - e[:, 1] * r[:, 0]).sum())
    cosine = float((e[:, :2] * r[:, :2]).sum())
    rotation = so3.about_z(float(np.arctan2(sine, cosine)))
    return se3.transform(rotation, centre_r - rotation @ centre_e)


def align_se3(estimate: Trajectory, reference: Trajectory) -> Array:
    """Position and rotation of least squared distance between positions, no scale (Umeyama, 1991, eq. 40 to 42)."""
    centre_e, centre_r = estimate.positions.mean(axis=0), reference.positions.mean(axis=0)
    covariance = (reference.positions - centre_r).T @ (estimate.positions - centre_e)
    rotation = nearest_rotation(covariance)
    return se3.transform(rotation, centre_r - rotation @ centre_e)


def nearest_rotation(matrix: Array) -> Array:
    """The rotation R (3, 3) with the largest ``trace(R^T matrix)`` (Kabsch, Umeyama)."""
    left, _, right = np.linalg.svd(matrix)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left) * np.linalg.det(right))])
    rotation: Array = left @ (signs[:, None] * right)
    return rotation


def align(kind: Alignment, estimate: Trajectory, reference: Trajectory, start_window_s: float) -> Array:
    """``T_reference_estimate`` of an alignment."""
    match kind:
        case "yaw_position":
            return align_yaw_position(estimate, reference)
        case "se3":
            return align_se3(estimate, reference)
        case "start":
            return tie_start(estimate, reference, start_window_s)
        case "none":
            return np.eye(4)

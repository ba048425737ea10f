# SPDX-License-Identifier: BSD-3-Clause
"""The remembered poses of anchor, keyframe and frame: what the filter knows of them, and evidence on them.

The poses are part of the state, so that late evidence on them corrects the present through their correlations, and
the uncertainty that two of them share (yaw, position, tilt at the anchor) drops out. Source: Roumeliotis and Burdick,
"Stochastic cloning", 2002. Poses are expressed relative to the anchor and as the cameras measure them: with the
estimated errors of their mounting and of their stereo scale.
"""

from dataclasses import dataclass

import numpy as np

from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.state import State
from coclo_vio.filter.state_blocks import ANCHOR, FRAME, KEYFRAME
from coclo_vio.filter.unscented_transform import Correction, correct
from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.keyframes import PoseEvidence, PosePair


def frame_pose(mean: State) -> Array:
    """``T_world_body`` at the stamp of the frame, (4, 4)."""
    return mean.remembered_pose(FRAME)


def anchor_pose(mean: State) -> Array:
    """``T_world_anchor``, (4, 4)."""
    return mean.remembered_pose(ANCHOR)


def frame_pair(core: SquareRootFilter, start_ns: int, end_ns: int) -> PosePair:
    """The poses of keyframe and frame relative to the anchor, as the cameras measure them."""
    T_anchor_start, T_anchor_end, jacobian = _pair(core.mean)
    rows = jacobian @ core.factor
    return PosePair(start_ns, end_ns, T_anchor_start, T_anchor_end, rows @ rows.T)


def in_world(core: SquareRootFilter, T_anchor_measured: Array, covariance: Array) -> tuple[Array, Array]:
    """A pose that the cameras measure relative to the anchor, in the world.

    Args:
        core: the filter.
        T_anchor_measured: the pose as measured, (4, 4).
        covariance: of its right/local error, (6, 6).

    Returns:
        ``T_world_body``, (4, 4), and the covariance of its right/local error, (6, 6).
    """
    mean, layout = core.mean, core.mean.layout
    camera_at = layout.at("camera")
    camera = mean.vector[camera_at]
    T_anchor_body = as_true(T_anchor_measured, camera)
    _, by_pose, by_camera = as_measured(T_anchor_body, camera)
    back = np.asarray(np.linalg.inv(by_pose), dtype=np.float64)
    jacobian = se3.adjoint(se3.inverse(T_anchor_body)) @ _local(mean, ANCHOR)
    jacobian[:, camera_at] -= back @ by_camera
    rows = jacobian @ core.factor
    return anchor_pose(mean) @ T_anchor_body, rows @ rows.T + back @ covariance @ back.T


@dataclass(frozen=True, slots=True)
class Innovation:
    """How far evidence lies from what the filter predicts of it.

    Attributes:
        squared: normalised innovation squared, chi-square with ``rows`` degrees of freedom.
        rows: independent directions that the evidence determines.
    """

    squared: float
    rows: int


def correction_by(core: SquareRootFilter, evidence: PoseEvidence) -> tuple[Innovation, Correction | None]:
    """The correction by evidence on keyframe and frame, not yet applied; None where it determines nothing."""
    T_anchor_start, T_anchor_end, jacobian = _pair(core.mean)
    rows, measured = evidence.rows()
    if not len(rows):
        return Innovation(0.0, 0), None
    differences = [
        se3.log(se3.inverse(evidence.T_world_start) @ T_anchor_start),
        se3.log(se3.inverse(evidence.T_world_end) @ T_anchor_end),
    ]
    for part, twist in enumerate(differences):
        jacobian[6 * part : 6 * part + 6] = se3.right_jacobian_inverse(twist) @ jacobian[6 * part : 6 * part + 6]
    innovation = measured - rows @ np.concatenate(differences)
    correction = correct(core.factor, core.factor.T @ (rows @ jacobian).T, np.eye(len(rows)), innovation)
    return Innovation(correction.innovation_squared, len(rows)), correction


def _local(mean: State, name: str) -> Array:
    """d(right/local error) / d(errors of the filter) of a remembered pose, (6, L)."""
    rotation_at, position_at = mean.layout.rotation_of(name), mean.layout.position_of(name)
    R = mean.remembered_rotation(name)
    jacobian = np.zeros((6, mean.layout.dimension))
    jacobian[:3, rotation_at] = jacobian[3:, position_at] = R.T
    jacobian[3:, rotation_at] = -R.T @ so3.hat(mean.vector[position_at])
    return jacobian


def _pair(mean: State) -> tuple[Array, Array, Array]:
    """Poses of keyframe and frame from the anchor, (4, 4) each, and the Jacobian (12, L) of both local errors."""
    camera_at, T_world_anchor, of_anchor = mean.layout.at("camera"), anchor_pose(mean), _local(mean, ANCHOR)
    poses, jacobians = [], []
    for name in (KEYFRAME, FRAME):
        T_anchor_pose = se3.inverse(T_world_anchor) @ mean.remembered_pose(name)
        from_anchor = se3.adjoint(se3.inverse(T_anchor_pose)) @ of_anchor
        T_measured, by_pose, by_camera = as_measured(T_anchor_pose, mean.vector[camera_at])
        jacobian = by_pose @ (_local(mean, name) - from_anchor)
        jacobian[:, camera_at] += by_camera
        poses.append(T_measured)
        jacobians.append(jacobian)
    return poses[0], poses[1], np.concatenate(jacobians)


def as_true(T_measured: Array, camera: Array) -> Array:
    """The pose from the anchor, (4, 4), that cameras with these errors (4,) measure so; inverse of ``as_measured``."""
    E = se3.exp(np.concatenate((camera[:3], np.zeros(3))))
    T = np.array(T_measured)
    T[:3, 3] /= 1.0 + camera[3]
    return np.asarray(se3.inverse(E) @ T @ E)


def as_measured(T: Array, camera: Array) -> tuple[Array, Array, Array]:
    """A pose from the anchor as cameras measure it whose mounting and baseline differ from their calibration.

    ``E T E^-1`` with the rotation error ``E = exp(camera[:3])``, its translation scaled by ``1 + camera[3]``.

    Returns:
        The pose, (4, 4), the Jacobian of its right/local error by that of ``T``, (6, 6), and by the camera's errors,
        (6, 4).
    """
    E = se3.exp(np.concatenate((camera[:3], np.zeros(3))))
    measured = E @ T @ se3.inverse(E)
    by_camera = np.zeros((6, 4))
    by_camera[:, :3] = (se3.adjoint(se3.inverse(measured)) - np.eye(6))[:, :3] @ so3.right_jacobian(-camera[:3])
    by_camera[3:, 3] = measured[:3, :3].T @ measured[:3, 3] / (1.0 + camera[3])
    scale = np.repeat([1.0, 1.0 + camera[3]], 3)
    by_camera[:, :] *= scale[:, None]
    measured[:3, 3] *= 1.0 + camera[3]
    return measured, scale[:, None] * se3.adjoint(E), by_camera

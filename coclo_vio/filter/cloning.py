# SPDX-License-Identifier: BSD-3-Clause
"""Relative motion since the cloned keyframe pose, and what a late result says about that pose and about a frame's.

The clone is part of the state, so both have honest covariances: the uncertainty that pose and clone share (yaw,
position, tilt at the keyframe) drops out. Source: Roumeliotis and Burdick, "Stochastic cloning", 2002.
"""

from dataclasses import dataclass

import numpy as np

from coclo_vio.filter.core import SquareRootFilter
from coclo_vio.filter.square_root import Correction, correct
from coclo_vio.filter.state import POSITION, ROTATION, State
from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.keyframes import OdometryDelta, PoseEvidence, PosePair


def _clone_pose(mean: State) -> Array:
    return se3.transform(mean.clone_rotation, mean.vector[mean.layout.clone_position])


def delta_from_clone(core: SquareRootFilter, start_ns: int, end_ns: int) -> OdometryDelta:
    """``T_start_end`` from the cloned pose to the present one, with the covariance of its right/local error."""
    mean, layout = core.mean, core.mean.layout
    T_world_end = se3.transform(mean.rotation, mean.vector[POSITION])
    to_end = mean.rotation.T
    jacobian = np.zeros((6, layout.dimension))
    jacobian[:3, ROTATION] = to_end
    jacobian[:3, layout.clone_rotation] = -to_end
    jacobian[3:, POSITION] = to_end
    jacobian[3:, layout.clone_position] = -to_end
    jacobian[3:, ROTATION] = -to_end @ so3.hat(mean.vector[POSITION])
    jacobian[3:, layout.clone_rotation] = -jacobian[3:, ROTATION]
    rows = jacobian @ core.factor
    return OdometryDelta(start_ns, end_ns, se3.inverse(_clone_pose(mean)) @ T_world_end, rows @ rows.T)


def correct_clone(core: SquareRootFilter, T_world_clone: Array, covariance: Array) -> Correction:
    """Take a pose measured at the time of the clone; the present state follows through their correlation.

    Args:
        core: the filter.
        T_world_clone: the pose, (4, 4).
        covariance: of its right/local error [rotation rad, position m], (6, 6), positive definite.
    """
    mean, layout = core.mean, core.mean.layout
    to_clone = mean.clone_rotation.T
    jacobian = np.zeros((6, layout.dimension))
    jacobian[:3, layout.clone_rotation] = to_clone
    jacobian[3:, layout.clone_position] = to_clone
    jacobian[3:, layout.clone_rotation] = -to_clone @ so3.hat(mean.vector[layout.clone_position])
    innovation = se3.log(se3.inverse(_clone_pose(mean)) @ T_world_clone)
    noise_rows: Array = np.asarray(np.linalg.cholesky(covariance).T, dtype=np.float64)
    return core.update(core.factor.T @ jacobian.T, noise_rows, innovation)


def _local(mean: State, rotation_at: slice, position_at: slice, R: Array) -> Array:
    """d(right/local error) / d(errors of the filter) of a cloned pose, (6, L)."""
    jacobian = np.zeros((6, mean.layout.dimension))
    jacobian[:3, rotation_at] = jacobian[3:, position_at] = R.T
    jacobian[3:, rotation_at] = -R.T @ so3.hat(mean.vector[position_at])
    return jacobian


def _pair(mean: State) -> tuple[Array, Array, Array]:
    """Keyframe's and frame's pose from the anchor, (4, 4) each, and the Jacobian (12, L) of both local errors."""
    layout = mean.layout
    T_world_anchor = anchor_pose(mean)
    of_anchor = _local(mean, layout.anchor_rotation, layout.anchor_position, mean.anchor_rotation)
    poses, jacobians = [], []
    for rotation_at, position_at, rotation in (
        (layout.clone_rotation, layout.clone_position, mean.clone_rotation),
        (layout.frame_rotation, layout.frame_position, mean.frame_rotation),
    ):
        T_anchor_pose = se3.inverse(T_world_anchor) @ se3.transform(rotation, mean.vector[position_at])
        from_anchor = se3.adjoint(se3.inverse(T_anchor_pose)) @ of_anchor
        T_seen, of_pose, of_eyes = _as_seen(T_anchor_pose, mean.vector[layout.eyes])
        jacobian = of_pose @ (_local(mean, rotation_at, position_at, rotation) - from_anchor)
        jacobian[:, layout.eyes] += of_eyes
        poses.append(T_seen)
        jacobians.append(jacobian)
    return poses[0], poses[1], np.concatenate(jacobians)


def anchor_pose(mean: State) -> Array:
    """``T_world_anchor``, (4, 4)."""
    return se3.transform(mean.anchor_rotation, mean.vector[mean.layout.anchor_position])


def _as_seen(T: Array, eyes: Array) -> tuple[Array, Array, Array]:
    """A pose from the anchor as eyes see it that are mounted otherwise and have another base line than is known.

    ``E T E^-1`` of cameras that are turned by ``E = exp(turn)``, its translation stretched by ``1 + stretch``.

    Returns:
        The pose, (4, 4), the Jacobian of its right/local error by that of ``T``, (6, 6), and by errors of eyes, (6, 4).
    """
    E = se3.exp(np.concatenate((eyes[:3], np.zeros(3))))
    seen = E @ T @ se3.inverse(E)
    of_eyes = np.zeros((6, 4))
    of_eyes[:, :3] = (se3.adjoint(se3.inverse(seen)) - np.eye(6))[:, :3] @ so3.right_jacobian(-eyes[:3])
    of_eyes[3:, 3] = seen[:3, :3].T @ seen[:3, 3] / (1.0 + eyes[3])
    stretch = np.repeat([1.0, 1.0 + eyes[3]], 3)
    of_eyes[:, :] *= stretch[:, None]
    seen[:3, 3] *= 1.0 + eyes[3]
    return seen, stretch[:, None] * se3.adjoint(E), of_eyes


def placed(core: SquareRootFilter, T_anchor_seen: Array, covariance: Array) -> tuple[Array, Array]:
    """A pose that eyes see from the anchor, in the world, and the covariance of its right/local error.

    Args:
        core: the filter.
        T_anchor_seen: the pose as it is seen, (4, 4).
        covariance: of its right/local error, (6, 6).
    """
    mean, layout = core.mean, core.mean.layout
    eyes = mean.vector[layout.eyes]
    E = se3.exp(np.concatenate((eyes[:3], np.zeros(3))))
    T_anchor_body = np.array(T_anchor_seen)
    T_anchor_body[:3, 3] /= 1.0 + eyes[3]
    T_anchor_body = se3.inverse(E) @ T_anchor_body @ E
    _, of_pose, of_eyes = _as_seen(T_anchor_body, eyes)
    back = np.asarray(np.linalg.inv(of_pose), dtype=np.float64)
    jacobian = se3.adjoint(se3.inverse(T_anchor_body)) @ _local(
        mean, layout.anchor_rotation, layout.anchor_position, mean.anchor_rotation
    )
    jacobian[:, layout.eyes] -= back @ of_eyes
    rows = jacobian @ core.factor
    return anchor_pose(mean) @ T_anchor_body, rows @ rows.T + back @ covariance @ back.T


def frame_pair(core: SquareRootFilter, start_ns: int, end_ns: int) -> PosePair:
    """The poses of the keyframe (the clone) and of the frame from the anchor, as eyes should see them."""
    T_anchor_start, T_anchor_end, jacobian = _pair(core.mean)
    rows = jacobian @ core.factor
    return PosePair(start_ns, end_ns, T_anchor_start, T_anchor_end, rows @ rows.T)


@dataclass(frozen=True, slots=True, eq=False)
class Surprise:
    """How far evidence is from what the filter believes.

    Attributes:
        squared: normalised innovation squared, chi-square with ``rows`` degrees of freedom.
        rows: how many independent things the evidence says.
    """

    squared: float
    rows: int


def weigh(core: SquareRootFilter, evidence: PoseEvidence) -> tuple[Surprise, Correction | None]:
    """What evidence on keyframe and frame would do to the filter, which stays as it is; None if it says nothing."""
    T_anchor_start, T_anchor_end, jacobian = _pair(core.mean)
    rows, measured = evidence.rows()
    if not len(rows):
        return Surprise(0.0, 0), None
    apart = [
        se3.log(se3.inverse(evidence.T_world_start) @ T_anchor_start),
        se3.log(se3.inverse(evidence.T_world_end) @ T_anchor_end),
    ]
    for part, twist in enumerate(apart):
        jacobian[6 * part : 6 * part + 6] = se3.right_jacobian_inverse(twist) @ jacobian[6 * part : 6 * part + 6]
    innovation = measured - rows @ np.concatenate(apart)
    correction = correct(core.factor, core.factor.T @ (rows @ jacobian).T, np.eye(len(rows)), innovation)
    return Surprise(correction.innovation_squared, len(rows)), correction

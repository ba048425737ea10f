# SPDX-License-Identifier: BSD-3-Clause
"""Relative motion since the cloned keyframe pose, and what a late result says about that pose.

The clone is part of the state, so both have honest covariances: the uncertainty that pose and clone share (yaw,
position, tilt at the keyframe) drops out. Source: Roumeliotis and Burdick, "Stochastic cloning", 2002.
"""

import numpy as np

from coclo_vio.arrays import Array
from coclo_vio.estimates import OdometryDelta
from coclo_vio.filter.core import SquareRootFilter
from coclo_vio.filter.square_root import Correction
from coclo_vio.filter.state import POSITION, ROTATION, State
from coclo_vio.geometry import se3, so3


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


def correct_clone(core: SquareRootFilter, T_world_clone: Array, covariance: Array) -> Correction:  # noqa: N803
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

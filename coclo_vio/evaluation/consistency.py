# SPDX-License-Identifier: BSD-3-Clause
"""Is an estimator's covariance consistent with its errors? NEES of the pose and its average.

Source: Bar-Shalom, Li, Kirubarajan, "Estimation with applications to tracking and navigation", 2001, section 5.4.
"""

import numpy as np

from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import EvaluationError
from coclo_vio.values.trajectory import Trajectory

_TWIST_HALF_S = 0.1
_SMALLEST_RELATIVE_EIGENVALUE = 1e-12


def nees(errors: Array, covariances: Array) -> Array:
    """Normalised estimation errors squared ``e^T P^-1 e``, (N,), of errors (N, d) and covariances (N, d, d).

    NaN where a covariance is not positive definite: NEES is not defined there.

    Raises:
        EvaluationError: the shapes do not belong together.
    """
    if errors.ndim != 2 or covariances.shape != (*errors.shape, errors.shape[1]):
        raise EvaluationError(
            f"NEES takes errors (N, d) and covariances (N, d, d), got {errors.shape} and {covariances.shape}"
        )
    eigenvalues, vectors = np.linalg.eigh(covariances)
    is_definite = eigenvalues[:, 0] > _SMALLEST_RELATIVE_EIGENVALUE * np.abs(eigenvalues[:, -1])
    along = np.einsum("nij,ni->nj", vectors, errors)
    values = np.full(len(errors), np.nan)
    values[is_definite] = (along[is_definite] ** 2 / eigenvalues[is_definite]).sum(axis=1)
    return values


def anees(values: Array, dof: int) -> float | None:
    """Mean NEES over its degrees of freedom: 1 is consistent, above 1 overconfident, below 1 conservative.

    None where no value is defined.
    """
    defined = values[np.isfinite(values)]
    return float(defined.mean() / dof) if len(defined) else None


def pose_errors(estimate: Trajectory, reference: Trajectory) -> Array:
    """Right/local pose errors ``log(T_world_estimate^-1 T_world_reference)``, [rotation rad, position m], (N, 6).

    Both in the same world and on the same stamps.
    """
    relative = se3.inverse(estimate.T_world_body) @ reference.T_world_body
    return np.array([se3.log(T) for T in relative])


def twists(trajectory: Trajectory) -> Array:
    """Angular velocity (rad/s) and velocity (m/s) of each pose, its own axes, (N, 6): from 0.1 s before to after it."""
    times_s, poses = trajectory.times_s, trajectory.T_world_body
    before = np.searchsorted(times_s, times_s - _TWIST_HALF_S)
    after = np.minimum(np.searchsorted(times_s, times_s + _TWIST_HALF_S, "right"), len(times_s)) - 1
    moved = se3.inverse(poses[before]) @ poses[after]
    dt_s = np.maximum(times_s[after] - times_s[before], 1e-9)
    return np.asarray(np.array([se3.log(T) for T in moved]) / dt_s[:, None])


def anees_pose(
    estimate: Trajectory,
    reference: Trajectory,
    rotation_noise_rad: float = 0.0,
    position_noise_m: float = 0.0,
    time_noise_s: float = 0.0,
) -> float | None:
    """ANEES of the 6-dof pose, both trajectories in the same world; None without covariance.

    The reference has noise too, with these standard deviations on each axis: at the start, where the estimator is
    certain of its pose, a millimetre of tracker noise would otherwise be all that counts. A time that is wrong moves a
    pose along its twist. Poses whose covariance stays singular are left out.
    """
    if estimate.covariance is None:
        return None
    noise = np.diag([rotation_noise_rad**2] * 3 + [position_noise_m**2] * 3)
    covariance = estimate.covariance + noise
    if time_noise_s > 0.0:
        along = time_noise_s * twists(reference)
        covariance = covariance + along[:, :, None] * along[:, None, :]
    return anees(nees(pose_errors(estimate, reference), covariance), dof=6)

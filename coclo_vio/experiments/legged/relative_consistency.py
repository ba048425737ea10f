# SPDX-License-Identifier: BSD-3-Clause
"""Is the growth of an estimator's covariance over a metre consistent with its errors over that metre?

The error of the end of a piece is that of its start, seen from the end, and what the piece adds: ``e_j = Ad e_i + w``
with ``Ad`` of the estimated motion from j to i. Where what a piece adds does not depend on the error before it, the
covariance of ``w`` is ``P_j - Ad P_i Ad^T``. That holds for yaw and position of odometry; tilt, which gravity measures,
is left out, and so are pieces over which the covariance does not grow.
"""

import numpy as np

from coclo_vio.evaluation.consistency import anees, nees
from coclo_vio.evaluation.metrics import segments, travelled_m
from coclo_vio.geometry import se3
from coclo_vio.values.trajectory import Trajectory

_SPACING_S = 0.1
_MOST_PIECES = 1000


def anees_per_metre(
    estimate: Trajectory, reference: Trajectory, *, length_m: float = 1.0, position_noise_m: float = 0.0
) -> float | None:
    """Average NEES of the position at the end of pieces, over its three degrees of freedom; 1 is consistent.

    Args:
        estimate: poses (N,) with covariance.
        reference: the ground truth on the same stamps.
        length_m: of a piece.
        position_noise_m: one sigma of each axis of the ground truth.

    Returns:
        None without covariance, where the ground truth travels no piece, or where no covariance grows.
    """
    if estimate.covariance is None:
        return None
    pairs = segments(travelled_m(reference, _SPACING_S), length_m)
    if len(pairs) == 0:
        return None
    pairs = pairs[:: max(1, len(pairs) // _MOST_PIECES)]
    errors, covariances = np.zeros((len(pairs), 3)), np.zeros((len(pairs), 3, 3))
    for row, (start, end) in enumerate(pairs):
        T_end_start = se3.inverse(estimate.T_world_body[end]) @ estimate.T_world_body[start]
        true = se3.inverse(reference.T_world_body[start]) @ reference.T_world_body[end]
        errors[row] = se3.log(T_end_start @ true)[3:]
        turned = se3.adjoint(T_end_start)
        before = turned @ estimate.covariance[start] @ turned.T
        covariances[row] = (estimate.covariance[end] - before)[3:, 3:]
    noise = 2.0 * position_noise_m**2 * np.eye(3)
    return anees(nees(errors, covariances + noise), dof=3)

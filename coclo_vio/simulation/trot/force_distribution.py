# SPDX-License-Identifier: BSD-3-Clause
"""The wrench that the trunk needs, shared among the standing feet."""

import numpy as np

from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array

_WEIGHT = np.array([1.0, 1.0, 1.0, 30.0, 30.0, 15.0])  # of force (1/N^2) and moment (1/Nm^2)
_SMALL = 1e-3  # on forces: which of many solutions; relative to _WEIGHT
_MIN_SHARE = 0.05


def distributed(wrench: Array, levers: Array, shares: Array, friction: float) -> Array:
    """Forces of the ground on the feet by weighted least squares, within friction cones, N, world, (n, 3).

    Minimises ``|A f - w|_W^2 + c sum(|f_i|^2 / share_i^2)``; then a normal force is made positive and a tangential one
    is cut to friction. Two feet cannot hold the moment about their line: what is missing stays a residual.

    Args:
        wrench: force and moment about the centre of mass, (6,).
        levers: from the centre of mass to the feet, world, m, (n, 3).
        shares: load factors, 0 to 1, (n,).
        friction: Coulomb coefficient that may be used.
    """
    count = len(levers)
    if count == 0:
        return np.zeros((0, 3))
    by_foot = np.empty((6, count, 3))
    by_foot[:3] = np.eye(3)[:, None]
    by_foot[3:] = so3.hat(levers).transpose(1, 0, 2)
    grasp = by_foot.reshape(6, 3 * count)
    weighted = grasp.T * _WEIGHT
    penalty = _SMALL / np.maximum(shares, _MIN_SHARE) ** 2
    normal = weighted @ grasp
    normal.flat[:: 3 * count + 1] += np.repeat(penalty, 3)
    forces = np.linalg.solve(normal, weighted @ wrench).reshape(count, 3)
    forces[:, 2] = np.maximum(forces[:, 2], 0.0)
    level = np.hypot(forces[:, 0], forces[:, 1])
    forces[:, :2] *= np.minimum(1.0, friction * forces[:, 2] / np.maximum(level, 1e-9))[:, None]
    return forces

# SPDX-License-Identifier: BSD-3-Clause
"""The gauge of the window: its oldest keyframe is fixed in the directions that nothing measures.

Cameras measure positions relative to each other only, and gravity adds roll and pitch. Position in the world and
heading (without gravity the whole pose) are unobservable; there the oldest keyframe is fixed where it is, and its
uncertainty is kept beside the window and added to what goes out.
"""

import numpy as np

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.factors import Term
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array

_POSE = 6  # dimensions
_FIXED = 1e-4  # rad and m, one sigma: where the oldest keyframe is fixed
_OPEN = 100.0  # rad, one sigma of its tilt where gravity measures it


def unobservable_directions(T_world_body: Array, *, has_gravity: bool) -> Array:
    """Orthonormal columns of a pose's tangent space along which no measurement changes, (6, 4 or 6).

    Args:
        T_world_body: the pose, (4, 4).
        has_gravity: whether an accelerometer measures roll and pitch.
    """
    if not has_gravity:
        return np.eye(6)
    directions = np.zeros((6, 4))
    directions[:3, 0] = T_world_body[2, :3]
    directions[3:, 1:] = np.eye(3)
    return directions


def tilt_prior(number: int, T_world_body: Array, directions: Array, covariance: Array) -> list[Term]:
    """A prior on the tilt of keyframe ``number`` where gravity measures it; none otherwise.

    Args:
        number: of the keyframe.
        T_world_body: pose of the keyframe, (4, 4).
        directions: unobservable ones, (6, M).
        covariance: of its pose, right/local, (6, 6).
    """
    if directions.shape[1] == _POSE:
        return []
    across = directions @ directions.T
    tilt = np.eye(_POSE) - across
    return [factors.pose_prior(number, T_world_body, tilt @ covariance @ tilt + _OPEN**2 * across)]


class Gauge:
    """Where the oldest keyframe is fixed, and how uncertain that is.

    Attributes:
        term: fixes the keyframe; it holds no information and leaves with that keyframe. None before ``fix``.
        covariance: of the fixed directions, right/local, (6, 6).
    """

    def __init__(self) -> None:
        self.term: Term | None = None
        self.covariance = np.zeros((_POSE, _POSE))

    def fix(self, number: int, T_world_body: Array, directions: Array, covariance: Array) -> None:
        """Fix keyframe ``number`` in the unobservable directions (6, M) of its pose, whose covariance is (6, 6)."""
        across = directions @ directions.T
        self.covariance = across @ covariance @ across
        noise = _FIXED**2 * across + _OPEN**2 * (np.eye(_POSE) - across)
        self.term = factors.pose_prior(number, T_world_body, noise)

    def covariance_at(self, T_world_body: Array, T_world_fixed: Array) -> Array:
        """Covariance (6, 6) that a pose (4, 4) has from the fixed keyframe, now at ``T_world_fixed``, right/local."""
        moved = se3.adjoint(se3.inverse(T_world_body) @ T_world_fixed)
        return np.asarray(moved @ self.covariance @ moved.T)

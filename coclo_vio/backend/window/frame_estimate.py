# SPDX-License-Identifier: BSD-3-Clause
"""The estimate of one frame relative to the window, and how a covariance is propagated to it."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array


@dataclass(frozen=True, slots=True, eq=False)
class FrameEstimate:
    """Pose and velocity of a frame.

    Attributes:
        stamp_ns: time of the frame.
        T_world_body: (4, 4).
        velocity_world: m/s, (3,).
        covariance: as that of ``StateEstimate``, without what is fixed by the window's gauge, (9, 9).
    """

    stamp_ns: int
    T_world_body: Array
    velocity_world: Array
    covariance: Array


def propagated_covariance(covariance: Array, T_world_before: Array, T_world_now: Array, added: Array) -> Array:
    """The covariance of [pose, velocity] propagated from one pose to another, (9, 9).

    Args:
        covariance: at the earlier pose, right/local, (9, 9).
        T_world_before: the earlier pose, (4, 4).
        T_world_now: the later one, (4, 4).
        added: of the motion between them, right/local at its end, (6, 6).
    """
    moved = np.eye(9)
    moved[:6, :6] = se3.adjoint(se3.inverse(T_world_now) @ T_world_before)
    later = np.asarray(moved @ covariance @ moved.T)
    later[:6, :6] += added
    return later

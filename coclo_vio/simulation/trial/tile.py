# SPDX-License-Identifier: BSD-3-Clause
"""A slippery tile in the walkway: a place where feet find less hold, which nobody sees and no controller knows of."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.geometry import so3
from coclo_vio.simulation.trial.walkway import Walkway
from coclo_vio.values.arrays import Array, BoolArray

SIDE_M = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Tile:
    """A square of the ground as seen from above.

    Attributes:
        place: of its middle, x and y in the world, m, (2,).
        heading_rad: of a side against the world's x.
        friction: Coulomb coefficient between a foot and it.
    """

    place: Array
    heading_rad: float
    friction: float

    @classmethod
    def amid(cls, walkway: Walkway, friction: float) -> "Tile":
        """The tile left of where the body is when half of the time of its way has passed.

        Its right side is the middle of the way, so the left feet tread on it and the right ones hold: on a tile under
        all six a robot slides down the ramp.
        """
        pose = walkway.pose_at(0.5 * walkway.duration_s)
        heading = float(so3.yaw(pose[:3, :3]))
        left = np.array([-np.sin(heading), np.cos(heading)])
        return cls(pose[:2, 3] + SIDE_M / 2.0 * left, heading, friction)

    def carries(self, points: Array) -> BoolArray:
        """Which of the points (N, 2 or 3), world, m, are over it, (N,)."""
        cos, sin = np.cos(self.heading_rad), np.sin(self.heading_rad)
        along, across = ((points[:, :2] - self.place) @ np.array([[cos, -sin], [sin, cos]])).T
        return np.asarray((np.abs(along) <= SIDE_M / 2.0) & (np.abs(across) <= SIDE_M / 2.0))

# SPDX-License-Identifier: BSD-3-Clause
"""A slippery tile on the path: an area of lower friction, not visible in the images and not known to the controller."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.geometry import so3
from coclo_vio.simulation.trial.planned_path import PlannedPath
from coclo_vio.values.arrays import Array, BoolArray

SIDE_M = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class SlipperyTile:
    """A square of the ground as seen from above.

    Attributes:
        centre: x and y in the world, m, (2,).
        heading_rad: of a side, from the world's x axis.
        friction: Coulomb coefficient between a foot and the tile.
    """

    centre: Array
    heading_rad: float
    friction: float

    @classmethod
    def on_path(cls, path: PlannedPath, friction: float) -> "SlipperyTile":
        """The tile left of the body's planned position at half of the path's time.

        Its right side lies on the path, so the left feet step on it and the right ones do not: on a tile under all six
        a robot slides down the ramp.
        """
        pose = path.pose_at(0.5 * path.duration_s)
        heading = float(so3.yaw(pose[:3, :3]))
        left = np.array([-np.sin(heading), np.cos(heading)])
        return cls(pose[:2, 3] + SIDE_M / 2.0 * left, heading, friction)

    def contains(self, points: Array) -> BoolArray:
        """Which of the points (N, 2 or 3), world, m, are above the tile, (N,)."""
        cos, sin = np.cos(self.heading_rad), np.sin(self.heading_rad)
        along, across = ((points[:, :2] - self.centre) @ np.array([[cos, -sin], [sin, cos]])).T
        return np.asarray((np.abs(along) <= SIDE_M / 2.0) & (np.abs(across) <= SIDE_M / 2.0))

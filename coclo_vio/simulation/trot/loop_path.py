# SPDX-License-Identifier: BSD-3-Clause
"""The path of the body as seen from above: laps of a rectangle with round corners."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.values.arrays import Array


@dataclass(frozen=True, slots=True)
class PathPoint:
    """A point of the path.

    Attributes:
        position: x and y, m, (2,).
        heading_rad: of the tangent, from the world's x axis, unwrapped.
        curvature: 1/m, positive to the left.
    """

    position: Array
    heading_rad: float
    curvature: float


@dataclass(frozen=True, slots=True)
class LoopPath:
    """Anticlockwise laps from the origin, first along x on a long side.

    Attributes:
        long_m: straight part of the sides along x.
        short_m: straight part of the sides along y.
        radius_m: of the corners.
        length_m: of the whole path, over as many laps as it takes.
    """

    long_m: float
    short_m: float
    radius_m: float
    length_m: float

    @property
    def lap_m(self) -> float:
        """Length of a lap."""
        return 2.0 * (self.long_m + self.short_m + np.pi * self.radius_m)

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """Least and greatest x, least and greatest y of the path."""
        radius = self.radius_m
        return -radius, self.long_m + radius, 0.0, self.short_m + 2.0 * radius

    def at(self, travelled_m: float) -> PathPoint:
        """The point after so many metres; before the start and beyond the laps' end the path goes on."""
        laps, rest = divmod(travelled_m, self.lap_m)
        heading = 2.0 * np.pi * laps
        position, corner = np.zeros(2), 0.5 * np.pi * self.radius_m
        for side in (self.long_m, self.short_m, self.long_m, self.short_m):
            step = min(rest, side)
            position = position + step * _direction(heading)
            rest -= step
            if rest <= 0.0:
                return PathPoint(position, heading, 0.0)
            angle = min(rest, corner) / self.radius_m
            left = _direction(heading + 0.5 * np.pi)
            ahead = _direction(heading)
            position = position + self.radius_m * (np.sin(angle) * ahead + (1.0 - np.cos(angle)) * left)
            heading += angle
            rest -= corner
            if rest <= 0.0:
                return PathPoint(position, heading, 1.0 / self.radius_m)
        return PathPoint(position, heading, 0.0)


def _direction(heading_rad: float) -> Array:
    return np.array([np.cos(heading_rad), np.sin(heading_rad)])

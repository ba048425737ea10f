# SPDX-License-Identifier: BSD-3-Clause
"""Where the body should be on its way: a pose for every moment of walking, following the ground."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.geometry import se3, so3
from coclo_vio.simulation.trial.terrain import Stretch, Terrain
from coclo_vio.values.arrays import Array

_HALF_SPAN_M = 0.5  # the body takes the slope of the ground between its front and rear feet


@dataclass(frozen=True, slots=True, eq=False)
class Walkway:
    """A terrain's way walked at a steady pace.

    Attributes:
        terrain: the ground.
        speed_mps: along straight stretches.
        turn_rate_radps: on the spot.
        height_m: of the body's origin over the ground.
    """

    terrain: Terrain
    speed_mps: float
    turn_rate_radps: float
    height_m: float

    @property
    def duration_s(self) -> float:
        """How long the way takes without a stop, s."""
        return sum(self._duration(stretch) for stretch in self.terrain.way)

    def pose_at(self, walked_s: float) -> Array:
        """``T_world_body`` (4, 4) after so many seconds of walking; the ends of the way hold before and after it."""
        place, heading = self._planar(walked_s)
        ahead = _HALF_SPAN_M * np.array([np.cos(heading), np.sin(heading)])
        front, rear = self._line(place[0] + ahead[0]), self._line(place[0] - ahead[0])
        pitch = -float(np.arctan2(front - rear, 2.0 * _HALF_SPAN_M))
        rotation = so3.about_z(heading) @ so3.exp(np.array([0.0, pitch, 0.0]))
        above = self.height_m * rotation[:, 2] * [0.0, 0.0, 1.0] / rotation[2, 2] ** 2
        return se3.transform(rotation, np.array([*place, 0.5 * (front + rear)]) + above)

    def _planar(self, walked_s: float) -> tuple[Array, float]:
        place, heading, left_s = np.zeros(2), 0.0, max(walked_s, 0.0)
        for stretch in self.terrain.way:
            duration = self._duration(stretch)
            share = min(left_s / duration, 1.0)
            place = place + share * stretch.advance_m * np.array([np.cos(heading), np.sin(heading)])
            heading += share * stretch.turn_rad
            left_s -= duration
            if left_s <= 0.0:
                break
        return place, heading

    def _duration(self, stretch: Stretch) -> float:
        return abs(stretch.advance_m) / self.speed_mps + abs(stretch.turn_rad) / self.turn_rate_radps

    def _line(self, x: float) -> float:
        return float(np.interp(x, self.terrain.body_line[:, 0], self.terrain.body_line[:, 1]))

# SPDX-License-Identifier: BSD-3-Clause
"""The planned path of the body: a pose for every moment of walking, following the ground."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.geometry import se3, so3
from coclo_vio.simulation.trial.terrain import PathSegment, Terrain
from coclo_vio.values.arrays import Array

_HALF_SPAN_M = 0.5  # the body takes the slope of the ground between its front and rear feet


@dataclass(frozen=True, slots=True, eq=False)
class PlannedPath:
    """A terrain's path walked at a constant speed.

    Attributes:
        terrain: the ground.
        speed_mps: along straight segments.
        turn_rate_radps: on the spot.
        height_m: of the body's origin over the ground.
    """

    terrain: Terrain
    speed_mps: float
    turn_rate_radps: float
    height_m: float

    @property
    def duration_s(self) -> float:
        """Duration of the path without a stop, s."""
        return sum(self._duration(segment) for segment in self.terrain.path)

    def pose_at(self, path_time_s: float) -> Array:
        """``T_world_body`` (4, 4) after so many seconds of walking; the ends of the path hold before and after it."""
        position, heading = self._planar(path_time_s)
        ahead = _HALF_SPAN_M * np.array([np.cos(heading), np.sin(heading)])
        front, rear = self._profile_height(position[0] + ahead[0]), self._profile_height(position[0] - ahead[0])
        pitch = -float(np.arctan2(front - rear, 2.0 * _HALF_SPAN_M))
        rotation = so3.about_z(heading) @ so3.exp(np.array([0.0, pitch, 0.0]))
        above = self.height_m * rotation[:, 2] * [0.0, 0.0, 1.0] / rotation[2, 2] ** 2
        return se3.transform(rotation, np.array([*position, 0.5 * (front + rear)]) + above)

    def _planar(self, path_time_s: float) -> tuple[Array, float]:
        position, heading, remaining_s = np.zeros(2), 0.0, max(path_time_s, 0.0)
        for segment in self.terrain.path:
            duration = self._duration(segment)
            share = min(remaining_s / duration, 1.0)
            position = position + share * segment.advance_m * np.array([np.cos(heading), np.sin(heading)])
            heading += share * segment.turn_rad
            remaining_s -= duration
            if remaining_s <= 0.0:
                break
        return position, heading

    def _duration(self, segment: PathSegment) -> float:
        return abs(segment.advance_m) / self.speed_mps + abs(segment.turn_rad) / self.turn_rate_radps

    def _profile_height(self, x: float) -> float:
        return float(np.interp(x, self.terrain.body_profile[:, 0], self.terrain.body_profile[:, 1]))

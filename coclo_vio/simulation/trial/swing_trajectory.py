# SPDX-License-Identifier: BSD-3-Clause
"""The trajectory of a swing foot: up, over, down, and further down until contact is detected."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.values.arrays import Array

_MIN_TRANSIT_S = 0.1  # at least, for the horizontal part
_PEAK_SLOPE = 1.5  # of a smooth step, over its mean slope
_SEARCH_DEPTH_M = 0.06  # largest depth below the expected ground


@dataclass(frozen=True, slots=True, eq=False)
class SwingTrajectory:
    """One swing of a foot's centre in the world.

    Attributes:
        start: at lift-off, m, (3,).
        goal: at the expected touch-down, m, (3,).
        top_m: greatest height, world, m.
        planned_s: time to the expected touch-down; longer where height and speed require it, s.
        touch_speed_mps: downward speed then, m/s.
        vertical_speed_mps: largest speed up and down, m/s.
    """

    start: Array
    goal: Array
    top_m: float
    planned_s: float
    touch_speed_mps: float
    vertical_speed_mps: float

    @property
    def duration_s(self) -> float:
        """From lift-off to the expected touch-down, s."""
        return max(self.planned_s, self._rise_s + max(self._fall_s, 0.7 * self._fall_s + _MIN_TRANSIT_S))

    def position(self, elapsed_s: float) -> Array:
        """Planned position of the foot at a time after lift-off, m, (3,)."""
        duration, rise, fall = self.duration_s, self._rise_s, self._fall_s
        climbs = self.goal[2] - self.start[2] > 0.02
        leaves, arrives = (0.8 if climbs else 0.4) * rise, duration - (0.35 if climbs else 0.6) * fall
        level = _smooth((elapsed_s - leaves) / (arrives - leaves))
        point = self.start + level * (self.goal - self.start)
        if elapsed_s < duration - fall:
            point[2] = self.start[2] + _smooth(elapsed_s / rise) * (self.top_m - self.start[2])
        elif elapsed_s < duration:
            point[2] = self._descent((elapsed_s - duration + fall) / fall)
        else:
            point[2] = self.goal[2] - min(self.touch_speed_mps * (elapsed_s - duration), _SEARCH_DEPTH_M)
        return point

    def is_descending(self, elapsed_s: float) -> bool:
        """Whether a force on the foot counts as contact with the ground."""
        return elapsed_s > self.duration_s - 0.7 * self._fall_s

    @property
    def _rise_s(self) -> float:
        return _PEAK_SLOPE * (self.top_m - float(self.start[2])) / self.vertical_speed_mps

    @property
    def _fall_s(self) -> float:
        return _PEAK_SLOPE * (self.top_m - float(self.goal[2])) / self.vertical_speed_mps

    def _descent(self, share: float) -> float:
        """Cubic from rest at the top to the touch-down speed at the goal."""
        end_slope = -self.touch_speed_mps * self._fall_s
        drop = self.goal[2] - self.top_m
        cubic, square = end_slope - 2.0 * drop, 3.0 * drop - end_slope
        return float(self.top_m + share * share * (square + share * cubic))


def _smooth(share: float) -> float:
    """From 0 to 1 with level ends."""
    bounded = float(np.clip(share, 0.0, 1.0))
    return bounded * bounded * (3.0 - 2.0 * bounded)

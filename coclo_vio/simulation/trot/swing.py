# SPDX-License-Identifier: BSD-3-Clause
"""The trajectory of a trotting robot's swing foot: up, over, down, and on downwards until it finds the ground."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.values.arrays import Array

_LEVEL, _LEVEL_UP, _LEVEL_DOWN = (0.08, 0.92), (0.22, 0.97), (0.03, 0.75)  # shares of the swing with level motion
_TOP, _TOP_UP, _TOP_DOWN = 0.45, 0.4, 0.3  # share of the swing at which the foot is highest
_STEP_M = 0.04  # from which a swing goes up or down a step
_REACH_M = 0.08  # greatest depth below the expected ground


@dataclass(frozen=True, slots=True, eq=False)
class FootMotion:
    """A planned motion of a foot at a time, world.

    Attributes:
        position: m, (3,).
        velocity: m/s, (3,).
        acceleration: m/s^2, (3,).
    """

    position: Array
    velocity: Array
    acceleration: Array


def swing_motion(
    start: Array, goal: Array, top_m: float, duration_s: float, touch_speed_mps: float, elapsed_s: float
) -> FootMotion:
    """Where a foot is to be so long after its lift-off.

    Horizontally a quintic from rest to rest. Vertically a quintic up to ``top_m`` and a cubic down that ends with
    ``touch_speed_mps``, with which the foot goes on. Up a step it first rises, down a step it first moves over its
    edge.
    """
    share, rise_m = elapsed_s / duration_s, goal[2] - start[2]
    (level_from, level_to), top_at = _LEVEL, _TOP
    if abs(rise_m) > _STEP_M:
        (level_from, level_to), top_at = (_LEVEL_UP, _TOP_UP) if rise_m > 0.0 else (_LEVEL_DOWN, _TOP_DOWN)
    span = level_to - level_from
    position, velocity, acceleration = start.copy(), np.zeros(3), np.zeros(3)
    value, slope, bend = _quintic((share - level_from) / span)
    way, scale = goal[:2] - start[:2], 1.0 / (span * duration_s)
    position[:2] += value * way
    velocity[:2], acceleration[:2] = slope * scale * way, bend * scale**2 * way
    if share < top_at:
        value, slope, bend = _quintic(share / top_at)
        way, scale = top_m - start[2], 1.0 / (top_at * duration_s)
        position[2] += value * way
        velocity[2], acceleration[2] = slope * scale * way, bend * scale**2 * way
    elif share < 1.0:
        fall_s = (1.0 - top_at) * duration_s
        part, drop, end = (share - top_at) / (1.0 - top_at), goal[2] - top_m, -touch_speed_mps * fall_s
        cubic, square = end - 2.0 * drop, 3.0 * drop - end
        position[2] = top_m + part * part * (square + part * cubic)
        velocity[2] = part * (2.0 * square + 3.0 * part * cubic) / fall_s
        acceleration[2] = (2.0 * square + 6.0 * part * cubic) / fall_s**2
    else:
        depth = touch_speed_mps * (elapsed_s - duration_s)
        position[2] = goal[2] - min(depth, _REACH_M)
        velocity[2] = -touch_speed_mps if depth < _REACH_M else 0.0
    return FootMotion(position, velocity, acceleration)


def _quintic(share: float) -> tuple[float, float, float]:
    """From 0 to 1 with speed and acceleration zero at both ends: value, first and second derivative."""
    if share <= 0.0 or share >= 1.0:
        return float(share >= 1.0), 0.0, 0.0
    rest = 1.0 - share
    value = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    return value, 30.0 * share**2 * rest**2, 60.0 * share * rest * (rest - share)

# SPDX-License-Identifier: BSD-3-Clause
"""Feet that slide while their contact is in stance: the velocity of each foot against its noise, over a short window.

The body's velocity is that of ``KinematicContact``: by the accelerometer and the feet that agree with it, so that a
foot that slides does not move its own reference, as the mean of two standing feet would. A stance begins and ends with
a foot that still or already moves; these parts are left out.
"""

from collections import deque
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from coclo_vio.robot.foot_motion import FootMotion
from coclo_vio.robot.kinematic_contact import KinematicContact, KinematicContactConfig
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.config import StageConfig
from coclo_vio.values.units import NS_PER_S

_STANCE_ODDS = 2.0  # logarithm of the odds of stance by contact, for the reference velocity
_END_SHARE = 0.25  # of the limit: a slip ends below it


class SlipConfig(StageConfig):
    """Limits of a slip."""

    is_enabled: Annotated[
        bool | None,
        Field(description="whether feet that slip are looked for and reported; null: with at most four legs"),
    ] = None
    interval_s: Annotated[
        float, Field(ge=0, le=0.02, description="joint samples that follow sooner are left out of the search, s")
    ] = 0.01
    window_s: Annotated[float, Field(gt=0, le=0.5, description="mean velocities of feet are over this time, s")] = 0.05
    limit: Annotated[
        float, Field(gt=1, description="square of a foot's velocity over its variance from which it slips")
    ] = 13.8
    velocity_sigma_mps: Annotated[
        float, Field(gt=0, le=1, description="velocity of a foot that stands (bending, zeros of joints), m/s")
    ] = 0.05
    touch_down_s: Annotated[float, Field(ge=0, le=0.5, description="beginning of a stance that is left out, s")] = 0.02
    lift_off_s: Annotated[float, Field(ge=0, le=0.5, description="end of a stance that is left out, s")] = 0.04
    least_m: Annotated[float, Field(ge=0, le=1, description="shorter slips are not reported, m")] = 0.015


@dataclass(frozen=True, slots=True)
class Slip:
    """One foot slid once.

    Attributes:
        leg: index of the foot.
        start_ns: beginning, in nanoseconds.
        duration_s: s.
        distance_m: along the ground, m.
    """

    leg: int
    start_ns: int
    duration_s: float
    distance_m: float


class SlipSearch:
    """Finds slips of standing feet, each reported once it is over."""

    def __init__(self, config: SlipConfig, kinematic: KinematicContactConfig, legs: int) -> None:
        """Take parameters.

        Args:
            config: limits.
            kinematic: of the reference velocity.
            legs: how many.
        """
        self._config, self._legs = config, legs
        self._reference = KinematicContact(kinematic, legs)
        self._window: deque[tuple[float, Array]] = deque()
        self._sum: Array = np.zeros((legs, 3))
        self._span_s = 0.0
        self._stood_s: Array = np.zeros(legs)
        self._stamp_ns: int | None = None
        self._steps: list[list[tuple[int, float]]] = [[] for _ in range(legs)]

    def push(self, motion: FootMotion, is_stance: BoolArray) -> list[Slip]:
        """Take a sample; the slips that are over by now.

        Args:
            motion: of the feet.
            is_stance: feet in stance by contact, (n,).
        """
        known = np.isfinite(motion.body_velocity[:, 0])
        self._reference.update(motion, np.where(is_stance, _STANCE_ODDS, -_STANCE_ODDS))
        body, dt_s = self._reference.body_velocity, self._dt_s(motion.stamp_ns)
        assert body is not None, "there was an update"
        moved = np.where(known[:, None], body - motion.body_velocity, 0.0) * dt_s
        stands = known & is_stance
        self._stood_s = np.where(stands, self._stood_s + dt_s, 0.0)
        self._append(dt_s, moved)
        if motion.is_stationary or self._span_s <= 0.0:
            return self._ended(
                np.ones(self._legs, dtype=np.bool_), motion.stamp_ns, is_lifted=np.zeros(self._legs, dtype=np.bool_)
            )
        mean = self._sum / self._span_s
        rising = mean @ motion.up_body
        along = mean - rising[:, None] * motion.up_body
        square = np.einsum("ni,ni->n", along, along)
        ratio = square / self._variance(motion)
        is_settled = self._stood_s >= self._config.window_s + self._config.touch_down_s
        is_level = rising**2 < 0.25 * square
        is_sliding = np.array([bool(steps) for steps in self._steps])
        limit = np.where(is_sliding, _END_SHARE * self._config.limit, self._config.limit)
        slides = stands & is_settled & is_level & (ratio > limit)
        for leg in np.flatnonzero(slides):
            steps, speed = self._steps[leg], float(np.sqrt(square[leg]))
            if not steps:  # the window before belongs to it
                steps.append((motion.stamp_ns - round(self._config.window_s * NS_PER_S), speed * self._config.window_s))
            steps.append((motion.stamp_ns, speed * dt_s))
        return self._ended(~slides, motion.stamp_ns, is_lifted=~stands | ~is_level)

    def _variance(self, motion: FootMotion) -> Array:
        """Of the mean velocity of a foot that stands, each axis, m^2/s^2, (n,)."""
        samples = max(len(self._window), 1)
        noise = np.nan_to_num(motion.velocity_variance) / samples
        return self._config.velocity_sigma_mps**2 + self._reference.velocity_variance + noise

    def _dt_s(self, stamp_ns: int) -> float:
        before, self._stamp_ns = self._stamp_ns, stamp_ns
        return 0.0 if before is None else min((stamp_ns - before) / NS_PER_S, self._config.window_s)

    def _append(self, dt_s: float, moved: Array) -> None:
        self._window.append((dt_s, moved))
        self._sum, self._span_s = self._sum + moved, self._span_s + dt_s
        while len(self._window) > 1 and self._span_s - self._window[0][0] >= self._config.window_s - 1e-9:
            old_s, old = self._window.popleft()
            self._sum, self._span_s = self._sum - old, self._span_s - old_s

    def _ended(self, ends: BoolArray, now_ns: int, *, is_lifted: BoolArray) -> list[Slip]:
        found = []
        for leg, steps in enumerate(self._steps):
            if not steps or not ends[leg]:
                continue
            self._steps[leg] = []
            last_ns = now_ns - round(self._config.lift_off_s * NS_PER_S) * int(is_lifted[leg])
            kept = [step for step in steps if step[0] <= last_ns]
            distance_m = sum(step[1] for step in kept)
            duration_s = (kept[-1][0] - kept[0][0]) / NS_PER_S if kept else 0.0
            if distance_m >= self._config.least_m and duration_s >= self._config.window_s:
                found.append(Slip(leg, kept[0][0], duration_s, distance_m))
        return found

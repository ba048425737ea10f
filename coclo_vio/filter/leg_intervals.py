# SPDX-License-Identifier: BSD-3-Clause
"""Intervals over which stance legs are compared: what each leg measured, and what the others predict of it.

Over an interval in which its foot stood, a leg measures the translation of the body by its joint angles alone. The
other stance legs and the rotation by the gyroscope predict the same.
"""

from dataclasses import dataclass

import numpy as np

from coclo_vio.filter.leg_residual_kernel import compared, translations
from coclo_vio.robot.leg_sensing import Reading
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.units import NS_PER_S


@dataclass(frozen=True, slots=True, eq=False)
class LegInterval:
    """What legs measured over an interval; axes are the body's at its begin.

    Attributes:
        begin: the reading at its begin.
        end: the reading at its end.
        turn: rotation of the body from begin to end, (3, 3).
        up: upward direction at the begin, (3,).
        stood: legs in stance throughout, (n,).
        residual: translation by each leg less the prediction of the others, m, (n, 3); 0 where not compared, and
            shortened where it is longer than any lasting error.
        predicted: the prediction, m, (n, 3); 0 where not compared.
        step_m: length of the prediction, m, (n,).
        variance: of the residual by the noise of encoders, slip and gyroscope, each axis, m^2, (n,).
        is_compared: legs with a prediction, (n,).
        duration_s: length of the interval, s.
    """

    begin: Reading
    end: Reading
    turn: Array
    up: Array
    stood: BoolArray
    residual: Array
    predicted: Array
    step_m: Array
    variance: Array
    is_compared: BoolArray
    duration_s: float


def translations_between(
    begin: Reading, end: Reading, turn: Array, up_body: Array, radii_m: Array
) -> tuple[Array, Array]:
    """``leg_residual_kernel.translations`` of two readings: of the body by each leg, and its lever, m, (n, 3) each."""
    return translations(
        (begin.feet.position_body, end.feet.position_body),
        (begin.feet.rotation_body_foot, end.feet.rotation_body_foot),
        turn,
        up_body,
        radii_m,
    )


@dataclass(frozen=True, slots=True)
class IntervalNoise:
    """Expected errors of what legs measure over an interval.

    Attributes:
        foot_m: one sigma of a foot position by its encoders and by bending, m.
        creep: random walk of a foot in stance, m/sqrt(s).
        turn_radps: error of the gyroscope, rad/s.
    """

    foot_m: float
    creep: float
    turn_radps: float

    def sigma_m(self, duration_s: float) -> float:
        """One sigma of the translation by one leg, each axis, m."""
        return float(np.sqrt(2.0 * self.foot_m**2 + self.creep**2 * duration_s))


class LegIntervals:
    """Collects readings; every interval that is complete is compared.

    Args:
        radii_m: of the feet, (n,).
        noise: of what a leg measures.
        interval_s: length, s.
    """

    def __init__(self, radii_m: Array, noise: IntervalNoise, interval_s: float) -> None:
        self._radii_m, self._noise = radii_m, noise
        self._interval_ns = round(interval_s * NS_PER_S) - 1_000_000  # stamps jitter
        self._begin: tuple[Reading, Array] | None = None
        self._stood: BoolArray = np.zeros(len(radii_m), dtype=np.bool_)

    def clear(self) -> None:
        """Forget the interval that has begun."""
        self._begin = None

    def push(self, reading: Reading, rotation: Array, is_aside: BoolArray) -> LegInterval | None:
        """Take a reading with ``R_world_body`` (3, 3); an interval where one is complete.

        Args:
            reading: of the legs.
            rotation: as the filter estimates it.
            is_aside: legs that predict no others, (n,).
        """
        if self._begin is None:
            self._begin, self._stood = (reading, rotation), reading.is_stance
            return None
        self._stood = self._stood & reading.is_stance
        begin, rotation_begin = self._begin
        if reading.stamp_ns - begin.stamp_ns < self._interval_ns:
            return None
        stood = self._stood
        self._begin, self._stood = (reading, rotation), reading.is_stance
        return self._compared(begin, reading, rotation_begin, rotation_begin.T @ rotation, stood, ~is_aside)

    def _compared(
        self, begin: Reading, end: Reading, rotation: Array, turn: Array, stood: BoolArray, trusted: BoolArray
    ) -> LegInterval:
        duration_s = (end.stamp_ns - begin.stamp_ns) / NS_PER_S
        up = rotation[2].copy()
        moved, levers = translations_between(begin, end, turn, up, self._radii_m)
        sigma_m = self._noise.sigma_m(duration_s)
        residual, predicted, variance, step_m = compared(
            moved, levers, stood, trusted, sigma_m, self._noise.turn_radps * duration_s
        )
        is_compared = variance > 0.0
        return LegInterval(begin, end, turn, up, stood, residual, predicted, step_m, variance, is_compared, duration_s)

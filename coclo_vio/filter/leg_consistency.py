# SPDX-License-Identifier: BSD-3-Clause
"""How well stance legs agree: variance factors of what redundant legs measure, fast noise and lasting errors apart."""

import math
from dataclasses import dataclass

import numpy as np

from coclo_vio.filter.leg_intervals import LegInterval
from coclo_vio.values.arrays import Array, BoolArray

_MEMORY_S = 20.0
_EXPECTED_INTERVALS = 10.0  # prior weight of the factor 1


@dataclass(frozen=True, slots=True)
class LegConsistency:
    """Empirical spread of stance legs against each other over the last 20 s or so.

    Attributes:
        noise_factor: variance of what changes from interval to interval (0.1 s), as a multiple of that expected.
        lasting_share: root mean square of what remains of a stance, as a share of the way of the body in it: slip,
            wrong geometry, rolling. The part of fast noise is subtracted; 0 where noise explains all.
        stances: effective number of stances in it.
        legs: how many were compared at a time, in the mean.
        noise_m: root mean square of the fast noise of a leg over an interval, each axis, m.
    """

    noise_factor: float
    lasting_share: float
    stances: float
    legs: float
    noise_m: float


class ConsistencyMeter:
    """Sums over intervals and stances, with a fading memory."""

    def __init__(self, legs: int) -> None:
        """Args: the number of legs."""
        self._last: Array = np.zeros((legs, 3))
        self._has_last: BoolArray = np.zeros(legs, dtype=np.bool_)
        self._last_variance: Array = np.zeros(legs)
        self._stance, self._stance_m = np.zeros((legs, 3)), np.zeros(legs)
        self._fast = np.array([0.0, 0.0, 0.0])  # squares, expected squares, number of axes
        self._slow = np.array([0.0, 0.0, 0.0])  # squares of stances less noise, squared ways, number
        self._compared = np.array([0.0, 0.0])  # legs, intervals

    @property
    def value(self) -> LegConsistency:
        """What the sums say now."""
        squares, expected, count = self._fast
        mean_expected = expected / count if count else 1.0
        prior = 3.0 * _EXPECTED_INTERVALS * mean_expected
        factor = (squares + prior) / (expected + prior)
        slow, way, stances = self._slow
        share = math.sqrt(max(slow, 0.0) / way) if way > 0.0 else 0.0
        noise_m = math.sqrt(squares / count) if count else 0.0
        legs, intervals = self._compared
        legs = legs / intervals if intervals else 0.0
        return LegConsistency(float(factor), float(share), float(stances), float(legs), float(noise_m))

    def push(self, interval: LegInterval, in_use: BoolArray) -> None:
        """Take the residuals of an interval; only legs in use (n,) count."""
        compared = interval.is_compared & in_use
        kept = math.exp(-interval.duration_s / _MEMORY_S)
        self._fast *= kept
        self._slow *= kept
        self._compared = kept * self._compared + np.array([np.count_nonzero(compared), 1.0])
        both = compared & self._has_last
        differences = interval.residual[both] - self._last[both]
        expected = interval.variance[both] + self._last_variance[both]
        self._fast += (0.5 * np.sum(differences**2), 1.5 * np.sum(expected), 3.0 * np.count_nonzero(both))
        ended = ~compared & (self._stance_m > 0.0)
        if ended.any():
            noise = 3.0 * self._last_variance[ended] * min(1.0, self.value.noise_factor)
            squares = np.sum(self._stance[ended] ** 2, axis=1) - noise
            self._slow += (float(squares.sum()), float(np.sum(self._stance_m[ended] ** 2)), np.count_nonzero(ended))
        going = compared.astype(float)
        self._stance = going[:, None] * (self._stance + interval.residual)
        self._stance_m = going * (self._stance_m + interval.step_m)
        self._last, self._has_last = interval.residual, compared
        self._last_variance = np.where(compared, interval.variance, 0.0)

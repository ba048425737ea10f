# SPDX-License-Identifier: BSD-3-Clause
"""The gyroscope's bias from a standstill: the mean of its readings over the whole standstill."""

import numpy as np

from coclo_vio.robot.standstill import ImuMeans
from coclo_vio.values.arrays import Array

_LEAST_RATE_RADPS = 3e-4  # one sigma of a mean angular velocity at rest
_MOST_WINDOWS = 100  # of one standstill whose mean is the gyroscope's bias
_EVERY_NS = 500_000_000  # how often a standstill is solved for


class StandstillBias:
    """Mean angular velocity over the present standstill."""

    def __init__(self, gyroscope_noise_density: float) -> None:
        """Take the white noise of the gyroscope, rad/s/sqrt(Hz)."""
        self._density = gyroscope_noise_density
        self._rates: list[Array] = []
        self._solved_ns: int | None = None

    def reset(self) -> None:
        """The standstill is over."""
        self._rates, self._solved_ns = [], None

    def is_due(self, stamp_ns: int) -> bool:
        """Whether it is time to solve for the standstill again."""
        return self._solved_ns is None or stamp_ns - self._solved_ns >= _EVERY_NS

    def add(self, stamp_ns: int, rest: ImuMeans) -> tuple[Array, float]:
        """Add a window at rest that ends now; the mean angular velocity so far, rad/s, (3,), and its sigma."""
        self._solved_ns = stamp_ns
        self._rates = [*self._rates[1 - _MOST_WINDOWS :], rest.angular_velocity]
        return np.mean(self._rates, axis=0), self.rate_sigma(rest.span_s * len(self._rates))

    def rate_sigma(self, span_s: float) -> float:
        """One sigma of the mean angular velocity over a rest, rad/s."""
        return max(_LEAST_RATE_RADPS, float(self._density / np.sqrt(span_s)))

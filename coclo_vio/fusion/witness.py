# SPDX-License-Identifier: BSD-3-Clause
"""A third sensor of rate: where cameras and gyroscope contradict each other, with which of the two it agrees."""

from enum import Enum

import numpy as np

from coclo_vio.values.arrays import Array

_SHARE = 0.1  # of a new value in the means
_FEWEST = 5
_FLOOR_RADPS = 1e-3
_SIGMAS = 5.0  # by which a contradiction has to exceed the witness's noise
_AGREES, _CONTRADICTS = 0.35, 0.65  # shares of the contradiction


class Testimony(Enum):
    """With which sensor a witness agrees."""

    VISION = "vision"
    GYROSCOPE = "gyroscope"


class Witness:
    """Learns how far this sensor is from the gyroscope while that one agrees with the cameras: its bias and noise."""

    def __init__(self) -> None:
        self._mean: Array = np.zeros(3)
        self._variance: Array = np.zeros(3)
        self._number = 0

    def add(self, difference: Array) -> None:
        """Take its rate less the gyroscope's while cameras and gyroscope agree, rad/s, (3,)."""
        self._number += 1
        share = max(_SHARE, 1.0 / self._number)
        off = difference - self._mean
        self._mean = self._mean + share * off
        self._variance = (1.0 - share) * (self._variance + share * off**2)

    def shift(self, by: Array) -> None:
        """The gyroscope's bias has stepped: this sensor's rate less the gyroscope's is more by this, rad/s, (3,)."""
        self._mean = self._mean + by

    def testify(self, difference: Array, contradiction: Array) -> Testimony | None:
        """With whom it agrees, by its rate less the gyroscope's; None where it cannot tell.

        Args:
            difference: rad/s, (3,).
            contradiction: rate of the cameras less that of the gyroscope, rad/s, (3,).
        """
        size = float(np.linalg.norm(contradiction))
        along = contradiction / size
        sigma = float(np.sqrt(along**2 @ self._variance + _FLOOR_RADPS**2))
        if self._number < _FEWEST or size < _SIGMAS * sigma:
            return None
        share = float((difference - self._mean) @ along) / size
        if share > _CONTRADICTS:
            return Testimony.VISION
        return Testimony.GYROSCOPE if share < _AGREES else None

# SPDX-License-Identifier: BSD-3-Clause
"""What was asked of a filter since a known state, so that its state can be made again by asking the same."""

from array import array
from typing import Protocol

import numpy as np

from coclo_vio.values.arrays import Array, BoolArray

MOST_BYTES = 32 * 2**20
"""Of the calls that are kept: some two minutes of walking at 1 kHz, 20 minutes at 100 Hz."""
_PREDICTION = 7  # numbers of one: dt_s, angular velocity, specific force


class Replayed(Protocol):
    """A filter that can be asked again."""

    def predict(self, dt_s: float, angular_velocity: Array, specific_force: Array) -> None:
        """Move on by ``dt_s`` > 0."""

    def correct(self, position_body: Array, is_stance: BoolArray) -> None:
        """Correct by the feet in stance."""


class FilterCalls:
    """Predictions and corrections in their order, up to ``MOST_BYTES``; beyond, none until the next beginning.

    A prediction is [dt_s, angular velocity, specific force], and a correction [-1, stance by leg, positions].
    """

    def __init__(self, legs: int) -> None:
        self._legs = legs
        self._numbers = array("d")
        self._is_complete = True

    @property
    def is_complete(self) -> bool:
        """Whether every call since the beginning is kept."""
        return self._is_complete

    def begin(self) -> None:
        """The state is known: nothing before is needed."""
        self._numbers, self._is_complete = array("d"), True

    def add_prediction(self, dt_s: float, angular_velocity: Array, specific_force: Array) -> None:
        """Keep a prediction."""
        self._add([dt_s, *angular_velocity.tolist(), *specific_force.tolist()])

    def add_correction(self, position_body: Array, is_stance: BoolArray) -> None:
        """Keep a correction, (legs, 3) and (legs,)."""
        self._add([-1.0, *is_stance.astype(np.float64).tolist(), *position_body.ravel().tolist()])

    def numbers(self) -> Array:
        """All calls, (n,)."""
        return np.array(self._numbers)

    def repeat(self, numbers: Array, asked: Replayed) -> None:
        """Ask a filter that is in the state of the beginning what ``numbers`` of another object have."""
        place, legs = 0, self._legs
        while place < len(numbers):
            if numbers[place] > 0.0:
                row = numbers[place : place + _PREDICTION]
                asked.predict(float(row[0]), row[1:4], row[4:7])
                place += _PREDICTION
            else:
                row = numbers[place + 1 : place + 1 + 4 * legs]
                asked.correct(row[legs:].reshape(legs, 3), row[:legs] > 0.5)
                place += 1 + 4 * legs

    def _add(self, numbers: list[float]) -> None:
        if not self._is_complete:
            return
        if (len(self._numbers) + len(numbers)) * self._numbers.itemsize > MOST_BYTES:
            self._numbers, self._is_complete = array("d"), False
            return
        self._numbers.extend(numbers)

# SPDX-License-Identifier: BSD-3-Clause
"""The observations of the window as arrays, one row each."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Self

import numpy as np
from numpy.typing import NDArray

from coclo_vio.backend.window.landmark import Landmark
from coclo_vio.values.arrays import Array, BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class ObservationTable:
    """Observations of P landmarks by K keyframes, N rows; those of a landmark stand together.

    Attributes:
        landmark_ids: P identities, in the order of the rows.
        numbers: of the keyframes, (K,), ascending.
        starts: first row of each landmark, and N, (P + 1,).
        landmark: of each row, an index into ``landmark_ids``, (N,).
        keyframe: of each row, an index into ``numbers``, (N,).
        pixels: left column, row, right column (NaN: no match), px, (N, 3).
        is_first: whether the disparity of the row is the one that placed its landmark, (N,).
    """

    landmark_ids: Sequence[int]
    numbers: Sequence[int]
    starts: NDArray[np.int64]
    landmark: NDArray[np.int64]
    keyframe: NDArray[np.int64]
    pixels: Array
    is_first: BoolArray

    @classmethod
    def of(cls, landmarks: Mapping[int, Landmark], numbers: Sequence[int]) -> Self:
        """All observations of these landmarks, by the keyframes with these numbers."""
        each = landmarks.values()
        counts = np.array([len(landmark.observations) for landmark in each], dtype=np.int64)
        starts = np.concatenate((np.zeros(1, dtype=np.int64), np.cumsum(counts)))
        number = _integers(chain.from_iterable(landmark.observations for landmark in each))
        depth = _integers(-1 if landmark.depth_keyframe is None else landmark.depth_keyframe for landmark in each)
        rows = [pixels for landmark in each for pixels in landmark.observations.values()]
        return cls(
            landmark_ids=list(landmarks),
            numbers=numbers,
            starts=starts,
            landmark=np.repeat(np.arange(len(counts)), counts),
            keyframe=np.searchsorted(np.array(numbers, dtype=np.int64), number),
            pixels=np.concatenate(rows).reshape(-1, 3) if rows else np.zeros((0, 3)),
            is_first=np.repeat(depth, counts) == number,
        )

    def __len__(self) -> int:
        return len(self.pixels)


def _integers(values: Iterable[int]) -> NDArray[np.int64]:
    return np.fromiter(values, dtype=np.int64)

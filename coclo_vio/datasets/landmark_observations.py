# SPDX-License-Identifier: BSD-3-Clause
"""Observations of landmarks by frame, from a table with an entry for every frame and landmark."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.measurements import StereoTracks, TrackingQuality

_NO_OBSERVATION = "the recording has no track in this frame"


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkObservations:
    """The observations only, in the order of the frames: about a hundredth of the table.

    Attributes:
        begins: index of the first observation of each frame, and at the end their number, (frames + 1,).
        ids: the observed landmark, (observations,).
        pixels: columns and rows in the left and in the right image, (observations, 4); NaN on the right where the right
            camera does not observe it.
        landmarks: number of landmarks.
    """

    begins: IntArray
    ids: IntArray
    pixels: Array
    landmarks: int

    @classmethod
    def of(cls, table: Array) -> "LandmarkObservations":
        """From [uL vL uR vR] (4, frames, landmarks), negative or NaN in a camera that does not observe the landmark."""
        in_left, in_right = (
            np.isfinite(table[row]) & np.isfinite(table[row + 1]) & (table[row] >= 0.0) & (table[row + 1] >= 0.0)
            for row in (0, 2)
        )
        frames, ids = np.nonzero(in_left)
        pixels = table[:, frames, ids].T.copy()
        pixels[~in_right[frames, ids], 2:] = np.nan
        begins = np.searchsorted(frames, np.arange(table.shape[1] + 1))
        return cls(begins.astype(np.int64), ids.astype(np.int64), pixels, table.shape[2])

    def tracks(self, order: IntArray, stamps_ns: IntArray) -> Iterator[StereoTracks]:
        """The frames in an order, one at a time; a landmark's age counts the consecutive frames that observe it.

        Args:
            order: indices of the frames, (N,).
            stamps_ns: by frame, nanoseconds, (frames,).
        """
        ages = np.zeros(self.landmarks, dtype=np.int64)
        last_position = np.full(self.landmarks, -2)
        for position, frame in enumerate(order):
            rows = slice(self.begins[frame], self.begins[frame + 1])
            ids = self.ids[rows]
            ages[ids] = np.where(last_position[ids] == position - 1, ages[ids] + 1, 1)
            last_position[ids] = position
            is_empty = len(ids) == 0
            yield StereoTracks(
                int(stamps_ns[frame]),
                ids,
                self.pixels[rows, :2],
                self.pixels[rows, 2:],
                ages[ids],
                TrackingQuality.LOST if is_empty else TrackingQuality.HEALTHY,
                _NO_OBSERVATION if is_empty else "",
            )

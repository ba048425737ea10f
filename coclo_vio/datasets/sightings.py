# SPDX-License-Identifier: BSD-3-Clause
"""Who was seen where in which frame, of a table that holds all frames and all points, seen or not."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.measurements import StereoTracks, TrackingQuality

_NOTHING_SEEN = "the recording has no track in this frame"


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """The sightings alone, in the order of the frames: a hundredth of the table that they come from.

    Attributes:
        begins: where the sightings of a frame begin, and after the last frame their number, (frames + 1,).
        ids: the point seen, (sightings,).
        pixels: columns and rows in the left and in the right image, (sightings, 4); NaN on the right where the right
            camera did not see it.
        points: how many points there are.
    """

    begins: IntArray
    ids: IntArray
    pixels: Array
    points: int

    @classmethod
    def of(cls, table: Array) -> "Sightings":
        """From [uL vL uR vR] (4, frames, points), negative or NaN in a camera that does not see the point."""
        sees_left, sees_right = (
            np.isfinite(table[row]) & np.isfinite(table[row + 1]) & (table[row] >= 0.0) & (table[row + 1] >= 0.0)
            for row in (0, 2)
        )
        frames, ids = np.nonzero(sees_left)
        pixels = table[:, frames, ids].T.copy()
        pixels[~sees_right[frames, ids], 2:] = np.nan
        begins = np.searchsorted(frames, np.arange(table.shape[1] + 1))
        return cls(begins.astype(np.int64), ids.astype(np.int64), pixels, table.shape[2])

    @property
    def frames(self) -> int:
        """How many frames there are."""
        return len(self.begins) - 1

    def tracks(self, order: IntArray, stamps_ns: IntArray) -> Iterator[StereoTracks]:
        """The frames in the order given, one at a time; a point's age counts the frames that saw it without a break.

        Args:
            order: frames, (N,).
            stamps_ns: by frame, nanoseconds, (frames,).
        """
        ages = np.zeros(self.points, dtype=np.int64)
        last_seen = np.full(self.points, -2)
        for turn, frame in enumerate(order):
            mine = slice(self.begins[frame], self.begins[frame + 1])
            ids = self.ids[mine]
            ages[ids] = np.where(last_seen[ids] == turn - 1, ages[ids] + 1, 1)
            last_seen[ids] = turn
            is_blind = len(ids) == 0
            yield StereoTracks(
                int(stamps_ns[frame]),
                ids,
                self.pixels[mine, :2],
                self.pixels[mine, 2:],
                ages[ids],
                TrackingQuality.LOST if is_blind else TrackingQuality.HEALTHY,
                _NOTHING_SEEN if is_blind else "",
            )

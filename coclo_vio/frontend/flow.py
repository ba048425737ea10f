# SPDX-License-Identifier: BSD-3-Clause
"""Pyramidal Lucas-Kanade there and back: the same patch in another image. The one user of calcOpticalFlowPyrLK.

Bouguet, "Pyramidal Implementation of the Lucas Kanade Feature Tracker" (Intel, 2000). A point is kept if following it
back from where it was found ends where it began.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from coclo_vio.values.arrays import Array, BoolArray, ByteImage

_BACK_LEVELS = 1
_LEAST_EIGENVALUE = 1e-4


@dataclass(frozen=True, slots=True)
class LucasKanade:
    """How a patch is followed.

    Attributes:
        window_px: side of the patch, px.
        iterations: most at a level.
        precision_px: a smaller step ends the iterations, px.
        round_trip_px: most error there and back, px.
    """

    window_px: int
    iterations: int
    precision_px: float
    round_trip_px: float

    def follow(
        self, before: ByteImage, after: ByteImage, points: Array, seeds: Array, levels: int
    ) -> tuple[Array, BoolArray]:
        """Where points (N, 2) of one image are in another, (N, 2), and whether each was found, (N,).

        Args:
            before: the image that the points are in.
            after: the other one, of the same size.
            points: columns and rows in ``before``, px.
            seeds: where the search in ``after`` begins, px.
            levels: halvings of the images: the more, the farther it sees.
        """
        if not len(points):
            return np.zeros((0, 2)), np.zeros(0, dtype=np.bool_)
        there, found = self._run(before, after, points, seeds, levels)
        back, returned = self._run(after, before, there, points, _BACK_LEVELS)
        closes = np.abs(back - points).max(axis=1) < self.round_trip_px
        inside = (there >= 0.0).all(axis=1) & (there <= np.array(after.shape[::-1]) - 1.0).all(axis=1)
        return there, found & returned & closes & inside

    def _run(
        self, before: ByteImage, after: ByteImage, points: Array, seeds: Array, levels: int
    ) -> tuple[Array, BoolArray]:
        moved, status, _ = cv2.calcOpticalFlowPyrLK(
            before,
            after,
            np.ascontiguousarray(points[:, None], dtype=np.float32),
            np.ascontiguousarray(seeds[:, None], dtype=np.float32),
            winSize=(self.window_px, self.window_px),
            maxLevel=levels,
            criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, self.iterations, self.precision_px),
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
            minEigThreshold=_LEAST_EIGENVALUE,
        )
        ends = np.asarray(moved, dtype=np.float64).reshape(-1, 2)
        sound = np.asarray(np.isfinite(ends).all(axis=1))
        return np.where(sound[:, None], ends, points), np.asarray(np.ravel(status) > 0) & sound


def evened(image: ByteImage) -> ByteImage:
    """The image (rows, columns) with as many pixels of each brightness: two exposures of one scene look alike in it."""
    return np.asarray(cv2.equalizeHist(image), dtype=np.uint8)

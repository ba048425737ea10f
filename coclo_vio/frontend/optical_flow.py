# SPDX-License-Identifier: BSD-3-Clause
"""Pyramidal Lucas-Kanade with a forward-backward check. The only user of OpenCV's calcOpticalFlowPyrLK.

Bouguet, "Pyramidal Implementation of the Lucas Kanade Feature Tracker" (Intel, 2000). A point is kept if tracking it
backward from where it was found ends where it began.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from coclo_vio.values.arrays import Array, BoolArray, ByteImage

_BACKWARD_LEVELS = 1
_MIN_EIGENVALUE = 1e-4


@dataclass(frozen=True, slots=True)
class LucasKanade:
    """Parameters of the tracker.

    Attributes:
        window_px: side of the window, px.
        iterations: maximum per pyramid level.
        precision_px: a smaller step ends the iterations, px.
        forward_backward_px: maximum error forward and backward, px.
    """

    window_px: int
    iterations: int
    precision_px: float
    forward_backward_px: float

    def track(
        self, previous: ByteImage, current: ByteImage, points: Array, seeds: Array, levels: int
    ) -> tuple[Array, BoolArray]:
        """Positions (N, 2) in the current image of points of the previous one, and whether each was found, (N,).

        Args:
            previous: the image that the points are in, (rows, columns).
            current: the image to search, of the same size.
            points: columns and rows in ``previous``, px, (N, 2).
            seeds: where the search in ``current`` begins, px, (N, 2).
            levels: pyramid levels; each doubles the range of the search.
        """
        if not len(points):
            return np.zeros((0, 2)), np.zeros(0, dtype=np.bool_)
        forward, is_found = self._run(previous, current, points, seeds, levels)
        backward, is_returned = self._run(current, previous, forward, points, _BACKWARD_LEVELS)
        is_closed = np.abs(backward - points).max(axis=1) < self.forward_backward_px
        is_inside = (forward >= 0.0).all(axis=1) & (forward <= np.array(current.shape[::-1]) - 1.0).all(axis=1)
        return forward, is_found & is_returned & is_closed & is_inside

    def _run(
        self, previous: ByteImage, current: ByteImage, points: Array, seeds: Array, levels: int
    ) -> tuple[Array, BoolArray]:
        moved, status, _ = cv2.calcOpticalFlowPyrLK(
            previous,
            current,
            np.ascontiguousarray(points[:, None], dtype=np.float32),
            np.ascontiguousarray(seeds[:, None], dtype=np.float32),
            winSize=(self.window_px, self.window_px),
            maxLevel=levels,
            criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, self.iterations, self.precision_px),
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
            minEigThreshold=_MIN_EIGENVALUE,
        )
        ends = np.asarray(moved, dtype=np.float64).reshape(-1, 2)
        is_finite = np.asarray(np.isfinite(ends).all(axis=1))
        return np.where(is_finite[:, None], ends, points), np.asarray(np.ravel(status) > 0) & is_finite


def equalised(image: ByteImage) -> ByteImage:
    """The image (rows, columns) with an equalised histogram: two exposures of one scene become similar."""
    return np.asarray(cv2.equalizeHist(image), dtype=np.uint8)

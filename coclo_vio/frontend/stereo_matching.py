# SPDX-License-Identifier: BSD-3-Clause
"""From left to right: each point's place in the right image of a rectified pair.

A point whose disparity is about known is followed from there; a new one is found first by comparing its block with all
those on its row that a believable depth allows (normalised correlation, so the two exposures may differ). Then
Lucas-Kanade there and back makes it exact, and gates refuse what rows or depths contradict.
"""

import cv2
import numpy as np

from coclo_vio.arrays import Array, BoolArray, ByteImage
from coclo_vio.calibration import RectifiedStereo
from coclo_vio.frontend.config import StereoConfig
from coclo_vio.frontend.flow import LucasKanade
from coclo_vio.frontend.rectification import RectifiedPair

_BLOCK_ROWS = 1  # a block may be found so many rows higher or lower


class StereoMatcher:
    """Matches the points of one pair of cameras."""

    def __init__(self, rig: RectifiedStereo, seen_right: ByteImage, config: StereoConfig) -> None:
        self._config = config
        self._seen_right = seen_right
        columns = seen_right.shape[1]
        self._most_disparity = min(rig.focal_px[0] * rig.baseline_m / config.nearest_m, 0.5 * columns)
        self._flow = LucasKanade(config.window_px, config.levels, 30, 0.01, config.round_trip_px)

    def match(self, pair: RectifiedPair, left_px: Array, expected_disparity: Array) -> Array:
        """Columns and rows (N, 2) in the right image; NaN where a point was not found there.

        Args:
            pair: the rectified images.
            left_px: points (N, 2) in the left one.
            expected_disparity: about how large it is, px, (N,); NaN where that is not known.
        """
        disparity = expected_disparity.copy()
        for index in np.flatnonzero(~np.isfinite(disparity)):
            disparity[index] = self._searched(pair, left_px[index])
        right_px = np.full((len(left_px), 2), np.nan)
        known = np.flatnonzero(np.isfinite(disparity))
        seeds = left_px[known] - np.column_stack((disparity[known], np.zeros(len(known))))
        found, kept = self._flow.follow(pair.left, pair.right, left_px[known], seeds)
        kept &= self._is_believable(left_px[known], found)
        right_px[known[kept]] = found[kept]
        return right_px

    def _is_believable(self, left_px: Array, right_px: Array) -> BoolArray:
        config = self._config
        disparity, rows = (left_px - right_px).T
        near = np.rint(right_px).astype(np.int64)
        limits = np.array(self._seen_right.shape) - 1
        row, column = np.clip(near[:, 1], 0, limits[0]), np.clip(near[:, 0], 0, limits[1])
        return np.asarray(
            (disparity > config.least_disparity_px)
            & (disparity < self._most_disparity)
            & (np.abs(rows) < config.row_difference_px)
            & (self._seen_right[row, column] > 0)
        )

    def _searched(self, pair: RectifiedPair, point: Array) -> float:
        """Disparity (whole pixels) of the block most like that about a point (2,); NaN if none or several are."""
        half, rows = self._config.block_px // 2, _BLOCK_ROWS
        height, width = pair.left.shape
        column, row = (int(value) for value in np.rint(point))
        if not (half + rows <= row < height - half - rows and half <= column < width - half):
            return np.nan
        block = pair.left[row - half : row + half + 1, column - half : column + half + 1]
        first = max(column - int(self._most_disparity) - half, 0)
        strip = pair.right[row - half - rows : row + half + rows + 1, first : min(column + half + 2, width)]
        if strip.shape[1] < block.shape[1]:
            return np.nan
        scores = np.asarray(cv2.matchTemplate(strip, block, cv2.TM_CCOEFF_NORMED)).max(axis=0)
        scores = np.where(np.isfinite(scores), scores, 0.0)
        best = int(scores.argmax())
        rivals = np.concatenate((scores[: max(best - 2, 0)], scores[best + 3 :]))
        score = float(scores[best])
        is_clear = not len(rivals) or float(rivals.max()) < self._config.block_rival * score
        return float(column - half - first - best) if score > self._config.block_score and is_clear else np.nan

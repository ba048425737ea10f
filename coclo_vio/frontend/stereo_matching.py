# SPDX-License-Identifier: BSD-3-Clause
"""From left to right: each point's place in the right image of a rectified pair.

A point whose disparity is about known is sought there; a new one is found first by comparing its block with all those
on its row that a believable depth allows (normalised correlation, so the two exposures may differ). Then its patch is
aligned, with the slant of the surface, and gates refuse what rows, depths or the look of it contradict.
"""

from dataclasses import replace

import cv2
import numpy as np

from coclo_vio.frontend.config import LikenessConfig, StereoConfig
from coclo_vio.frontend.patches import PatchAligner, SmoothPair, alike
from coclo_vio.frontend.rectification import RectifiedPair
from coclo_vio.frontend.tracks import LiveTracks
from coclo_vio.values.arrays import Array, BoolArray, ByteImage
from coclo_vio.values.calibration import RectifiedStereo

_BLOCK_ROWS = 1  # a block may be found so many rows higher or lower
_ANYWHERE_PX = 100.0


class StereoMatcher:
    """Matches the points of one pair of cameras."""

    def __init__(
        self,
        rig: RectifiedStereo,
        seen_right: ByteImage,
        aligner: PatchAligner,
        config: StereoConfig,
        likeness: LikenessConfig,
    ) -> None:
        self._config = config
        self._likeness = likeness
        self._aligner = aligner
        self._seen_right = seen_right
        columns = seen_right.shape[1]
        self._most_disparity = min(rig.focal_px[0] * rig.baseline_m / config.nearest_m, 0.5 * columns)
        self._spreads = np.array([_ANYWHERE_PX, config.row_spread_px, config.slant_spread, config.slant_spread])

    def match(self, pair: RectifiedPair, smooth: SmoothPair, tracks: LiveTracks) -> LiveTracks:
        """The points at their places in the right image, NaN where they were not found there, with their slants.

        Args:
            pair: the rectified images.
            smooth: the same, smoothed.
            tracks: the points at their places in the left one, and in the right one as far as they are known already.
        """
        disparity = tracks.disparity
        is_due = (tracks.ages == 1) | ((tracks.ids + tracks.ages) % self._config.retry_frames == 0)
        for index in np.flatnonzero(np.isnan(disparity) & is_due):
            disparity[index] = self._searched(pair, tracks.left_px[index])
        right_px, slants = np.full((len(tracks), 2), np.nan), np.zeros((len(tracks), 2))
        known = np.flatnonzero(np.isfinite(disparity))
        points, count = tracks.left_px[known], len(known)
        start = np.zeros((count, 6))
        start[:, 0], start[:, 2:4] = -disparity[known], -tracks.slants[known]
        upright = np.tile(np.eye(2), (count, 1, 1))
        templates = self._aligner.templates(smooth.left, points, len(self._spreads))
        found = self._aligner.align(templates, smooth.right, points, upright, self._spreads, start)
        kept = alike(found, self._likeness) & self._is_believable(points, found.centres)
        kept &= np.abs(points[:, 0] - found.centres[:, 0] - disparity[known]) < self._config.correction_px
        right_px[known[kept]] = found.centres[kept]
        slants[known[kept]] = (upright - found.shapes)[kept, 0]
        return replace(tracks, right_px=right_px, slants=slants)

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
            & (right_px[:, 0] > 0.0)
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

# SPDX-License-Identifier: BSD-3-Clause
"""Stereo matching: each point's pixel in the right image of a rectified pair.

A point of about known disparity is searched there. A new one is first searched as a block along its row, within the
limits of disparity, by normalised correlation, so the two exposures may differ. Then its patch is aligned, with the
slant of the surface, and gates reject it by its row, its disparity or its similarity.
"""

from dataclasses import replace

import numpy as np

from coclo_vio.frontend.config import SimilarityConfig, StereoConfig
from coclo_vio.frontend.pair_calibration import PairCalibration
from coclo_vio.frontend.patches import FREE_PX, PatchAligner, SmoothPair, are_similar
from coclo_vio.frontend.rectification import RectifiedPair
from coclo_vio.frontend.row_search import RowSearch
from coclo_vio.frontend.tracks import ActiveTracks
from coclo_vio.values.arrays import Array, BoolArray, ByteImage
from coclo_vio.values.calibration import RectifiedStereo


class StereoMatcher:
    """Matches the points of one stereo pair."""

    def __init__(
        self,
        rig: RectifiedStereo,
        valid_right: ByteImage,
        aligner: PatchAligner,
        config: StereoConfig,
        similarity: SimilarityConfig,
        calibration: PairCalibration,
    ) -> None:
        self._config = config
        self._similarity = similarity
        self._calibration = calibration
        self._aligner = aligner
        self._valid_right = valid_right
        columns = valid_right.shape[1]
        self._max_disparity = min(rig.focal_px[0] * rig.baseline_m / config.min_depth_m, 0.5 * columns)
        self._search = RowSearch(
            config.block_px // 2, int(self._max_disparity), config.min_block_correlation, config.uniqueness_ratio
        )
        self._sigmas = np.array([FREE_PX, config.row_sigma_px, config.slant_sigma, config.slant_sigma])

    def match(self, pair: RectifiedPair, smooth: SmoothPair, tracks: ActiveTracks) -> ActiveTracks:
        """The tracks with their pixels in the right image, NaN where not matched, and their slants.

        Args:
            pair: the rectified images.
            smooth: the same, smoothed.
            tracks: at their pixels in the left image; right pixels, where known, are predictions.
        """
        disparity = tracks.disparity
        is_due = (tracks.ages == 1) | ((tracks.ids + tracks.ages) % self._config.retry_frames == 0)
        searched = np.flatnonzero(np.isnan(disparity) & is_due)
        disparity[searched] = self._search.disparities(pair.left, pair.right, tracks.left_px[searched])
        right_px, slants = np.full((len(tracks), 2), np.nan), np.zeros((len(tracks), 2))
        known = np.flatnonzero(np.isfinite(disparity))
        points, count = tracks.left_px[known], len(known)
        start = np.zeros((count, 6))
        start[:, 0], start[:, 2:4] = -disparity[known], -tracks.slants[known]
        identity = np.tile(np.eye(2), (count, 1, 1))
        templates = self._aligner.templates(smooth.left, points, self._sigmas)
        expected = points.copy()
        expected[:, 1] += self._calibration.rows(points, disparity[known])
        found = self._aligner.align(templates, smooth.right, expected, identity, start)
        kept = are_similar(found, self._similarity) & self._passes_gates(expected, found.centres)
        kept &= np.abs(points[:, 0] - found.centres[:, 0] - disparity[known]) < self._config.max_correction_px
        right_px[known[kept]] = found.centres[kept]
        slants[known[kept]] = (identity - found.warps)[kept, 0]
        return replace(tracks, right_px=right_px, slants=slants)

    def row_sigmas(self, smooth: SmoothPair, left_px: Array) -> Array:
        """One sigma of the row of a match of points (N, 2), px, (N,): that of its prior where texture shows no row."""
        templates = self._aligner.templates(smooth.left, left_px, self._sigmas)
        return np.asarray(self._aligner.sigmas(templates)[:, 1])

    def _passes_gates(self, left_px: Array, right_px: Array) -> BoolArray:
        """Whether disparity, row and right pixel of matches (N, 2) are within their limits, (N,)."""
        config = self._config
        disparity, rows = (left_px - right_px).T
        nearest = np.rint(right_px).astype(np.int64)
        limits = np.array(self._valid_right.shape) - 1
        row, column = np.clip(nearest[:, 1], 0, limits[0]), np.clip(nearest[:, 0], 0, limits[1])
        return np.asarray(
            (disparity > config.min_disparity_px)
            & (disparity < self._max_disparity)
            & (np.abs(rows) < config.max_row_difference_px)
            & (right_px[:, 0] > 0.0)
            & (self._valid_right[row, column] > 0)
        )

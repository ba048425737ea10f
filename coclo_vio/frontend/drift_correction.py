# SPDX-License-Identifier: BSD-3-Clause
"""Correction of drift: each tracked point is aligned with its reference template.

Lucas-Kanade from frame to frame accumulates its small errors. Here the patch of the reference frame, warped as the
motion of its plane predicts, corrects the position in every frame. A point that is detected, or that has grown or
shrunk much, gets its reference template from the current frame.
"""

from dataclasses import replace

import numpy as np

from coclo_vio.frontend.config import DriftConfig, SimilarityConfig
from coclo_vio.frontend.patch_alignment import Templates
from coclo_vio.frontend.patches import FREE_PX, PatchAligner, are_similar
from coclo_vio.frontend.tracks import ActiveTracks
from coclo_vio.values.arrays import Array, BoolArray, FloatImage


class DriftCorrector:
    """Corrects the positions of tracked points."""

    def __init__(self, aligner: PatchAligner, config: DriftConfig, similarity: SimilarityConfig) -> None:
        self._aligner = aligner
        self._config = config
        self._similarity = similarity
        self._sigmas = np.array([FREE_PX, FREE_PX, *[config.warp_sigma] * 4])

    def templates(self, smooth_left: FloatImage, left_px: Array) -> Templates:
        """Reference templates of points (N, 2), px, in the smoothed left image (rows, columns)."""
        return self._aligner.templates(smooth_left, left_px, self._sigmas)

    def correct(
        self, smooth_left: FloatImage, tracks: ActiveTracks, is_certain: BoolArray
    ) -> tuple[ActiveTracks, BoolArray]:
        """The tracks at corrected positions, and whether each is still similar to its template, (N,).

        Args:
            smooth_left: the left image, smoothed, (rows, columns).
            tracks: points at their positions from Lucas-Kanade, with the warps that the motion predicts.
            is_certain: points whose positions are kept even if most points are dissimilar, as in a blurred frame, (N,).
        """
        found = self._aligner.align(tracks.templates, smooth_left, tracks.left_px, tracks.warps)
        is_near = np.abs(found.centres - tracks.left_px).max(axis=1) < self._config.max_correction_px
        is_similar = are_similar(found, self._similarity) & is_near
        if is_certain.any() and is_similar.mean() < 1.0 - self._config.dissimilar_share:
            everyone = np.ones(len(tracks), dtype=np.bool_)
            return self._with_new_templates(smooth_left, tracks, everyone), is_similar | is_certain
        bent = self._aligner.bend_shifts(tracks.templates, tracks.bends)
        centres = found.centres - np.matmul(found.warps, bent[:, :, None])[:, :, 0]
        left_px = np.where(is_similar[:, None], centres, tracks.left_px)
        moved = replace(tracks, left_px=left_px, warps=found.warps)
        is_outdated = is_similar & self._is_stretched(found.warps)
        return self._with_new_templates(smooth_left, moved, is_outdated), is_similar

    def _is_stretched(self, warps: Array) -> BoolArray:
        """Whether the largest scale of a warp (N, 2, 2) or the inverse of its smallest one is beyond the limit, (N,).

        The singular values of a matrix ``[[a, b], [c, d]]`` are half of ``|(a + d, c - b)| +- |(a - d, b + c)|``.
        """
        (a, b), (c, d) = warps.transpose(1, 2, 0)
        similar, skewed = np.hypot(a + d, c - b), np.hypot(a - d, b + c)
        limit = 2.0 * self._config.max_stretch
        return np.asarray((similar + skewed > limit) | (np.abs(similar - skewed) * limit < 4.0))

    def _with_new_templates(self, smooth_left: FloatImage, tracks: ActiveTracks, chosen: BoolArray) -> ActiveTracks:
        """The tracks; the chosen ones get their reference templates from this image."""
        if not chosen.any():
            return tracks
        templates = self.templates(smooth_left, tracks.left_px[chosen])
        warps = np.where(chosen[:, None, None], np.eye(2), tracks.warps)
        bends = np.where(chosen[:, None], 0.0, tracks.bends)
        return replace(tracks, templates=tracks.templates.replaced(chosen, templates), warps=warps, bends=bends)

# SPDX-License-Identifier: BSD-3-Clause
"""Against creeping away: each followed point is compared with what it looked like when it was anchored.

Lucas-Kanade from frame to frame adds its small errors up. Here the patch of the anchoring frame, stretched and sheared
as the motion of its plane predicts, corrects the place in every frame. A point that grew or shrank much, or was seen
anew, is anchored where it is now.
"""

from dataclasses import replace

import numpy as np

from coclo_vio.frontend.config import AnchorConfig, LikenessConfig
from coclo_vio.frontend.patches import FloatArray, PatchAligner, alike
from coclo_vio.frontend.tracks import LiveTracks
from coclo_vio.values.arrays import Array, BoolArray

_ANYWHERE_PX = 100.0


class Anchoring:
    """Corrects the places of followed points."""

    def __init__(self, aligner: PatchAligner, config: AnchorConfig, likeness: LikenessConfig) -> None:
        self._aligner = aligner
        self._config = config
        self._likeness = likeness
        self._spreads = np.array([_ANYWHERE_PX, _ANYWHERE_PX, *[config.shape_spread] * 4])

    def corrected(
        self, smooth_left: FloatArray, tracks: LiveTracks, believed: BoolArray
    ) -> tuple[LiveTracks, BoolArray]:
        """The tracks at corrected places, and which still look as they did, (N,).

        Args:
            smooth_left: the left image, smoothed.
            tracks: points where Lucas-Kanade has found them, with the shapes that their motion predicts.
            believed: whose places are right even if most points look different, as in a blurred frame, (N,).
        """
        found = self._aligner.align(tracks.templates, smooth_left, tracks.left_px, tracks.shapes, self._spreads)
        near = np.abs(found.centres - tracks.left_px).max(axis=1) < self._config.correction_px
        same = alike(found, self._likeness) & near
        if believed.any() and same.mean() < 1.0 - self._config.lost_share:
            return self._anchored(smooth_left, tracks, np.ones(len(tracks), dtype=np.bool_)), same | believed
        places = np.where(same[:, None], found.centres, tracks.left_px)
        moved = replace(tracks, left_px=places, shapes=found.shapes)
        return self._anchored(smooth_left, moved, same & self._is_stretched(found.shapes)), same

    def _is_stretched(self, shapes: Array) -> BoolArray:
        lengths = np.linalg.svd(shapes, compute_uv=False)
        return np.asarray((lengths[:, 0] > self._config.stretch) | (lengths[:, 1] < 1.0 / self._config.stretch))

    def _anchored(self, smooth_left: FloatArray, tracks: LiveTracks, chosen: BoolArray) -> LiveTracks:
        """The tracks, the chosen ones anchored where they are."""
        if not chosen.any():
            return tracks
        fresh = self._aligner.templates(smooth_left, tracks.left_px[chosen])
        shapes = np.where(chosen[:, None, None], np.eye(2), tracks.shapes)
        return replace(tracks, templates=tracks.templates.replaced(chosen, fresh), shapes=shapes)

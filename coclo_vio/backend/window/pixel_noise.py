# SPDX-License-Identifier: BSD-3-Clause
"""Noise of tracks and disparities in this recording: the configured sigmas, times a scale that residuals show.

Front ends, lenses, textures and light differ by a factor of ten in their pixel noise. Where sigmas are too large,
wrong matches of a few pixels pass as inliers, and motion by vision weighs too little; where they are too small, both
are the other way round. The window is overdetermined, so its residuals show the scale.
Source: the scale of an M-estimator, Huber, "Robust Statistics", 1981, chapter 7; variance components, Koch 1999.
"""

import numpy as np

from coclo_vio.backend.window.config import PixelNoiseConfig
from coclo_vio.values.arrays import Array

_MEDIAN_OF_NORMAL = 0.6745  # of absolute values, in sigmas
_FEWEST_REDUNDANT = 60  # rows beyond the parameters, below which residuals do not show a scale
_MOST_GROWTH = 1.5
_APPLIED_STEP = 0.1  # relative change of the scale from which it is applied


class PixelNoise:
    """Sigmas that follow what the windows of a recording show.

    The scale is a weighted geometric mean of 1, with the weight of ``prior_windows``, and of the scales of the
    windows, whose weights fade with ``memory_windows``; a median, so wrong matches hardly enter.

    Errors that repeat, such as the drift of a track off its point, hardly enter residuals. So a weight follows the
    residuals down to ``least_scale`` only, the limits from which an observation counts as a wrong match further down.
    Where a front end finds few points, those are the ends of edges and the crossings of lines at different depths: a
    large share of them moves together, and not as a point of the world does. The mean of their errors does not shrink
    with their number, so ``least_scale`` grows as the root of ``ample_tracks`` over the number of tracks.

    Attributes:
        shown: scale that the residuals show, as applied.
        scarcity: factor on ``least_scale``, as applied.
    """

    def __init__(self, config: PixelNoiseConfig) -> None:
        self._config = config
        self.shown, self.scarcity = 1.0, 1.0
        self._weight, self._sum = 0.0, 0.0  # of logarithms of the windows' scales

    @property
    def scale(self) -> float:
        """Of the configured sigmas."""
        return max(self.shown, self._config.least_scale * self.scarcity)

    @property
    def track_px(self) -> float:
        """One sigma of a track."""
        return self._config.track_px * self.scale

    @property
    def disparity_px(self) -> float:
        """One sigma of a landmark's first disparity."""
        return self._config.disparity_px * self.scale

    @property
    def repeated_disparity_px(self) -> float:
        """One sigma of its later disparities."""
        return self._config.repeated_disparity_px * self.scale

    @property
    def huber(self) -> float:
        """In sigmas, as in the configuration of what the residuals show."""
        return self._config.huber * self.shown / self.scale

    @property
    def outlier(self) -> float:
        """In sigmas, as in the configuration of what the residuals show."""
        return self._config.outlier * self.shown / self.scale

    def count(self, tracks: int) -> None:
        """Take the number of tracks of a keyframe."""
        if not self._config.is_learnt:
            return
        fewest = self._config.ample_tracks * (self._config.least_scale / self._config.largest_scale) ** 2
        scarcity = float(np.sqrt(max(1.0, self._config.ample_tracks / max(tracks, fewest))))
        if abs(np.log(scarcity / self.scarcity)) > _APPLIED_STEP:
            self.scarcity = scarcity

    def learn(self, residuals_px: Array, landmarks: int) -> None:
        """Take the residuals at the minimum of a window.

        Args:
            residuals_px: [left column, row, right column or NaN], observed less projected, (N, 3).
            landmarks: how many points were estimated by these.
        """
        if not self._config.is_learnt:
            return
        rows = 2 * len(residuals_px) + int(np.count_nonzero(~np.isnan(residuals_px[:, 2])))
        redundant = rows - 3 * landmarks
        if redundant < _FEWEST_REDUNDANT:
            return
        size_px = float(np.median(np.abs(residuals_px[:, :2]))) / _MEDIAN_OF_NORMAL * np.sqrt(rows / redundant)
        shown = float(np.clip(size_px / self._config.track_px, self._config.least_shown, self._config.largest_scale))
        shown = min(shown, _MOST_GROWTH * self.shown)  # one window of wrong matches does not decide
        kept = 1.0 - 1.0 / self._config.memory_windows
        self._weight, self._sum = kept * self._weight + 1.0, kept * self._sum + float(np.log(shown))
        scale = float(np.exp(self._sum / (self._weight + self._config.prior_windows)))
        if abs(np.log(scale / self.shown)) > _APPLIED_STEP:
            self.shown = scale

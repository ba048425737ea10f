# SPDX-License-Identifier: BSD-3-Clause
"""A disparity that is wrong by the same amount everywhere, found by how points move past.

Where the right camera is turned about its vertical axis, or its principal point is off, every disparity is wrong by one
offset: a tenth of a pixel makes points at 3 m seem 1.6 % nearer with a baseline of 5 cm and 383 px, and points at 6 m
3 %. Rows do not show it. The motion does: left images from several keyframes triangulate a point too, except for the
scale of the motion. With ``d`` the disparity by that, the measured one is ``d + offset + scale d``, and points at
different distances separate the two. The scale is that of the window's path, which stays as it is.
"""

import numpy as np

from coclo_vio.backend.window.config import DisparityOffsetConfig
from coclo_vio.geometry.recursive_regression import RecursiveRegression
from coclo_vio.values.arrays import Array


class DisparityOffset:
    """Follows the offset over a recording.

    Attributes:
        px: measured less true disparity, px.
    """

    def __init__(self, config: DisparityOffsetConfig) -> None:
        self._is_estimated = config.is_estimated
        self.px = 0.0
        self.regression = RecursiveRegression(
            np.array([config.sigma_px, config.scale_sigma]),
            config.point_sigma_px,
            config.least_point_sigma_px,
            config.memory_points,
        )

    def learn(self, measured_px: Array, moved_px: Array, sigma_px: Array) -> None:
        """Take points that no earlier call had.

        Args:
            measured_px: disparities, less the offset so far, (N,).
            moved_px: disparities by the motion, (N,).
            sigma_px: of these by the noise of the tracks, (N,).
        """
        if self._is_estimated:
            rows = np.column_stack((np.ones(len(moved_px)), moved_px))
            self.regression.learn(rows, measured_px + self.px - moved_px, sigma_px)
            self.px = float(self.regression.estimate[0])

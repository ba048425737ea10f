# SPDX-License-Identifier: BSD-3-Clause
"""Errors of the right camera's calibration against the left one, found by the rows of matches.

In rectified images the two pixels of a point are in one row. Where the right camera is turned by a small ``w``,
displaced by ``t_y, t_z`` baselines, or has a focal length that is longer by a share ``s``, its pixel of a point in the
direction ``(x, y)`` and with the disparity ``d`` is off, in units of the focal length, by

    row         w_x y^2 - w_y x y - w_z x - t_y d + t_z y d + s y + c
    column      w_z y + t_z x d + s x

with ``c`` by a turn about x and by the principal point. Disparities are corrected by the column: a roll of half a
milliradian, as by a shock or warmth, makes distances of 3 m at the bottom of an image wrong by 1.5 % with a baseline of
5 cm and 383 px, and those at its top by as much the other way. The column would be off by ``w_x x y - w_y (1 + x^2)``
besides. This is not corrected: rows do not show whether the principal point makes up for the offset, and errors of
lenses make the same rows. On a KITTI drive they look like a turn of 9 mrad, and disparities corrected by it are worse.
The offset shows in the motion (``backend.window.disparity_offset``), a wrong length of the baseline nowhere.
Source: Dang, Hoffmann and Stiller, "Continuous stereo self-calibration by camera parameter tracking", IEEE TIP 2009.
"""

import numpy as np

from coclo_vio.frontend.config import PairConfig
from coclo_vio.geometry.recursive_regression import RecursiveRegression
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import RectifiedStereo


class PairCalibration:
    """Follows the errors of the right camera; each match counts once, when its point is first found in both images."""

    def __init__(self, rig: RectifiedStereo, config: PairConfig) -> None:
        """Take the pair after rectification, and how wrong it may be."""
        self._focal, self._centre = np.array(rig.focal_px), np.array(rig.principal_point_px)
        turn, across = config.rotation_sigma_rad, config.displacement_sigma
        sigmas = np.array([turn, turn, turn, across, across, config.focal_sigma, config.row_offset_px / self._focal[1]])
        self._regression = RecursiveRegression(
            sigmas, config.row_sigma_px, config.least_row_sigma_px, config.memory_matches
        )

    @property
    def errors(self) -> Array:
        """Turns ``w`` (3,), rad, displacements ``t_y, t_z``, ``s`` and ``c``, (7,)."""
        return self._regression.estimate

    @property
    def sigmas(self) -> Array:
        """One sigma of each error, (7,)."""
        return self._regression.sigmas

    def rows(self, left_px: Array, disparity: Array) -> Array:
        """Row in the right image less that in the left one, px, (N,).

        Args:
            left_px: columns and rows in the left image, (N, 2).
            disparity: px, (N,).
        """
        return np.asarray(self._jacobians(left_px, disparity)[1] @ self.errors)

    def row_sigmas(self, left_px: Array, disparity: Array) -> Array:
        """One sigma of ``rows``, px, (N,)."""
        by_row = self._jacobians(left_px, disparity)[1]
        return np.asarray(np.sqrt(np.einsum("ni,ij,nj->n", by_row, self._regression.covariance, by_row)))

    def corrected(self, left_px: Array, right_px: Array) -> Array:
        """The pixels in the right image (N, 2) of a pair without these errors; NaN remains.

        Args:
            left_px: columns and rows in the left image, (N, 2).
            right_px: the same in the right image, as matched, (N, 2).
        """
        by_column, by_row = self._jacobians(left_px, left_px[:, 0] - right_px[:, 0])
        return np.asarray(right_px - np.column_stack((by_column @ self.errors, by_row @ self.errors)))

    def learn(self, left_px: Array, right_px: Array) -> None:
        """Take matches that no earlier call had, columns and rows in both images, (N, 2)."""
        by_row = self._jacobians(left_px, left_px[:, 0] - right_px[:, 0])[1]
        self._regression.learn(by_row, right_px[:, 1] - left_px[:, 1])

    def _jacobians(self, left_px: Array, disparity: Array) -> tuple[Array, Array]:
        """Of columns and of rows in the right image, px, by the errors, (N, 7) each."""
        x, y = ((left_px - self._centre) / self._focal).T
        d = disparity / self._focal[0]
        x = x - d
        one, none = np.ones_like(x), np.zeros_like(x)
        columns = np.column_stack((none, none, y, none, x * d, x, none))
        rows = np.column_stack((y * y, -x * y, -x, -d, y * d, y, one))
        return self._focal[0] * columns, self._focal[1] * rows

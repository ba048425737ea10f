# SPDX-License-Identifier: BSD-3-Clause
"""One rigid motion must explain the tracks: RANSAC on the last frame's stereo points and their pixels in this one.

Samples of three points (P3P: Gao et al. 2003), inliers by reprojection error, refined on all inliers. OpenCV seeds its
random generator anew with each call: same input, same answer.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from coclo_vio.frontend.config import MotionCheckConfig
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.calibration import RectifiedStereo

_MIN_DEPTH_M = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class MotionEstimate:
    """Motion of the camera between two frames and the tracks that agree with it.

    Attributes:
        T_previous_current: maps current camera coordinates to previous, (4, 4); None if no motion was found.
        is_inlier: False for tracks that contradict the motion; True for those that could not be checked, (N,).
        checked: number of tracks that were checked.
        inliers: number of those that agree with the motion.
    """

    T_previous_current: Array | None
    is_inlier: BoolArray
    checked: int
    inliers: int


class MotionCheck:
    """Checks the tracks of one stereo pair."""

    def __init__(self, rig: RectifiedStereo, config: MotionCheckConfig) -> None:
        self._rig = rig
        self._config = config

    def check(
        self, points: Array, is_known: BoolArray, current_left_px: Array, *, is_aligned: bool = False
    ) -> MotionEstimate:
        """Estimate the motion and find the tracks that contradict it.

        Args:
            points: in the last left camera's frame, m, (N, 3).
            is_known: whether their depths are known, (N,); the others are not checked.
            current_left_px: their columns and rows in this frame's left image, px, (N, 2).
            is_aligned: whether their patches have been aligned; selects the threshold.
        """
        limit_px = self._config.max_aligned_error_px if is_aligned else self._config.max_error_px
        everyone = np.ones(len(current_left_px), dtype=np.bool_)
        known = np.flatnonzero(is_known)
        if len(known) < self._config.min_points:
            return MotionEstimate(None, everyone, 0, 0)
        points, pixels = points[known], current_left_px[known]
        T_current_previous = self._motion(points, pixels, limit_px)
        if T_current_previous is None:
            return MotionEstimate(None, everyone, len(known), 0)
        is_outlier = self._errors(T_current_previous, points, pixels) > limit_px
        inliers = len(known) - int(is_outlier.sum())
        if inliers < max(self._config.min_points, self._config.min_inlier_share * len(known)):
            return MotionEstimate(None, everyone, len(known), inliers)
        is_inlier = everyone
        is_inlier[known[is_outlier]] = False
        return MotionEstimate(se3.inverse(T_current_previous), is_inlier, len(known), inliers)

    def _motion(self, points: Array, pixels: Array, limit_px: float) -> Array | None:
        """``T_current_previous`` (4, 4) of points (N, 3), m, and their pixels (N, 2) now; None if none was found."""
        camera_matrix = self._rig.camera_matrix
        try:
            is_found, rotvec, translation, inliers = cv2.solvePnPRansac(
                points,
                pixels,
                camera_matrix,
                None,
                iterationsCount=self._config.iterations,
                reprojectionError=limit_px,
                confidence=self._config.confidence,
                flags=cv2.SOLVEPNP_P3P,
            )
            if not is_found or inliers is None or len(inliers) < self._config.min_points:
                return None
            chosen = np.asarray(inliers).ravel()
            rotvec, translation = cv2.solvePnPRefineLM(
                points[chosen], pixels[chosen], camera_matrix, None, rotvec, translation
            )
        except cv2.error:  # degenerate points
            return None
        rotation, _ = cv2.Rodrigues(rotvec)
        T = se3.transform(np.asarray(rotation, dtype=np.float64), np.asarray(translation, dtype=np.float64).ravel())
        return T if np.isfinite(T).all() else None

    def _errors(self, T_current_previous: Array, points: Array, pixels: Array) -> Array:
        """Reprojection errors, px, (N,); infinite behind the camera."""
        moved = se3.apply(T_current_previous, points)
        is_ahead = moved[:, 2] > _MIN_DEPTH_M
        projected, _ = self._rig.pixels(np.where(is_ahead[:, None], moved, [0.0, 0.0, 1.0]))
        return np.where(is_ahead, np.linalg.norm(projected - pixels, axis=1), np.inf)

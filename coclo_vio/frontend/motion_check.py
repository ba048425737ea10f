# SPDX-License-Identifier: BSD-3-Clause
"""One rigid motion must explain the tracks: RANSAC on the points of the last frame and where they are seen now.

Samples of three points (P3P: Gao et al. 2003), counted by reprojection, refined on all that agree. OpenCV draws the
samples from a generator of its own that starts anew with each call: same input, same answer.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from coclo_vio.frontend.config import MotionCheckConfig
from coclo_vio.frontend.tracks import LiveTracks
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.calibration import RectifiedStereo


@dataclass(frozen=True, slots=True, eq=False)
class MotionVerdict:
    """What the check found.

    Attributes:
        T_previous_current: the motion, maps current camera coordinates to previous, (4, 4); None if none was found.
        agrees: tracks that the motion explains, or that could not be judged, (N,).
        judged: tracks that were judged.
        agreeing: how many of those the motion explains.
    """

    T_previous_current: Array | None
    agrees: BoolArray
    judged: int
    agreeing: int

    @property
    def share(self) -> float:
        """Share of the judged tracks that agree; 1 where none was judged."""
        return self.agreeing / self.judged if self.judged else 1.0


class MotionCheck:
    """Judges tracks of one pair of cameras."""

    def __init__(self, rig: RectifiedStereo, config: MotionCheckConfig) -> None:
        self._rig = rig
        self._config = config
        (fx, fy), (cx, cy) = rig.focal_px, rig.principal_point_px
        self._matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    def judge(self, previous: LiveTracks, current_left_px: Array, *, is_fine: bool = False) -> MotionVerdict:
        """Which tracks one motion explains.

        Args:
            previous: the points in the last frame; those of unknown disparity are not judged.
            current_left_px: where they are now, (N, 2).
            is_fine: whether that is after their patches have been aligned.
        """
        limit_px = self._config.fine_error_px if is_fine else self._config.error_px
        everyone = np.ones(len(current_left_px), dtype=np.bool_)
        known = np.flatnonzero(previous.has_right)
        undecided = MotionVerdict(None, everyone, 0, 0)
        if len(known) < self._config.least_points:
            return undecided
        points = self._rig.points(previous.left_px[known], previous.disparity[known])
        T_current_previous = self._motion(points, current_left_px[known], limit_px)
        if T_current_previous is None:
            return MotionVerdict(None, everyone, len(known), 0)
        wrong = self._errors(T_current_previous, points, current_left_px[known]) > limit_px
        agreeing = len(known) - int(wrong.sum())
        if agreeing < max(self._config.least_points, self._config.least_share * len(known)):
            return MotionVerdict(None, everyone, len(known), agreeing)
        agrees = everyone
        agrees[known[wrong]] = False
        return MotionVerdict(se3.inverse(T_current_previous), agrees, len(known), agreeing)

    def _motion(self, points: Array, pixels: Array, limit_px: float) -> Array | None:
        """``T_current_previous`` (4, 4) of points (N, 3) and where they are seen (N, 2); None where there is none."""
        try:
            found, turn, shift, inliers = cv2.solvePnPRansac(
                points,
                pixels,
                self._matrix,
                None,
                iterationsCount=self._config.iterations,
                reprojectionError=limit_px,
                confidence=self._config.confidence,
                flags=cv2.SOLVEPNP_P3P,
            )
            if not found or inliers is None or len(inliers) < self._config.least_points:
                return None
            chosen = np.asarray(inliers).ravel()
            turn, shift = cv2.solvePnPRefineLM(points[chosen], pixels[chosen], self._matrix, None, turn, shift)
        except cv2.error:  # of points that no camera could see so
            return None
        rotation, _ = cv2.Rodrigues(turn)
        T = se3.transform(np.asarray(rotation, dtype=np.float64), np.asarray(shift, dtype=np.float64).ravel())
        return T if np.isfinite(T).all() else None

    def _errors(self, T_current_previous: Array, points: Array, pixels: Array) -> Array:
        """Distance (N,), px, from where the motion puts the points to where they are seen."""
        moved = se3.apply(T_current_previous, points)
        ahead = moved[:, 2] > 1e-3
        seen, _ = self._rig.pixels(np.where(ahead[:, None], moved, [0.0, 0.0, 1.0]))
        return np.where(ahead, np.linalg.norm(seen - pixels, axis=1), np.inf)

# SPDX-License-Identifier: BSD-3-Clause
"""Tracking of the last frame's points: Lucas-Kanade, outlier rejection by one rigid motion, alignment of patches.

The motion of the inliers predicts where points that were lost or went astray are to be searched, and how every patch is
warped; after the alignment the motion is estimated once more, with a smaller threshold.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from coclo_vio.frontend.config import FrontendConfig
from coclo_vio.frontend.drift_correction import DriftCorrector
from coclo_vio.frontend.motion_check import MotionCheck, MotionEstimate
from coclo_vio.frontend.optical_flow import LucasKanade, equalised
from coclo_vio.frontend.prediction import PointPredictor, predicted_warps
from coclo_vio.frontend.tracks import ActiveTracks
from coclo_vio.values.arrays import Array, BoolArray, ByteImage, FloatImage
from coclo_vio.values.calibration import RectifiedStereo


class PointTracker:
    """Tracks points from frame to frame in the left images of one stereo pair."""

    def __init__(
        self,
        rig: RectifiedStereo,
        drift_corrector: DriftCorrector,
        is_allowed: Callable[[Array], BoolArray],
        config: FrontendConfig,
        counts: Counter[str],
    ) -> None:
        """Make a tracker.

        Args:
            rig: the rectified cameras.
            drift_corrector: aligns points with their reference templates.
            is_allowed: whether a point may be at each of the pixels (N, 2), (N,).
            config: the front end's parameters.
            counts: of what happened to points; the tracker adds to them.
        """
        self._rig = rig
        self._config = config.flow
        flow = config.flow
        self._flow = LucasKanade(flow.window_px, flow.iterations, flow.precision_px, flow.forward_backward_px)
        self._motion_check = MotionCheck(rig, config.motion)
        self._confident_share = config.motion.confident_share
        self._drift_corrector = drift_corrector
        self._is_allowed = is_allowed
        self._counts = counts

    def track(
        self,
        previous: ActiveTracks,
        previous_image: ByteImage,
        image: ByteImage,
        smooth: FloatImage,
        T_previous_current: Array | None,
    ) -> tuple[ActiveTracks, MotionEstimate]:
        """The points that were found, at their positions in the left image, and the motion.

        Their right pixels are those that the motion predicts; they have not been matched yet.

        Args:
            previous: the points in the last frame.
            previous_image: its left image, (rows, columns).
            image: the left image of this frame.
            smooth: the same, smoothed.
            T_previous_current: expected motion (4, 4); None if unknown.
        """
        if not len(previous):
            return previous, MotionEstimate(None, np.zeros(0, dtype=np.bool_), 0, 0)
        predictor = PointPredictor(self._rig, previous)
        expected_px = None if T_previous_current is None else predictor.pixels(T_previous_current)[0]
        left_px, is_found = self._flow_of(previous, previous_image, image, expected_px)
        points, is_known = predictor.points, predictor.is_known
        coarse = self._motion_check.check(points[is_found], is_known[is_found], left_px[is_found])
        is_found[np.flatnonzero(is_found)] = coarse.is_inlier
        is_confident = coarse.inliers >= self._confident_share * is_known.sum()
        motion = coarse.T_previous_current if is_confident else None
        chosen, moved = self._predicted(previous, predictor, left_px, is_found, motion)
        is_certain = is_found[chosen] if motion is not None else np.zeros(len(moved), dtype=np.bool_)
        corrected, is_similar = self._drift_corrector.correct(smooth, moved, is_certain)
        is_similar &= self._is_allowed(corrected.left_px)
        self._counts["dissimilar"] += int((~is_similar).sum())
        if motion is None:
            return corrected.select(is_similar), replace(coarse, T_previous_current=None)
        kept = np.flatnonzero(chosen)[is_similar]
        fine = self._motion_check.check(points[kept], is_known[kept], corrected.left_px[is_similar], is_aligned=True)
        self._counts["motion_outliers"] += int((~fine.is_inlier).sum())
        is_similar[is_similar] = fine.is_inlier
        return corrected.select(is_similar), fine if fine.T_previous_current is not None else coarse

    def _flow_of(
        self, previous: ActiveTracks, previous_image: ByteImage, image: ByteImage, expected_px: Array | None
    ) -> tuple[Array, BoolArray]:
        """Positions from Lucas-Kanade, (N, 2), and whether each point was found, (N,)."""
        config = self._config
        if expected_px is None:
            seeds, levels = previous.left_px, config.search_levels
        else:
            seeds, levels = expected_px, config.levels
        left_px, is_found = self._flow.track(previous_image, image, previous.left_px, seeds, levels)
        if is_found.mean() < config.retry_share:  # a jerk, or a change of illumination
            self._counts["flow_retries"] += 1
            lost = np.flatnonzero(~is_found)
            lost_px = previous.left_px[lost]
            left_px[lost], is_found[lost] = self._flow.track(
                equalised(previous_image), equalised(image), lost_px, lost_px, config.search_levels
            )
        return left_px, is_found

    def _predicted(
        self,
        previous: ActiveTracks,
        predictor: PointPredictor,
        left_px: Array,
        is_found: BoolArray,
        motion: Array | None,
    ) -> tuple[BoolArray, ActiveTracks]:
        """Which points are to be aligned, (N,), and these with their predicted right pixels and warps.

        Points that were lost are put where the motion predicts them, if it and their depths are known.
        """
        T = np.eye(4) if motion is None else motion
        expected_px, disparity = predictor.pixels(T)
        is_recoverable = ~is_found & predictor.is_known if motion is not None else np.zeros_like(is_found)
        self._counts["flow_lost"] += int((~is_found).sum())
        self._counts["searched_by_motion"] += int(is_recoverable.sum())
        left_px = np.where(is_recoverable[:, None], expected_px, left_px)
        right_px = left_px - np.column_stack((disparity, np.zeros(len(left_px))))
        warps, bends = predicted_warps(self._rig, previous, T)
        bends = previous.bends + np.einsum("nji,nj->ni", previous.warps, bends)
        moved = replace(
            previous,
            left_px=left_px,
            right_px=right_px,
            ages=previous.ages + 1,
            warps=warps @ previous.warps,
            bends=bends,
        )
        chosen = np.asarray((is_found | is_recoverable) & self._is_allowed(left_px))
        return chosen, moved.select(chosen)

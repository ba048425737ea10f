# SPDX-License-Identifier: BSD-3-Clause
"""The points of the last frame in this one: found by Lucas-Kanade, judged by one motion, made exact by their patches.

The motion of those that agree says where to look for those that were lost or went astray, and how every patch is
stretched and sheared by now; after the patches have been aligned it is sought once more and judges more sharply.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from coclo_vio.frontend.anchoring import Anchoring
from coclo_vio.frontend.config import FrontendConfig
from coclo_vio.frontend.flow import LucasKanade, evened
from coclo_vio.frontend.motion_check import MotionCheck, MotionVerdict
from coclo_vio.frontend.patches import FloatArray, PatchAligner
from coclo_vio.frontend.prediction import predicted, stretched
from coclo_vio.frontend.tracks import LiveTracks
from coclo_vio.values.arrays import Array, BoolArray, ByteImage, IntArray
from coclo_vio.values.calibration import RectifiedStereo


class Follower:
    """Follows the points of one pair of cameras from frame to frame."""

    def __init__(
        self,
        rig: RectifiedStereo,
        aligner: PatchAligner,
        admits: Callable[[Array], BoolArray],
        config: FrontendConfig,
        counts: Counter[str],
    ) -> None:
        """``admits`` says whether a point (N, 2) may be where it is; ``counts`` is told what happened to them."""
        self._rig = rig
        self._config = config.flow
        flow = config.flow
        self._flow = LucasKanade(flow.window_px, flow.iterations, flow.precision_px, flow.round_trip_px)
        self._motion_check = MotionCheck(rig, config.motion)
        self._sure_share = config.motion.sure_share
        self._anchoring = Anchoring(aligner, config.anchor, config.likeness)
        self._admits = admits
        self._counts = counts

    def follow(
        self,
        before: LiveTracks,
        image_before: ByteImage,
        image: ByteImage,
        smooth: FloatArray,
        motion: Array | None,
    ) -> tuple[LiveTracks, MotionVerdict]:
        """The points that were found, at their places in the left image, and what was found of the motion.

        Their right places are where the motion puts them: they have not been sought there.

        Args:
            before: the points in the last frame.
            image_before: its left image, (rows, columns).
            image: the left image of this frame.
            smooth: the same, smoothed.
            motion: ``T_previous_current`` (4, 4) that is expected; None if nothing is known of it.
        """
        if not len(before):
            return before, MotionVerdict(None, np.zeros(0, dtype=np.bool_), 0, 0)
        places, found = self._flowed(before, image_before, image, motion)
        coarse = self._motion_check.judge(before.select(found), places[found])
        found[np.flatnonzero(found)] = coarse.agrees
        is_sure = coarse.agreeing >= self._sure_share * before.has_right.sum()
        known_motion = coarse.T_previous_current if is_sure else None
        chosen, moved = self._put_by_motion(before, places, found, known_motion)
        believed = found[chosen] if known_motion is not None else np.zeros(len(chosen), dtype=np.bool_)
        before = before.select(chosen)
        corrected, same = self._anchoring.corrected(smooth, moved, believed)
        same &= self._admits(corrected.left_px)
        self._counts["changed"] += int((~same).sum())
        before, corrected = before.select(same), corrected.select(same)
        if known_motion is None:
            return corrected, replace(coarse, T_previous_current=None)
        fine = self._motion_check.judge(before, corrected.left_px, is_fine=True)
        self._counts["contradicted"] += int((~fine.agrees).sum())
        return corrected.select(fine.agrees), fine if fine.T_previous_current is not None else coarse

    def _flowed(
        self, before: LiveTracks, image_before: ByteImage, image: ByteImage, motion: Array | None
    ) -> tuple[Array, BoolArray]:
        """Where Lucas-Kanade has them now, (N, 2), and which it found, (N,)."""
        config = self._config
        if motion is None:
            seeds, levels = before.left_px, config.search_levels
        else:
            (seeds, _), levels = predicted(self._rig, before, motion), config.levels
        places, found = self._flow.follow(image_before, image, before.left_px, seeds, levels)
        if found.mean() < config.retry_share:  # a jerk, or the light has changed
            self._counts["retries"] += 1
            lost = np.flatnonzero(~found)
            even_before, even = evened(image_before), evened(image)
            places[lost], found[lost] = self._flow.follow(
                even_before, even, before.left_px[lost], before.left_px[lost], config.search_levels
            )
        return places, found

    def _put_by_motion(
        self, before: LiveTracks, places: Array, found: BoolArray, motion: Array | None
    ) -> tuple[IntArray, LiveTracks]:
        """Which points are to be aligned, and where and how they should be now.

        Those that were not found are put where the motion has them, if there is one and their depths are known.
        """
        T = np.eye(4) if motion is None else motion
        expected, disparity = predicted(self._rig, before, T)
        sought = ~found & before.has_right if motion is not None else np.zeros(len(before), dtype=np.bool_)
        self._counts["lost"] += int((~found).sum())
        self._counts["sought"] += int(sought.sum())
        places = np.where(sought[:, None], expected, places)
        right_px = places - np.column_stack((disparity, np.zeros(len(places))))
        shapes = stretched(self._rig, before, T) @ before.shapes
        moved = replace(before, left_px=places, right_px=right_px, ages=before.ages + 1, shapes=shapes)
        chosen = np.flatnonzero((found | sought) & self._admits(places))
        return chosen, moved.select(chosen)

# SPDX-License-Identifier: BSD-3-Clause
"""Stereo images in, tracks of points out: the front end on one screen."""

from collections import Counter, deque
from collections.abc import Mapping

import numpy as np

from coclo_vio.frontend import overlay, sight
from coclo_vio.frontend.config import FrontendConfig
from coclo_vio.frontend.detection import CornerDetector
from coclo_vio.frontend.expected_motion import ExpectedMotion
from coclo_vio.frontend.following import Follower
from coclo_vio.frontend.patches import PatchAligner, SmoothPair
from coclo_vio.frontend.rectification import RectifiedPair, Rectifier
from coclo_vio.frontend.stereo_matching import StereoMatcher
from coclo_vio.frontend.tracks import LiveTracks
from coclo_vio.values.arrays import Array, ByteImage
from coclo_vio.values.calibration import RectifiedStereo, StereoCalibration
from coclo_vio.values.measurements import StereoFrame, StereoTracks, TrackingQuality

_TAIL_FRAMES = 10


class StereoFrontend:
    """Follows points through the frames of a pair of cameras. Same frames, same tracks, to the bit.

    A frame in which nothing can be seen is no error: it has no tracks, and ``sight`` and ``reason`` say so. The points
    from before are sought again in the next frames.

    Attributes:
        rig: the pair after rectification, whose pixels the tracks are in.

    Raises:
        ConfigError: the calibration is of no pair that can be rectified.
    """

    def __init__(self, calibration: StereoCalibration, config: FrontendConfig | None = None) -> None:
        self._config = config or FrontendConfig()
        self._rectifier = Rectifier(calibration)
        self.rig: RectifiedStereo = self._rectifier.rig
        self._detector = CornerDetector(self._config.detection, self._rectifier.seen_left)
        self._aligner = PatchAligner(self._config.patch)
        self._matcher = StereoMatcher(
            self.rig, self._rectifier.seen_right, self._aligner, self._config.stereo, self._config.likeness
        )
        self._counts: Counter[str] = Counter()
        self._follower = Follower(self.rig, self._aligner, self._detector.admits, self._config, self._counts)
        self._reference: RectifiedPair | None = None  # the last frame in which something was seen
        self._nothing = LiveTracks.new(
            0, np.zeros((0, 2)), self._aligner.templates(np.zeros((1, 1), np.float32), np.zeros((0, 2)))
        )
        self._live = self._nothing  # the tracks of the reference
        self._motion = ExpectedMotion()
        self._blind_frames = 0
        self._next_id = 0
        self._tails: deque[StereoTracks] = deque(maxlen=_TAIL_FRAMES)  # for the eye
        self._shown: tuple[RectifiedPair, StereoTracks] | None = None

    @property
    def counts(self) -> Mapping[str, int]:
        """How often each thing happened to a point or a frame."""
        return dict(self._counts)

    def track(self, frame: StereoFrame, T_previous_current: Array | None = None) -> StereoTracks:
        """The points of a frame.

        Args:
            frame: the images, later than the last ones.
            T_previous_current: expected motion of the rectified left camera since the last frame, maps current camera
                coordinates to previous, (4, 4); None if unknown: then it is taken to go on as before.

        Raises:
            DatasetError: the images are not of the size that was calibrated.
        """
        self._counts["frames"] += 1
        pair = self._rectifier.rectified(frame)
        self._motion.advance(frame.stamp_ns, T_previous_current)
        light = sight.Light.of(pair, self._config.sight)
        fault = light.left_fault or self._frozen(pair)
        if fault:
            return self._blind(frame.stamp_ns, pair, fault)
        smooth = SmoothPair(self._aligner.smoothed(pair.left), self._aligner.smoothed(pair.right))
        before = self._live
        image_before = pair.left if self._reference is None else self._reference.left
        motion = self._motion.T_reference_current
        followed, verdict = self._follower.follow(before, image_before, pair.left, smooth.left, motion)
        fresh = self._fresh(pair, smooth, followed)
        live = self._matcher.match(pair, smooth, followed.joined(fresh))
        self._counts["unmatched"] += int((~live.has_right).sum())
        state, reason = sight.judged(live, len(followed), len(before), verdict, light, self._config.sight)
        if state is TrackingQuality.LOST:
            return self._blind(frame.stamp_ns, pair, reason)
        self._reference, self._live, self._blind_frames = pair, live, 0
        self._motion.settle(verdict.T_previous_current)
        return self._told(frame.stamp_ns, pair, live, state, reason)

    def overlay(self) -> ByteImage:
        """The last frame for the eye: both rectified images with points, tails and state, (rows, 2 columns, 3), BGR.

        Before the first frame it is black.
        """
        if self._shown is None:
            rows, columns = self._rectifier.seen_left.shape
            return np.zeros((rows, 2 * columns, 3), dtype=np.uint8)
        return overlay.drawn(*self._shown, self._tails)

    def _frozen(self, pair: RectifiedPair) -> str:
        """Why these images say nothing new, if they are those of the reference."""
        same = self._reference is not None and all(
            np.array_equal(now, then)
            for now, then in (
                (pair.left, self._reference.left),
                (pair.right, self._reference.right),
            )
        )
        return "both images are, to the bit, those of an earlier frame: the camera hangs" if same else ""

    def _fresh(self, pair: RectifiedPair, smooth: SmoothPair, followed: LiveTracks) -> LiveTracks:
        """New points, so that there are enough."""
        places = self._detector.find(pair.left, followed.left_px)
        fresh = LiveTracks.new(self._next_id, places, self._aligner.templates(smooth.left, places))
        self._next_id += len(fresh)
        self._counts["detected"] += len(fresh)
        return fresh

    def _blind(self, stamp_ns: int, pair: RectifiedPair, reason: str) -> StereoTracks:
        """A frame without tracks; those from before are kept for a while."""
        self._counts["blind"] += 1
        self._blind_frames += 1
        if self._blind_frames > self._config.sight.patience_frames:
            self._reference, self._live = None, self._nothing
            self._motion.forget()
        return self._told(stamp_ns, pair, self._nothing, TrackingQuality.LOST, reason)

    def _told(
        self, stamp_ns: int, pair: RectifiedPair, live: LiveTracks, state: TrackingQuality, reason: str
    ) -> StereoTracks:
        tracks = StereoTracks(stamp_ns, live.ids, live.left_px, live.right_px, live.ages, state, reason)
        if state is TrackingQuality.DEGRADED:
            self._counts["degraded"] += 1
        if state is not TrackingQuality.LOST:
            self._tails.append(tracks)
        self._shown = (pair, tracks)
        return tracks

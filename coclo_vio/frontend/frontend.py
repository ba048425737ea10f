# SPDX-License-Identifier: BSD-3-Clause
"""Stereo images in, tracks of points out: the front end on one screen."""

from collections import Counter, deque
from collections.abc import Mapping

import numpy as np

from coclo_vio.frontend.config import FrontendConfig
from coclo_vio.frontend.detection import CornerDetector
from coclo_vio.frontend.drift_correction import DriftCorrector
from coclo_vio.frontend.expected_motion import ExpectedMotion
from coclo_vio.frontend.overlay import draw
from coclo_vio.frontend.pair_calibration import PairCalibration
from coclo_vio.frontend.patches import PatchAligner, SmoothPair
from coclo_vio.frontend.rectification import RectifiedPair, Rectifier
from coclo_vio.frontend.stereo_matching import StereoMatcher
from coclo_vio.frontend.tracking import PointTracker
from coclo_vio.frontend.tracking_quality import Brightness, assess
from coclo_vio.frontend.tracks import ActiveTracks
from coclo_vio.values.arrays import Array, ByteImage
from coclo_vio.values.calibration import RectifiedStereo, StereoCalibration
from coclo_vio.values.measurements import StereoFrame, StereoTracks, TrackingQuality

_TAIL_FRAMES = 10


class StereoFrontend:
    """Tracks points through the frames of a stereo pair. Same frames, same tracks, to the bit.

    A frame without features is no error: it has no tracks, and ``quality`` and ``reason`` of the result name the cause.
    The tracks of the last good frame, the reference, are searched again in the next frames.

    Attributes:
        rig: the pair after rectification; the tracks are in its pixels.

    Raises:
        ConfigError: the calibration is of no pair that can be rectified.
    """

    def __init__(self, calibration: StereoCalibration, config: FrontendConfig | None = None) -> None:
        self._config = config or FrontendConfig()
        self._rectifier = Rectifier(calibration)
        self.rig: RectifiedStereo = self._rectifier.rig
        self._detector = CornerDetector(self._config.detection, self._rectifier.valid_left)
        self._aligner = PatchAligner(self._config.patch)
        self._calibration = PairCalibration(self.rig, self._config.pair)
        self._matcher = StereoMatcher(
            self.rig,
            self._rectifier.valid_right,
            self._aligner,
            self._config.stereo,
            self._config.similarity,
            self._calibration,
        )
        self._counts: Counter[str] = Counter()
        self._drift_corrector = DriftCorrector(self._aligner, self._config.drift, self._config.similarity)
        self._tracker = PointTracker(
            self.rig, self._drift_corrector, self._detector.is_allowed, self._config, self._counts
        )
        self._no_tracks = ActiveTracks.new(
            0, np.zeros((0, 2)), self._drift_corrector.templates(np.zeros((1, 1), np.float32), np.zeros((0, 2)))
        )
        shape = self._rectifier.valid_left.shape
        self._smooth = SmoothPair(np.zeros(shape, np.float32), np.zeros(shape, np.float32))  # of the current frame
        self._reference: RectifiedPair | None = None
        self._tracks = self._no_tracks  # of the reference
        self._motion = ExpectedMotion()
        self._lost_frames = 0  # since the reference
        self._next_id = 0
        self._recent: deque[StereoTracks] = deque(maxlen=_TAIL_FRAMES)  # for the overlay
        self._last: tuple[RectifiedPair, StereoTracks] | None = None

    @property
    def counts(self) -> Mapping[str, int]:
        """How many frames were processed, degraded and lost, and how many points were detected, lost and rejected."""
        return dict(self._counts)

    @property
    def pair_calibration(self) -> PairCalibration:
        """Errors of the right camera's calibration as estimated so far."""
        return self._calibration

    def track(self, frame: StereoFrame, T_previous_current: Array | None = None) -> StereoTracks:
        """The tracks of a frame.

        Args:
            frame: the images, later than the last ones.
            T_previous_current: expected motion of the rectified left camera since the last frame, maps current camera
                coordinates to previous, (4, 4); None if unknown: then constant velocity is assumed.

        Raises:
            DatasetError: the first images are not of the size that was calibrated; later ones of another size count
                as lost.
        """
        self._counts["frames"] += 1
        size_fault = self._rectifier.size_fault(frame)
        pair = self._last[0] if size_fault and self._last is not None else self._rectifier.rectify(frame)
        self._motion.advance(frame.stamp_ns, T_previous_current)
        if size_fault:
            return self._lost(frame.stamp_ns, pair, size_fault)
        brightness = Brightness.of(pair, self._config.quality)
        fault = brightness.left_fault or self._repetition(pair)
        if fault:
            return self._lost(frame.stamp_ns, pair, fault)
        smooth = self._smooth
        for image, out in zip((pair.left, pair.right), smooth, strict=True):
            self._aligner.smooth_image(image, out)
        previous = self._tracks
        previous_image = pair.left if self._reference is None else self._reference.left
        tracked, motion = self._tracker.track(
            previous, previous_image, pair.left, smooth.left, self._motion.T_reference_current
        )
        detected = self._detect(pair, smooth, tracked)
        points = tracked.joined(detected)
        tracks = self._matcher.match(pair, smooth, points)
        interchange = "" if brightness.right_fault else self._interchange(pair, smooth, tracks)
        if interchange:
            return self._lost(frame.stamp_ns, pair, interchange)
        self._counts["unmatched"] += int((~tracks.has_right).sum())
        quality, reason = assess(tracks, len(tracked), len(previous), motion, brightness, self._config.quality)
        if quality is TrackingQuality.LOST:
            return self._lost(frame.stamp_ns, pair, reason)
        self._learn_calibration(points, tracks, smooth)
        self._reference, self._tracks, self._lost_frames = pair, tracks, 0
        self._motion.set_reference(motion.T_previous_current)
        return self._result(frame.stamp_ns, pair, tracks, quality, reason)

    def overlay(self) -> ByteImage:
        """The last frame as a picture: both rectified images with tracks and quality, (rows, 2 columns, 3), BGR.

        Before the first frame it is black.
        """
        if self._last is None:
            rows, columns = self._rectifier.valid_left.shape
            return np.zeros((rows, 2 * columns, 3), dtype=np.uint8)
        return draw(*self._last, self._recent)

    def _repetition(self, pair: RectifiedPair) -> str:
        """Why these images hold nothing new, if they are those of the reference; otherwise an empty string."""
        row = pair.left.shape[0] // 2  # decides most cases
        is_same = self._reference is not None and all(
            np.array_equal(current[row], reference[row]) and np.array_equal(current, reference)
            for current, reference in (
                (pair.left, self._reference.left),
                (pair.right, self._reference.right),
            )
        )
        return "both images equal those of an earlier frame, to the bit: the camera repeats them" if is_same else ""

    def _interchange(self, pair: RectifiedPair, smooth: SmoothPair, tracks: ActiveTracks) -> str:
        """Why the images cannot be left and right, if next to no point is matched but many the other way round."""
        matched = int(tracks.has_right.sum())
        if matched >= self._config.quality.lost_tracks:
            return ""
        points = self._detector.find(pair.right, np.zeros((0, 2)))
        if len(points) < self._config.quality.degraded_tracks:
            return ""
        others = ActiveTracks.new(0, points, self._drift_corrector.templates(smooth.right, points))
        turned = self._matcher.match(
            RectifiedPair(pair.right, pair.left), SmoothPair(smooth.right, smooth.left), others
        )
        found = int(turned.has_right.sum())
        if found < max(self._config.quality.degraded_tracks, len(points) // 2):
            return ""
        return (
            f"left and right images are interchanged: {found} of {len(points)} points are matched the other way round, "
            f"{matched} of {len(tracks)} this way"
        )

    def _detect(self, pair: RectifiedPair, smooth: SmoothPair, tracked: ActiveTracks) -> ActiveTracks:
        """New points up to the configured number of tracks."""
        left_px = self._detector.find(pair.left, tracked.left_px)
        if not len(left_px):
            return self._no_tracks
        detected = ActiveTracks.new(self._next_id, left_px, self._drift_corrector.templates(smooth.left, left_px))
        self._next_id += len(detected)
        self._counts["detected"] += len(detected)
        return detected

    def _learn_calibration(self, before: ActiveTracks, tracks: ActiveTracks, smooth: SmoothPair) -> None:
        """By the points that were not matched before, and whose texture shows the row."""
        if not self._config.pair.is_estimated:
            return
        is_new = np.flatnonzero(~before.has_right & tracks.has_right)
        limit = self._config.pair.largest_row_share * self._config.stereo.row_sigma_px
        sure = is_new[self._matcher.row_sigmas(smooth, tracks.left_px[is_new]) < limit]
        self._calibration.learn(tracks.left_px[sure], tracks.right_px[sure])

    def _lost(self, stamp_ns: int, pair: RectifiedPair, reason: str) -> StereoTracks:
        """A frame without tracks; those of the reference are kept for a while."""
        self._counts["lost_frames"] += 1
        self._lost_frames += 1
        if self._lost_frames > self._config.quality.max_lost_frames:
            self._reference, self._tracks = None, self._no_tracks
            self._motion.reset()
        return self._result(stamp_ns, pair, self._no_tracks, TrackingQuality.LOST, reason)

    def _result(
        self, stamp_ns: int, pair: RectifiedPair, tracks: ActiveTracks, quality: TrackingQuality, reason: str
    ) -> StereoTracks:
        right_px = self._calibration.corrected(tracks.left_px, tracks.right_px)
        result = StereoTracks(stamp_ns, tracks.ids, tracks.left_px, right_px, tracks.ages, quality, reason)
        if quality is TrackingQuality.DEGRADED:
            self._counts["degraded_frames"] += 1
        if quality is not TrackingQuality.LOST:
            self._recent.append(result)
        self._last = (pair, result)
        return result

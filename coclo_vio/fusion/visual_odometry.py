# SPDX-License-Identifier: BSD-3-Clause
"""The visual modes: front end and sliding-window smoother joined into one estimator, one measurement at a time.

Frames go through the front end, which is told how the camera is expected to have moved; its tracks go to the smoother,
with the IMU readings and the odometry up to them. Stamps of frames are put on the IMU's clock first.
"""

from collections import Counter, deque
from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.frontend.config import FrontendConfig
from coclo_vio.fusion.image_clock import ImageClock
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array, ByteImage
from coclo_vio.values.calibration import ImuCalibration, RectifiedStereo, StereoCalibration
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.keyframes import OdometryDelta
from coclo_vio.values.measurements import (
    BodyTwistSample,
    InertialReading,
    Measurement,
    StereoFrame,
    StereoTracks,
)
from coclo_vio.values.outputs import Event, KeyframeHealth


class Frontend(Protocol):
    """What follows points through stereo frames; ``frontend.frontend.StereoFrontend``."""

    rig: RectifiedStereo

    def track(self, frame: StereoFrame, T_previous_current: Array | None = None) -> StereoTracks:
        """The points of a frame; ``T_previous_current``: expected motion of the left camera since the last one."""

    def overlay(self) -> ByteImage:
        """The last frame for the eye."""

    @property
    def counts(self) -> Mapping[str, int]:
        """How often each thing happened."""


class Smoother(Protocol):
    """What makes poses of tracks; ``backend.window.smoother.SlidingWindowSmoother``."""

    @property
    def latest_pose(self) -> Array | None:
        """``T_world_body`` of the last frame, (4, 4); None before the start."""

    @property
    def keyframe_ns(self) -> int | None:
        """Stamp of the last keyframe, where an ``OdometryDelta`` has to start."""

    @property
    def counts(self) -> Mapping[str, int]:
        """How often each thing happened."""

    def push_imu(self, sample: InertialReading) -> None:
        """Take a reading, before the tracks of the frame that it leads to."""

    def predicted_pose(self, stamp_ns: int) -> Array | None:
        """``T_world_body`` expected at a stamp, (4, 4); None before the start."""

    def push_tracks(self, tracks: StereoTracks, odometry: OdometryDelta | None = None) -> StateEstimate | None:
        """The estimate of a frame; None before the start."""

    def take_events(self) -> tuple[Event, ...]:
        """What happened since the last call."""

    def take_health(self) -> tuple[KeyframeHealth, ...]:
        """The keyframes since the last call."""


class TwistIntegrator(Protocol):
    """What makes odometry of body twists; ``backend.window.twist_odometry.TwistOdometry``."""

    def push(self, sample: BodyTwistSample) -> None:
        """Take a twist."""

    def restart(self, stamp_ns: int) -> None:
        """Begin anew at a keyframe."""

    def delta_until(self, stamp_ns: int) -> OdometryDelta | None:
        """The motion since the restart."""


class VisualOdometry:
    """Stereo frames or tracks in, an estimate for each once started; ``vins``, ``stereo`` and ``stereo_twist``.

    Which of them it is depends on the smoother (whether it ties keyframes by the IMU) and on whether there is somebody
    to integrate body twists. Blindness and a window that starts anew are told by ``take_events``, never raised.

    Invariant: what goes to front end and smoother is in the order of the IMU's clock, each frame later than the last.
    """

    def __init__(
        self,
        smoother: Smoother,
        frontend: Frontend | None = None,
        twist: TwistIntegrator | None = None,
        *,
        imu_kind: type[InertialReading] | None = None,
        time_offset_s: float = 0.0,
    ) -> None:
        """Join the stages.

        Args:
            smoother: a fresh one.
            frontend: a fresh one; None where a recording has tracks, not frames.
            twist: what integrates body twists, where they are used.
            imu_kind: the one kind of IMU whose readings are used; None for no IMU.
            time_offset_s: stamp of a frame plus this is the IMU's clock, s.
        """
        self._smoother, self._frontend, self._twist = smoother, frontend, twist
        self._imu_kind = imu_kind
        is_alone = imu_kind is None and twist is None
        self._clock = ImageClock(time_offset_s, waits=not is_alone)
        self._answers: deque[StateEstimate] = deque()  # of frames that came due together
        self._counts: Counter[str] = Counter()
        self._frame_ns: int | None = None
        self._reading_ns: int | None = None
        self._show: tuple[int, Callable[[int, ByteImage], None]] | None = None

    @property
    def counts(self) -> Mapping[str, int]:
        """What was counted here, by the front end and by the smoother."""
        seen = {} if self._frontend is None else self._frontend.counts
        return {
            **self._counts,
            **self._clock.counts,
            **_named("frontend", seen),
            **_named("smoother", self._smoother.counts),
        }

    def push(self, measurement: Measurement) -> StateEstimate | None:
        """Take one measurement; the estimate of a frame that it completes, otherwise None.

        Frames that come due together are answered one a push.

        Raises:
            DatasetError: images of another size than was calibrated.
            SmootherError: the smoother cannot go on.
        """
        for due in self._clock.push(measurement):
            self._take(due)
        return self._answers.popleft() if self._answers else None

    def take_events(self) -> tuple[Event, ...]:
        """What happened since the last call."""
        return self._smoother.take_events()

    def take_health(self) -> tuple[KeyframeHealth, ...]:
        """The keyframes since the last call."""
        return self._smoother.take_health()

    def show(self, every: int, take: Callable[[int, ByteImage], None]) -> None:
        """From now on hand on the picture of every n-th frame with its stamp (ns), as far as there are images."""
        self._show = every, take

    def _take(self, measurement: Measurement) -> None:
        match measurement:
            case StereoFrame() | StereoTracks():
                self._take_sight(measurement)
            case BodyTwistSample() if self._twist is not None:
                self._twist.push(measurement)
            case InertialReading() if type(measurement) is self._imu_kind:
                self._take_reading(measurement)

    def _take_reading(self, reading: InertialReading) -> None:
        if self._reading_ns is not None and reading.stamp_ns <= self._reading_ns:
            self._counts["imu_stamp_refused"] += 1
            return
        self._reading_ns = reading.stamp_ns
        self._smoother.push_imu(reading)

    def _take_sight(self, sight: StereoFrame | StereoTracks) -> None:
        stamp_ns = sight.stamp_ns
        if self._frame_ns is not None and stamp_ns <= self._frame_ns:
            self._counts["frame_stamp_refused"] += 1
            return
        tracks = self._tracked(sight) if isinstance(sight, StereoFrame) else sight
        if tracks is None:
            return
        self._frame_ns = stamp_ns
        odometry = None if self._twist is None else self._twist.delta_until(stamp_ns)
        before_ns = self._smoother.keyframe_ns
        estimate = self._smoother.push_tracks(tracks, odometry)
        keyframe_ns = self._smoother.keyframe_ns
        if self._twist is not None and keyframe_ns is not None and keyframe_ns != before_ns:
            self._twist.restart(keyframe_ns)
        if estimate is not None:
            self._answers.append(estimate)

    def _tracked(self, frame: StereoFrame) -> StereoTracks | None:
        if self._frontend is None:
            self._counts["frame_without_frontend"] += 1
            return None
        self._counts["frames"] += 1
        tracks = self._frontend.track(frame, self._expected_motion(self._frontend.rig, frame.stamp_ns))
        if self._show is not None and (self._counts["frames"] - 1) % self._show[0] == 0:
            self._show[1](frame.stamp_ns, self._frontend.overlay())
        return tracks

    def _expected_motion(self, rig: RectifiedStereo, stamp_ns: int) -> Array | None:
        """``T_previous_current`` of the rectified left camera since the last frame, (4, 4); None if unknown."""
        before, now = self._smoother.latest_pose, self._smoother.predicted_pose(stamp_ns)
        if before is None or now is None:
            return None
        T_body_camera = rig.T_body_camera
        return np.asarray(se3.inverse(before @ T_body_camera) @ now @ T_body_camera)


def visual_odometry(
    stereo: StereoCalibration,
    frontend: FrontendConfig,
    smoother: SmootherConfig,
    imu: ImuCalibration | None = None,
    imu_kind: type[InertialReading] | None = None,
    *,
    uses_imu: bool = False,
    uses_twist: bool = False,
    has_frames: bool = True,
) -> VisualOdometry:
    """The real front end and smoother, joined; loads OpenCV and GTSAM.

    Args:
        stereo: the cameras.
        frontend: parameters of the front end.
        smoother: parameters of the smoother.
        imu: mounting and noise of the IMU that is used.
        imu_kind: which kind of readings are of it.
        uses_imu: whether it ties keyframes; otherwise it levels the first pose only.
        uses_twist: whether recorded body twists are weak odometry.
        has_frames: whether there are images; otherwise tracks of rectified ones.

    Raises:
        ConfigError: cameras that cannot be rectified.
        CalibrationMissing: tracks, and cameras that are not rectified.
    """
    from coclo_vio.backend.window.smoother import SlidingWindowSmoother  # noqa: PLC0415 -- loads GTSAM
    from coclo_vio.frontend.frontend import StereoFrontend  # noqa: PLC0415 -- loads OpenCV

    twist: TwistIntegrator | None = None
    if uses_twist:
        from coclo_vio.backend.window.twist_odometry import TwistOdometry  # noqa: PLC0415

        twist = TwistOdometry(smoother.twist)
    eyes = StereoFrontend(stereo, frontend) if has_frames else None
    rig = RectifiedStereo.of(stereo) if eyes is None else eyes.rig
    return VisualOdometry(
        SlidingWindowSmoother(rig, smoother, imu, uses_imu=uses_imu),
        eyes,
        twist,
        imu_kind=imu_kind,
        time_offset_s=stereo.time_offset_s,
    )


def _named(stage: str, counts: Mapping[str, int]) -> dict[str, int]:
    return {f"{stage}_{name}": number for name, number in counts.items()}

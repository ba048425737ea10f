# SPDX-License-Identifier: BSD-3-Clause
"""The visual modes: front end and sliding-window smoother as one estimator.

Frames go through the vision chain with the motion that the smoother expects; their tracks go to the smoother, with the
IMU readings and the body twists up to them.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Literal, Protocol, runtime_checkable

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.frontend.config import FrontendConfig
from coclo_vio.fusion.image_clock import ImageClock
from coclo_vio.fusion.rotation_check import RotationCheck
from coclo_vio.fusion.rotation_events import accord_event, delay_event, mounting_sentence, suspicion_event
from coclo_vio.fusion.rotation_findings import CameraMounting, GyroscopeAgrees, ImageDelay, VisionAgrees, VisionSuspect
from coclo_vio.fusion.streaming import StreamingEstimator
from coclo_vio.fusion.vision_chain import Frontend, Smoother, VisionChain, prefixed
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import ImuCalibration, RectifiedStereo, StereoCalibration
from coclo_vio.values.measurements import (
    BodyTwistSample,
    CameraImuSample,
    InertialReading,
    Measurement,
    StereoFrame,
    StereoTracks,
)
from coclo_vio.values.outputs import Estimate, Event, Output

if TYPE_CHECKING:
    from coclo_vio.backend.window.keyframe_source import KeyframeSource

KeyframeTies = Literal["none", "imu", "twist"]


@runtime_checkable
class Interruptible(Protocol):
    """A smoother that can be interrupted."""

    def interrupt(self) -> None:
        """An unknown time passes before the next reading."""


class VisualOdometry(StreamingEstimator):
    """Stereo frames or tracks in, an estimate for each once started: ``vins``, ``stereo`` and ``stereo_twist``.

    Which of them it is depends on the smoother's sources and on the readings that it gets. Loss of vision and a restart
    of the window are events, never errors.
    """

    def __init__(
        self,
        name: str,
        smoother: Smoother,
        frontend: Frontend | None = None,
        *,
        imu_kind: type[InertialReading] | None = None,
        check: RotationCheck | None = None,
        twist_kind: type[BodyTwistSample] | None = None,
        time_offset_s: float = 0.0,
        pictures_every: int | None = None,
    ) -> None:
        """Join the stages.

        Args:
            name: of the trajectory.
            smoother: a fresh one.
            frontend: a fresh one; None where a recording has tracks, not frames.
            imu_kind: the one kind of IMU whose readings are used; None for no IMU.
            check: a fresh comparison of rotations by the cameras and that IMU; None for none.
            twist_kind: the kind of body twists that are used; None for none.
            time_offset_s: stamp of a frame plus this is the IMU's clock, s.
            pictures_every: draw the tracks on every n-th frame; on none if None.
        """
        super().__init__(ImageClock(time_offset_s, waits=imu_kind is not None or twist_kind is not None))
        self._name, self._smoother = name, smoother
        self._vision = VisionChain(frontend, pictures_every)
        self._imu_kind, self._twist_kind, self._check = imu_kind, twist_kind, check
        self._reading_ns: int | None = None
        self._is_imu_aside = False

    @property
    def counts(self) -> Mapping[str, int]:
        """What was counted here, by the front end and by the smoother."""
        return {**super().counts, **self._vision.counts, **prefixed("smoother", self._smoother.counts)}

    def interrupt(self, gap_sigma_s: float) -> bool:
        """An unknown time passes before the next measurement: readings before and after it are not integrated together.

        Args:
            gap_sigma_s: one sigma of that time, s; without effect, as cameras measure the motion over it.
        """
        if isinstance(self._smoother, Interruptible):
            self._smoother.interrupt()
        return True

    def _process(self, measurement: Measurement) -> Iterator[Output]:
        match measurement:
            case StereoFrame() | StereoTracks():
                yield from self._process_frame(measurement)
            case BodyTwistSample() if type(measurement) is self._twist_kind:
                self._smoother.push_twist(measurement)
            case InertialReading() if type(measurement) is self._imu_kind:
                self._take_reading(measurement)

    def _take_reading(self, reading: InertialReading) -> None:
        if self._reading_ns is not None and reading.stamp_ns <= self._reading_ns:
            self._counted["imu_stamp_refused"] += 1
            return
        self._reading_ns = reading.stamp_ns
        if self._check is not None:
            self._check.push_gyroscope(reading)
        if self._is_imu_aside:
            self._counted["imu_set_aside"] += 1
        else:
            self._smoother.push_imu(reading)

    def _process_frame(self, frame: StereoFrame | StereoTracks) -> Iterator[Output]:
        if not self._vision.is_next(frame.stamp_ns):
            return
        now = self._smoother.predicted_pose(frame.stamp_ns) if isinstance(frame, StereoFrame) else None
        tracked = self._vision.track(frame, self._smoother.latest_pose, now)
        if tracked is None:
            return
        yield from tracked.pictures
        result = self._smoother.push_tracks(tracked.tracks)
        yield from result.events
        yield from result.health
        yield from result.snapshots
        if result.estimate is not None:
            yield Estimate(self._name, result.estimate)
            if self._check is not None:
                yield from self._compare(self._check, tracked.tracks, result.estimate.nav.gyroscope_bias)

    def _compare(self, check: RotationCheck, tracks: StereoTracks, bias: Array) -> Iterator[Event]:
        """Compare rotations by a frame, and act on what is found; an offset of the gyroscope is up to the window."""
        stamp_ns = tracks.stamp_ns
        match check.push_tracks(tracks, bias):
            case ImageDelay() as found:
                yield delay_event(stamp_ns, found)
                self._clock.shift(-found.delay_s)
                self._is_imu_aside = False
                detail = "stamps of images have been corrected; the window starts anew with this frame"
                self._smoother.begin_anew(detail, found.delay_s)
            case CameraMounting() as found:
                detail = f"{mounting_sentence(found)}; nothing was changed: mend the cameras' calibration"
                yield Event(stamp_ns, "camera_mounting_off", detail)
            case VisionSuspect() as found:
                yield suspicion_event(stamp_ns, found)
            case VisionAgrees():
                yield accord_event(stamp_ns)
            case GyroscopeAgrees():
                self._is_imu_aside = False
                detail = "the IMU agrees with the cameras on the rotation again, and is used"
                yield Event(stamp_ns, "imu_used_again", detail)
                self._smoother.begin_anew("the IMU is used again; the window starts anew with this frame", 0.0)
        if check.contradicts and not self._is_imu_aside:
            self._is_imu_aside = True
            check.set_gyroscope_aside()
            detail = (
                "in all of the latest turns the rotations of cameras and IMU contradict each other: the IMU is set "
                "aside, and cameras go on alone until it agrees with them; its axes, signs and scale are to be checked"
            )
            yield Event(stamp_ns, "imu_set_aside", detail)
            self._smoother.begin_anew("the IMU is set aside; the window starts anew with this frame", 0.0)


def visual_odometry(
    name: str,
    stereo: StereoCalibration,
    frontend: FrontendConfig,
    smoother: SmootherConfig,
    *,
    imu: tuple[type[InertialReading], ImuCalibration] | None = None,
    ties: KeyframeTies = "none",
    has_frames: bool = True,
    pictures_every: int | None = None,
) -> VisualOdometry:
    """The real front end and smoother, joined; loads OpenCV and GTSAM.

    Args:
        name: of the trajectory.
        stereo: the cameras.
        frontend: parameters of the front end.
        smoother: parameters of the smoother.
        imu: which kind of readings are used, and the mounting and noise of their IMU.
        ties: what ties keyframes beside landmarks: preintegrated IMU readings, recorded body twists as weak
            odometry, or nothing; an IMU that does not tie keyframes levels the first pose.
        has_frames: whether there are images; otherwise tracks of rectified ones.
        pictures_every: draw the tracks on every n-th frame; on none if None.

    Raises:
        ConfigError: cameras that cannot be rectified.
        CalibrationMissing: tracks, and cameras that are not rectified.
    """
    from coclo_vio.backend.window.inertial_source import InertialSource  # noqa: PLC0415 -- loads GTSAM
    from coclo_vio.backend.window.odometry_source import TwistSource  # noqa: PLC0415
    from coclo_vio.backend.window.smoother import SlidingWindowSmoother  # noqa: PLC0415
    from coclo_vio.backend.window.twist_odometry import TwistOdometry  # noqa: PLC0415

    stages, rig = stereo_stages(stereo, frontend, has_frames=has_frames)
    kind, calibration = (None, None) if imu is None else imu
    sources: dict[KeyframeTies, Callable[[], list[KeyframeSource]]] = {
        "none": list,
        "imu": lambda: [InertialSource(calibration or ImuCalibration(), smoother)],
        "twist": lambda: [TwistSource(TwistOdometry(smoother.twist))],
    }
    return VisualOdometry(
        name,
        SlidingWindowSmoother(
            rig,
            smoother,
            calibration,
            sources[ties](),
            imu_on_cameras=kind is CameraImuSample,
            gives_snapshots=pictures_every is not None,
        ),
        stages,
        imu_kind=kind,
        check=None if imu is None or ties != "imu" else RotationCheck(rig, imu[1].T_body_imu[:3, :3]),
        twist_kind=BodyTwistSample if ties == "twist" else None,
        time_offset_s=stereo.time_offset_s,
        pictures_every=pictures_every,
    )


def stereo_stages(
    stereo: StereoCalibration, config: FrontendConfig, *, has_frames: bool
) -> tuple[Frontend | None, RectifiedStereo]:
    """A fresh front end where there are images, and the rectified cameras; loads OpenCV.

    Raises:
        ConfigError: cameras that cannot be rectified.
        CalibrationMissing: tracks, and cameras that are not rectified.
    """
    if not has_frames:
        return None, RectifiedStereo.of(stereo)
    from coclo_vio.frontend.frontend import StereoFrontend  # noqa: PLC0415 -- loads OpenCV

    frontend = StereoFrontend(stereo, config)
    return frontend, frontend.rig

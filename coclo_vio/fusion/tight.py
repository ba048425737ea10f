# SPDX-License-Identifier: BSD-3-Clause
"""Legs, IMU and vision in one estimator: the legs' states are variables of the window, and nothing is fed back.

From keyframe to keyframe the leg filter preintegrates joints, contacts and IMU: it starts from the newest keyframe's
state as the window estimated it, and what it measured until the next keyframe, its start removed, is a factor of both.
Between keyframes the same filter gives the estimate at the joint rate.
"""

from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.filter.config import FilterConfig
from coclo_vio.filter.leg_preintegration import LegPreintegration
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.filter.revision import Prior
from coclo_vio.frontend.config import FrontendConfig
from coclo_vio.fusion.continuation import Continuing
from coclo_vio.fusion.fused_estimates import FusedEstimates
from coclo_vio.fusion.image_clock import ImageClock
from coclo_vio.fusion.rotation_check import RotationCheck
from coclo_vio.fusion.rotation_monitor import RotationMonitor
from coclo_vio.fusion.streaming import StreamingEstimator
from coclo_vio.fusion.vision_chain import Frontend, Smoother, VisionChain, prefixed
from coclo_vio.fusion.visual_odometry import stereo_stages
from coclo_vio.geometry import se3
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import ImuCalibration, StereoCalibration
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.keyframes import FrameResult, PoseMarginal
from coclo_vio.values.leg_motion import LegState
from coclo_vio.values.measurements import (
    CameraImuSample,
    FootForceSample,
    ImuSample,
    JointSample,
    Measurement,
    StereoFrame,
    StereoTracks,
)
from coclo_vio.values.outputs import Event, Output
from coclo_vio.values.units import NS_PER_S

if TYPE_CHECKING:
    from coclo_vio.backend.window.leg_source import LegSource

_CAMERAS_KEPT_S = 3.0
_VELOCITY_SIGMA_MPS = 0.1  # where a window starts anew, beyond the filter's

SmootherOfLegs = Callable[[LegState, Array], tuple[Smoother, "LegSource"]]
"""From the legs' first state, and a rotation ``E`` (3, 3) by which ``R_body_camera`` is ``E^T`` times the calibrated
one, to a smoother whose keyframes have the state, and its source."""


class TightOdometry(Continuing, StreamingEstimator):
    """The estimate at every joint sample, by the filter from the newest keyframe on, and the window's at every frame.

    Frames before the filter has started are left out. Without vision the filter goes on from the last keyframe.

    Invariant: the filter started anew from the window's last keyframe, and holds nothing else of its past.
    """

    def __init__(
        self,
        leg_filter: LegOdometryFilter,
        make_smoother: SmootherOfLegs,
        frontend: Frontend | None,
        *,
        outputs: FusedEstimates | None = None,
        check: RotationCheck | None = None,
        time_offset_s: float = 0.0,
        pictures_every: int | None = None,
    ) -> None:
        """Join them.

        Args:
            leg_filter: a fresh filter that can remember a keyframe's state.
            make_smoother: makes a fresh smoother once the legs' first state is known.
            frontend: a fresh one; None where a recording has tracks, not frames.
            outputs: makes the estimates, a fresh one; with the names ``tight`` and ``tight_vins`` if None.
            check: a fresh comparison of rotations by cameras, gyroscopes and legs; None for none.
            time_offset_s: stamp of a frame plus this is the clock of the joints and the body's IMU, s.
            pictures_every: draw the tracks on every n-th frame; on none if None.
        """
        super().__init__(ImageClock(time_offset_s, waits=True))
        self._made = outputs or FusedEstimates("tight", "tight_vins")
        self._filter, self._make_smoother = leg_filter, make_smoother
        self._vision = VisionChain(frontend, pictures_every)
        self._legs: LegPreintegration | None = None
        self._window: tuple[Smoother, LegSource] | None = None
        self._last_pose: Array | None = None  # of the last frame
        self._latest: StateEstimate | None = None  # of the filter
        self._monitor = None if check is None else RotationMonitor(check, leg_filter)
        self._tracks: StereoTracks | None = None  # of the last frame, until they are compared
        self._mounting: Prior | None = None  # which the next keyframe's state is to get
        self._cameras: dict[int, Prior] = {}  # their errors as known at the last frames
        self._is_mounting_off = False  # as a comparison of rotations has found
        self._is_anew = False  # the next frame begins a window
        self._ended: Counter[str] = Counter()  # counts of earlier windows

    @property
    def counts(self) -> Mapping[str, int]:
        """What was counted here, and by filter, front end and smoother."""
        smoother = self._ended + Counter({} if self._window is None else self._window[0].counts)
        return {**super().counts, **self._vision.counts, **self._filter.counts, **prefixed("smoother", smoother)}

    def _process(self, measurement: Measurement) -> Iterator[Output]:
        match measurement:
            case JointSample() | ImuSample() | CameraImuSample() | FootForceSample():
                if self._monitor is not None and not self._monitor.take(measurement):
                    self._counted["imu_set_aside"] += 1
                    return
                state = self._filter.push(measurement)
                if state is not None:
                    self._latest = state
                    if self._monitor is not None:
                        self._monitor.follow(state)
                    yield self._made.of_joints(state)
                    yield from self._filter.take_events()
            case StereoFrame() | StereoTracks():
                yield from self._process_frame(measurement)

    def _process_frame(self, frame: StereoFrame | StereoTracks) -> Iterator[Output]:
        if self._latest is None:
            self._counted["frame_before_start"] += 1
            return
        if not self._vision.is_next(frame.stamp_ns):
            return
        if not self._filter.reaches(frame.stamp_ns):
            self._counted["frame_late"] += 1
            return
        if self._legs is None:
            self._legs = self._filter.preintegration(frame.stamp_ns)
        if self._window is None or self._is_anew:
            yield from self._begin(self._legs, self._latest, frame)
        else:
            yield from self._add(self._legs, *self._window, self._latest, frame)
        yield from self._compare(self._legs)

    def _begin(
        self, legs: LegPreintegration, latest: StateEstimate, frame: StereoFrame | StereoTracks
    ) -> Iterator[Output]:
        """The first frame of a window: it starts from the filter's state."""
        velocity = None
        if self._window is not None:
            self._ended.update(self._window[0].counts)
            legs.anchor_at(frame.stamp_ns)
            sigma_mps = np.hypot(_VELOCITY_SIGMA_MPS, np.sqrt(latest.covariance[6:, 6:].trace() / 3.0))
            velocity = latest.nav.velocity_world, float(sigma_mps)
        self._is_anew = False
        state = legs.state(frame.stamp_ns)
        smoother, source = self._make_smoother(state, legs.calibrated)
        smoother.start_from(PoseMarginal(state.stamp_ns, state.T_world_body, state.covariance[:6, :6]), velocity)
        self._window = smoother, source
        result = yield from self._track(smoother, frame, state.T_world_body)
        legs.restart(source.newest)
        yield from self._outputs_of(legs, result, latest)

    def _add(
        self,
        legs: LegPreintegration,
        smoother: Smoother,
        source: "LegSource",
        latest: StateEstimate,
        frame: StereoFrame | StereoTracks,
    ) -> Iterator[Output]:
        """A later frame: where it becomes a keyframe, the filter goes on from its state in the window."""
        motion = legs.motion(frame.stamp_ns)
        source.take(motion)
        result = yield from self._track(smoother, frame, motion.end.T_world_body)
        if source.newest.stamp_ns == frame.stamp_ns:
            newest = source.newest
            if self._mounting is not None:
                newest, self._mounting = legs.with_mounting_prior(newest, self._mounting), None
                self._is_anew = self._is_mounting_off = True
            legs.restart(newest)
            self._filter.learn_levels()
            self._is_anew = self._is_anew or (self._is_mounting_off and legs.is_calibration_off)
            if self._is_anew and self._is_mounting_off:
                legs.calibrate()
            yield legs.calibration(frame.stamp_ns)
        yield from self._outputs_of(legs, result, latest)

    def _compare(self, legs: LegPreintegration) -> Iterator[Event]:
        """Compare rotations by the last frame, and act on what is found."""
        tracks, self._tracks = self._tracks, None
        if self._monitor is None or tracks is None:
            return
        revision = self._monitor.compare(tracks)
        self._cameras[tracks.stamp_ns] = legs.camera_errors
        while tracks.stamp_ns - min(self._cameras) > _CAMERAS_KEPT_S * NS_PER_S:
            del self._cameras[min(self._cameras)]
        if revision is None:
            return
        errors = None if revision.resumed_ns is None else self._cameras.get(revision.resumed_ns)
        if errors is not None:
            legs.resume_cameras(errors)
        yield revision.event
        self._mounting = revision.mounting or self._mounting
        self._clock.shift(-revision.delay_s)
        self._is_anew = self._is_anew or (revision.is_anew and revision.mounting is None)

    def _track(
        self, smoother: Smoother, frame: StereoFrame | StereoTracks, expected: Array
    ) -> Generator[Output, None, FrameResult]:
        """Track a frame, whose pose is expected there as the cameras measure it, and give the tracks to the window."""
        before, self._last_pose = self._last_pose, expected
        tracked = self._vision.track(frame, before, expected)
        if tracked is None:
            return FrameResult()
        yield from tracked.pictures
        self._tracks = tracked.tracks
        result = smoother.push_tracks(tracked.tracks)
        if result.estimate is not None:
            self._last_pose = result.estimate.nav.T_world_body
        return result

    def _outputs_of(self, legs: LegPreintegration, result: FrameResult, latest: StateEstimate) -> Iterator[Output]:
        """What the window gives for a frame; angular velocity, velocity and biases of the estimate are the filter's."""
        yield from result.events
        yield from result.health
        if result.estimate is None:
            return
        covariance, measured = np.zeros((9, 9)), result.estimate.nav.T_world_body
        yield from (each.moved(legs.true_pose(measured) @ se3.inverse(measured)) for each in result.snapshots)
        covariance[:6, :6] = legs.true_covariance(measured, result.estimate.covariance[:6, :6])
        covariance[6:, 6:] = latest.covariance[6:, 6:]
        nav = replace(latest.nav, T_world_body=legs.true_pose(measured))
        yield self._made.of_frame(replace(result.estimate, nav=nav, covariance=covariance))


def tight_odometry(
    robot: RobotModel,
    filter_config: FilterConfig,
    stereo: StereoCalibration,
    frontend: FrontendConfig,
    smoother: SmootherConfig,
    *,
    camera_imu: ImuCalibration | None = None,
    has_frames: bool = True,
    pictures_every: int | None = None,
) -> TightOdometry:
    """The real filter, front end and smoother as one estimator; loads Pinocchio, OpenCV and GTSAM.

    Args:
        robot: the legs.
        filter_config: of the filter.
        stereo: the cameras.
        frontend: parameters of the front end.
        smoother: parameters of the smoother.
        camera_imu: mounting and errors of the cameras' own IMU, which levels the body and is compared in rotation; None
            where there is none.
        has_frames: whether there are images; otherwise tracks of rectified ones.
        pictures_every: draw the tracks on every n-th frame; on none if None.

    Raises:
        ConfigError: the paper's profile, or cameras that cannot be rectified.
        CalibrationMissing: tracks, and cameras that are not rectified.
    """
    from coclo_vio.backend.window.leg_source import LegSource  # noqa: PLC0415 -- loads GTSAM
    from coclo_vio.backend.window.smoother import SlidingWindowSmoother  # noqa: PLC0415

    if filter_config.profile != "robust":
        raise ConfigError(
            f"the mode tight needs the profile 'robust' of the filter, not {filter_config.profile!r}: set "
            "filter.profile=robust, or take the mode combined"
        )
    stages, rig = stereo_stages(stereo, frontend, has_frames=has_frames)

    def make_smoother(state: LegState, rotation: Array) -> tuple[Smoother, LegSource]:
        source, at = LegSource(state), rig.T_body_camera[:3, 3]
        turn = se3.transform(rotation.T, at - rotation.T @ at)  # about the left camera
        return (
            SlidingWindowSmoother(
                rig.moved(turn), smoother, None, [source], gives_snapshots=pictures_every is not None
            ),
            source,
        )

    leg_filter = LegOdometryFilter(robot, filter_config, preintegrates=True, camera_imu=camera_imu)
    return TightOdometry(
        leg_filter,
        make_smoother,
        stages,
        outputs=FusedEstimates("tight", "tight_vins", smoother),
        check=RotationCheck(rig, *leg_filter.imu_rotations),
        time_offset_s=stereo.time_offset_s,
        pictures_every=pictures_every,
    )

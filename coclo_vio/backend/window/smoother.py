# SPDX-License-Identifier: BSD-3-Clause
"""The sliding-window smoother from the outside: stereo tracks in, an estimate for every frame out.

Between keyframes a frame is localised against landmarks that stay; at a keyframe the window is solved. Keyframes are
connected by landmarks that both observe and by sources of motion: preintegrated IMU readings (``vins``), odometry from
outside, body twists, or steady motion where nothing measures it.
Source: Qin, Cao, Pan, Shen, "A general optimization-based framework for local odometry estimation with multiple
sensors", 2019 (VINS-Fusion); new here are the prior on landmarks still tracked, and the behaviour without vision.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.disparity_offset import DisparityOffset
from coclo_vio.backend.window.event_log import EventLog
from coclo_vio.backend.window.frame_estimate import FrameEstimate
from coclo_vio.backend.window.frame_localisation import FrameLocalisation, has_enough_disparity, localise_frame
from coclo_vio.backend.window.gyroscope_bias import StandstillBias
from coclo_vio.backend.window.inertial import is_possible
from coclo_vio.backend.window.inertial_source import InertialSource
from coclo_vio.backend.window.keyframe_selection import has_lost_overlap, is_keyframe, tracks_are_still
from coclo_vio.backend.window.keyframe_source import KeyframeSource
from coclo_vio.backend.window.lasting_errors import LastingErrors
from coclo_vio.backend.window.motion_model import ConstantVelocityModel, PredictedMotion
from coclo_vio.backend.window.odometry_source import ExternalOdometry, TwistSource
from coclo_vio.backend.window.pixel_noise import PixelNoise
from coclo_vio.backend.window.source_set import SourceSet
from coclo_vio.backend.window.start import FIXED_SIGMA, Starter
from coclo_vio.backend.window.stereo_model import StereoModel
from coclo_vio.backend.window.tilt_errors import TiltErrors
from coclo_vio.backend.window.variables import VELOCITY
from coclo_vio.backend.window.window_snapshot import snapshot_of
from coclo_vio.backend.window.window_updater import WindowUpdater
from coclo_vio.robot.standstill import ImuMeans, StandstillDetector
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import ImuCalibration, RectifiedStereo
from coclo_vio.values.estimates import NavState, StateEstimate
from coclo_vio.values.keyframes import FrameResult, KeyframeResult, OdometryDelta, PoseEvidence, PoseMarginal
from coclo_vio.values.measurements import BodyTwistSample, InertialReading, StereoTracks
from coclo_vio.values.units import NS_PER_S


class SlidingWindowSmoother:
    """Poses of the body from stereo tracks and an IMU or odometry; an estimate for every frame once it has started.

    The world has its origin and heading at the body's first frame, and is z up where there is an accelerometer. Nothing
    that tracks or readings hold raises: a failure is an event, and the smoother continues.
    """

    def __init__(
        self,
        rig: RectifiedStereo,
        config: SmootherConfig | None = None,
        imu: ImuCalibration | None = None,
        sources: Sequence[KeyframeSource] = (),
        *,
        imu_on_cameras: bool = False,
        gives_snapshots: bool = False,
    ) -> None:
        """Make a smoother.

        Args:
            rig: the cameras.
            config: of the smoother.
            imu: of the readings that level the first pose.
            sources: of motion between keyframes, the first one that measures a frame predicts it; without any, what
                comes with a frame, or steady motion.
            imu_on_cameras: whether that IMU is in the housing of the cameras.
            gives_snapshots: give a ``WindowSnapshot`` at each keyframe.
        """
        self.config = config or SmootherConfig()
        calibration = imu or ImuCalibration()
        self._rig, self._gives_snapshots = rig, gives_snapshots
        noise = PixelNoise(self.config.noise)
        self._model = StereoModel(rig, noise)
        self._inertial = [source for source in sources if isinstance(source, InertialSource)]
        self._twists = [source for source in sources if isinstance(source, TwistSource)]
        self._rest_detector = StandstillDetector(self.config.standstill.limits)
        self._velocity_model = ConstantVelocityModel(self.config.motion, self.config.start.moving_velocity_mps)
        self._log = EventLog()
        self._sources = SourceSet(sources, self._velocity_model)
        offset = DisparityOffset(self.config.disparity_offset)
        self._updater = WindowUpdater(rig, self.config, self._sources, self._velocity_model, self._log, noise, offset)
        rotation, measures_gravity = calibration.T_body_imu[:3, :3], self._sources.measures_gravity
        self._starter = Starter(self.config.start, rotation, measures_gravity=measures_gravity)
        density = calibration.gyroscope_noise_density
        self._standstill_bias = StandstillBias(max(density, self.config.inertial.gyroscope_noise_density))
        self._last: FrameEstimate | None = None
        self._given_velocity = np.zeros(3), self.config.start.rest_velocity_mps
        self._outputs_from_ns = 0
        self._vision_ns = 0  # last frame with vision
        turned_rad = self.config.camera_rotation_sigma_rad if measures_gravity else 0.0
        self._lasting_errors = LastingErrors(
            scale_sigma=self.config.stereo_scale_sigma,
            rotation_sigma_rad=turned_rad,
            direction_sigma_rad=self.config.direction_sigma_rad,
            heading_sigma=self.config.heading_sigma,
            imu_on_cameras=imu_on_cameras,
        )
        self._tilt_errors = TiltErrors()
        self._anew: tuple[str, float] | None = None  # why the next frame begins a window, and how much later it is
        self._predicted: tuple[int, PredictedMotion] | None = None  # by ``predicted_pose``, until something comes

    @property
    def counts(self) -> Mapping[str, int]:
        """Frames, keyframes, frames without vision, at standstill or with a stamp refused, and events by kind."""
        return self._log.counts

    @property
    def latest_pose(self) -> Array | None:
        """``T_world_body`` of the last frame, (4, 4); None before the start."""
        return None if self._last is None else self._last.T_world_body

    @property
    def keyframe_ns(self) -> int | None:
        """The time of the last keyframe: where an ``OdometryDelta`` has to start."""
        window = self._updater.window
        return None if window is None else window.newest.stamp_ns

    def start_from(self, marginal: PoseMarginal, velocity: tuple[Array, float] | None = None) -> None:
        """Start, or start anew, with the frame of this stamp and in the world of this marginal.

        No other start is sought any more. From then on the window keeps its information on that world, and the result
        of each keyframe carries its marginal and evidence.

        Args:
            marginal: of the pose.
            velocity: world frame, m/s, (3,), and one sigma of each axis; None: at rest.
        """
        self._given_velocity = velocity or (np.zeros(3), self.config.start.rest_velocity_mps)
        covariance = marginal.covariance + np.eye(6) * FIXED_SIGMA**2  # without any the window could not be solved
        self._updater.given_start = PoseMarginal(marginal.stamp_ns, marginal.T_world_body, covariance)

    def push_imu(self, sample: InertialReading) -> None:
        """Take an IMU reading; readings come before the frame that they lead to."""
        if not is_possible(sample):
            self._log.count("imu_refused")
            return
        self._rest_detector.push(sample)
        self._predicted = None
        for source in self._inertial:
            source.push(sample)

    def interrupt(self) -> None:
        """An unknown time passes before the next reading: this interval between keyframes gets no IMU factor."""
        self._predicted = None
        for source in self._inertial:
            source.preintegration.has_gap = True

    def begin_anew(self, detail: str, late_s: float) -> None:
        """The next frame begins a window where it is localised or predicted; biases are sought anew.

        Args:
            detail: why, for the event ``window_restart``.
            late_s: stamps of the frames before were late by this against that one's, s.
        """
        self._anew = detail, late_s

    def push_twist(self, sample: BodyTwistSample) -> None:
        """Take a twist of the body; twists come before the frame that they lead to."""
        self._predicted = None
        for source in self._twists:
            source.push(sample)

    def predicted_pose(self, stamp_ns: int) -> Array | None:
        """``T_world_body`` predicted at ``stamp_ns``, (4, 4); None before the start."""
        if self._updater.window is None:
            return None
        motion = self._updater.predict(stamp_ns, ExternalOdometry())
        self._predicted = stamp_ns, motion
        return motion.T_world_body

    def push_tracks(
        self,
        tracks: StereoTracks,
        odometry: OdometryDelta | None = None,
        evidence: PoseEvidence | None = None,
    ) -> FrameResult:
        """Take a frame; without an estimate before the start and for a frame that is not newer than the last.

        Args:
            tracks: points observed in the frame.
            odometry: the motion from ``keyframe_ns`` to the frame as another sensor or estimator measured it.
            evidence: of the poses at both times, from the same source: where the frame becomes a keyframe, it takes
                the place of the odometry.
        """
        if self._last is not None and tracks.stamp_ns <= self._last.stamp_ns:
            self._log.count("frame_stamp_refused")
            return FrameResult()
        self._log.count("frames")
        estimate = self._estimate(tracks, odometry, evidence)
        window = self._updater.window if self._gives_snapshots and self.keyframe_ns == tracks.stamp_ns else None
        snapshots = () if window is None else (snapshot_of(window),)
        return FrameResult(estimate, self._keyframe_result(tracks.stamp_ns), *self._log.take(), snapshots)

    def _keyframe_result(self, stamp_ns: int) -> KeyframeResult | None:
        """Marginal and evidence of the frame of this stamp, if it is a keyframe and the start was given."""
        return self._updater.keyframe_result if self.keyframe_ns == stamp_ns else None

    def _estimate(
        self, tracks: StereoTracks, odometry: OdometryDelta | None, evidence: PoseEvidence | None
    ) -> StateEstimate | None:
        given = self._updater.given_start
        if given is not None and given.stamp_ns == tracks.stamp_ns:
            return self._start_as_given(tracks, given)
        window = self._updater.window
        if window is None:
            return self._try_to_start(tracks) if given is None else None
        if odometry is not None and odometry.start_ns != window.newest.stamp_ns:
            odometry = evidence = None
            self._log.count("odometry_refused")
        external = ExternalOdometry(odometry, evidence)
        motion = self._take_predicted(tracks.stamp_ns, external)
        fewest = self.config.failure.fewest_inliers
        frame = localise_frame(window.landmarks, self._model, tracks, motion, fewest)
        self._last = self._frame_estimate(frame, external)
        T_measured = motion.T_world_body if frame.fit is None else frame.fit.T_world_body
        covariance = None if frame.fit is None else frame.fit.covariance
        became_keyframe = self.keyframe_ns == tracks.stamp_ns
        self._velocity_model.add(
            tracks.stamp_ns, T_measured, self._last.T_world_body, covariance, is_keyframe=became_keyframe
        )
        return self._state_estimate(self._last) if tracks.stamp_ns >= self._outputs_from_ns else None

    def _take_predicted(self, stamp_ns: int, external: ExternalOdometry) -> PredictedMotion:
        """The prediction of a frame: the one that was asked for before, where nothing has come since."""
        before, self._predicted = self._predicted, None
        if before is not None and before[0] == stamp_ns and external.delta is None and external.evidence is None:
            return before[1]
        return self._updater.predict(stamp_ns, external)

    def _frame_estimate(self, frame: FrameLocalisation, external: ExternalOdometry) -> FrameEstimate:
        """What becomes of a frame: the keyframe at a standstill, a prediction, a new keyframe, or a localised frame."""
        tracks = frame.tracks
        self._log.add_vision(tracks, has_vision=frame.fit is not None)
        if self._anew is not None:
            (detail, late_s), self._anew = self._anew, None
            self._vision_ns = tracks.stamp_ns
            self._level(self._rest_detector.rest, is_anew=True)
            return self._updater.begin_anew(frame, detail, late_s)
        rest = self._rest_detector.rest
        if rest is not None and self._has_velocity and frame.fit is not None and self._stands_still(tracks):
            return self._at_standstill(frame, rest)
        self._standstill_bias.reset()
        has_no_points = frame.fit is None and not has_enough_disparity(tracks, self.config)
        if not has_no_points:
            self._vision_ns = tracks.stamp_ns
        elif self._has_velocity and self._is_too_long_without_vision(tracks.stamp_ns):
            self._vision_ns = tracks.stamp_ns
            return self._updater.restart_without_velocity(frame)
        if has_no_points and not self._is_keyframe_overdue(tracks.stamp_ns):
            return self._updater.predicted_frame(frame)
        if frame.fit is None or self._is_keyframe(tracks):
            return self._updater.add_keyframe(frame, external)
        return self._updater.localised_frame(frame, frame.fit)

    @property
    def _has_velocity(self) -> bool:
        """Whether a source measures the velocity at keyframes, which may be integrated and vanishes at a standstill."""
        return VELOCITY in self._sources.variables

    def _is_keyframe(self, tracks: StereoTracks) -> bool:
        return is_keyframe(self.config.keyframe, self._newest_tracks, tracks, self._rig.focal_px[0])

    def _stands_still(self, tracks: StereoTracks) -> bool:
        before = self._newest_tracks
        return tracks_are_still(before, tracks, self.config.standstill.motion_px) and not has_lost_overlap(
            self.config.keyframe, before, tracks
        )

    @property
    def _newest_tracks(self) -> StereoTracks:
        return self._updater.started_window.newest.tracks

    def _is_too_long_without_vision(self, stamp_ns: int) -> bool:
        return (stamp_ns - self._vision_ns) / NS_PER_S > self.config.failure.max_without_vision_s

    def _is_keyframe_overdue(self, stamp_ns: int) -> bool:
        """Whether the velocity has been integrated for so long that even a frame without points becomes a keyframe."""
        age_s = (stamp_ns - self._updater.started_window.newest.stamp_ns) / NS_PER_S
        return self._has_velocity and age_s >= self.config.keyframe.longest_s

    def _at_standstill(self, frame: FrameLocalisation, rest: ImuMeans) -> FrameEstimate:
        """Nothing moves: the frame is the keyframe, which gets zero velocity and the gyroscope's bias as factors."""
        stamp_ns = frame.tracks.stamp_ns
        self._log.count("standstill_frames")
        if not self._standstill_bias.is_due(stamp_ns):
            return self._updater.stay_at_keyframe(stamp_ns)
        rate, sigma = self._standstill_bias.add(stamp_ns, rest)
        return self._updater.solve_at_rest(frame, rate, sigma)

    def _try_to_start(self, tracks: StereoTracks) -> StateEstimate | None:
        start = self._starter.try_at(tracks.stamp_ns, self._rest_detector)
        if start is None:
            return None
        if start.rest is None and self._inertial:
            detail = (
                f"the IMU was not at rest within {self.config.start.rest_timeout_s} s; the start is made in motion, "
                f"and estimates follow after {self.config.start.alignment_s} s, in which gravity is estimated"
            )
            self._log.add(tracks.stamp_ns, "moving_start", detail)
        self._outputs_from_ns, self._vision_ns = start.outputs_from_ns, tracks.stamp_ns
        self._level(start.rest)
        self._last = self._updater.begin(tracks, start.T_world_body, start.covariance, np.zeros(3))
        return self._state_estimate(self._last) if tracks.stamp_ns >= self._outputs_from_ns else None

    def _level(self, rest: ImuMeans | None, *, is_anew: bool = False) -> None:
        """The biases of the IMU before the start; anew: what was learnt of them is dropped."""
        sigma = None if rest is None else self._standstill_bias.rate_sigma(rest.span_s)
        for source in self._inertial:
            if is_anew:
                source.forget()
            source.level(rest, sigma)

    def _start_as_given(self, tracks: StereoTracks, given: PoseMarginal) -> StateEstimate:
        if self._updater.window is not None:
            detail = "a start was given for this frame; the window starts anew from its pose"
            self._log.add(tracks.stamp_ns, "window_restart", detail)
        self._vision_ns = tracks.stamp_ns
        self._level(self._rest_detector.rest)
        covariance = np.zeros((9, 9))
        covariance[:6, :6] = given.covariance
        velocity, sigma_mps = self._given_velocity
        covariance[6:, 6:] = np.eye(3) * sigma_mps**2
        self._last = self._updater.begin(tracks, given.T_world_body, covariance, velocity)
        return self._state_estimate(self._last)

    def _state_estimate(self, frame: FrameEstimate) -> StateEstimate:
        """The estimate of a frame in the world: with the uncertainty of the window's gauge, rate and biases."""
        covariance = frame.covariance.copy()
        covariance[:6, :6] += self._updater.started_window.gauge_covariance(frame.T_world_body)
        rate, gyroscope, accelerometer = self._velocity_model.twist[:3], np.zeros(3), np.zeros(3)
        for source in self._inertial:
            gyroscope, accelerometer = source.biases_body
            rate = source.rate_body
        if self._updater.given_start is None:
            self._lasting_errors.follow(frame.T_world_body)
            covariance += self._lasting_errors.covariance(frame.T_world_body, frame.velocity_world)
            if self._sources.measures_gravity:
                covariance[3:6, 3:6] += self._tilt_errors.advance(frame)
        nav = NavState(frame.T_world_body, frame.velocity_world, rate, gyroscope, accelerometer)
        return StateEstimate(frame.stamp_ns, nav, covariance)

# SPDX-License-Identifier: BSD-3-Clause
"""The window over time: begun, extended by keyframes, solved, marginalised, and begun anew where that fails."""

import time
from collections.abc import Sequence

import numpy as np

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.disparity_offset import DisparityOffset
from coclo_vio.backend.window.event_log import EventLog
from coclo_vio.backend.window.factors import Term
from coclo_vio.backend.window.frame_estimate import FrameEstimate, propagated_covariance
from coclo_vio.backend.window.frame_localisation import FrameLocalisation
from coclo_vio.backend.window.gauge import Gauge, GlobalGauge, GravityGauge, HeldGauge
from coclo_vio.backend.window.keyframe import Keyframe, Solution
from coclo_vio.backend.window.keyframe_marginals import newest_marginal, pair_evidence
from coclo_vio.backend.window.keyframe_source import KeyframeState, Ties
from coclo_vio.backend.window.motion_model import ConstantVelocityModel, PredictedMotion
from coclo_vio.backend.window.odometry_source import ExternalOdometry
from coclo_vio.backend.window.pixel_noise import PixelNoise
from coclo_vio.backend.window.source_set import SourceSet
from coclo_vio.backend.window.stereo_model import PoseFit
from coclo_vio.backend.window.variables import POSE, VELOCITY
from coclo_vio.backend.window.window import Window
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.keyframes import KeyframeResult, PoseEvidence, PoseMarginal
from coclo_vio.values.measurements import StereoTracks
from coclo_vio.values.units import NS_PER_S


class WindowUpdater:
    """Keeps the window and what belongs to its newest keyframe.

    Attributes:
        window: None before the start.
        keyframe_covariance: of the newest keyframe's [pose, velocity, other variables], (S, S).
        keyframe_result: marginal and evidence of that keyframe; None where no start was given.
        given_start: the marginal to start from, where one was given.
    """

    def __init__(
        self,
        rig: RectifiedStereo,
        config: SmootherConfig,
        sources: SourceSet,
        velocity_model: ConstantVelocityModel,
        log: EventLog,
        noise: PixelNoise,
        offset: DisparityOffset,
    ) -> None:
        self._noise, self._offset = noise, offset
        self._rig, self._config, self._sources = rig, config, sources
        self._velocity_model, self._log = velocity_model, log
        self.window: Window | None = None
        self.keyframe_covariance = np.eye(sources.variables.state_size)
        self.keyframe_result: KeyframeResult | None = None
        self.given_start: PoseMarginal | None = None

    @property
    def started_window(self) -> Window:
        """The window after the start."""
        assert self.window is not None
        return self.window

    def begin(self, tracks: StereoTracks, T_world_body: Array, covariance: Array, velocity: Array) -> FrameEstimate:
        """Begin a window of one keyframe.

        Args:
            tracks: of the keyframe.
            T_world_body: its pose, (4, 4).
            covariance: of its pose in the world and its velocity, (9, 9).
            velocity: m/s, world frame, (3,).
        """
        number = 0 if self.window is None else self.window.newest.number + 1
        variables, stamp_ns = self._sources.variables, tracks.stamp_ns
        self.window = Window(self._rig, self._config, variables, self._new_gauge(), self._noise, self._offset)
        keyframe = Keyframe(number, stamp_ns, tracks)
        first = self._sources.begin(number, stamp_ns, velocity, float(np.sqrt(covariance[6, 6])))
        keyframe.terms.extend(first.terms)
        self.window.add(keyframe, T_world_body, np.zeros(len(tracks), dtype=np.bool_), first.values)
        covariance = covariance.copy()
        covariance[:6, :6] = self.window.fix_first(covariance[:6, :6])
        self._velocity_model.restart(tracks.stamp_ns, T_world_body)
        self.keyframe_covariance = np.zeros_like(self.keyframe_covariance)
        for variable, known in first.covariances.items():
            self.keyframe_covariance[variables.rows(variable), variables.rows(variable)] = known
        self.keyframe_covariance[:9, :9] = covariance
        self.keyframe_result = self._result(self.window, None, None)
        return FrameEstimate(tracks.stamp_ns, T_world_body, velocity, covariance)

    def _new_gauge(self) -> Gauge:
        if self.given_start is not None:
            return GlobalGauge()
        return GravityGauge() if self._sources.measures_gravity else HeldGauge()

    @property
    def newest_state(self) -> KeyframeState:
        """The newest keyframe as it is estimated."""
        window = self.started_window
        return self._state_of(window, window.newest)

    def _state_of(self, window: Window, keyframe: Keyframe) -> KeyframeState:
        return KeyframeState(
            keyframe.number, keyframe.stamp_ns, window.values, self.keyframe_covariance, window.variables
        )

    def predict(self, stamp_ns: int, external: ExternalOdometry) -> PredictedMotion:
        """Where the body should be at ``stamp_ns``, by the first source that measures it, or at constant velocity."""
        return self._sources.expect(self.newest_state, stamp_ns, external)

    def predicted_frame(self, frame: FrameLocalisation) -> FrameEstimate:
        """A frame without vision that becomes no keyframe: its prediction."""
        motion = frame.motion
        covariance = self._propagated(motion, None)
        return FrameEstimate(frame.tracks.stamp_ns, motion.T_world_body, motion.velocity_world, covariance)

    def localised_frame(self, frame: FrameLocalisation, fit: PoseFit) -> FrameEstimate:
        """A localised frame that becomes no keyframe."""
        motion = frame.motion
        off = fit.T_world_body[:3, 3] - motion.T_world_body[:3, 3]
        velocity = motion.velocity_world + motion.velocity_gain @ off
        if not motion.is_measured:
            velocity = fit.T_world_body[:3, :3] @ self._velocity_model.twist[3:]
        return FrameEstimate(frame.tracks.stamp_ns, fit.T_world_body, velocity, self._propagated(motion, fit))

    def stay_at_keyframe(self, stamp_ns: int) -> FrameEstimate:
        """A frame at a standstill: pose and velocity of the newest keyframe."""
        self._sources.stay(stamp_ns)
        window = self.started_window
        number = window.newest.number
        return FrameEstimate(stamp_ns, window.pose(number), window.velocity(number), self.keyframe_covariance[:9, :9])

    def solve_at_rest(self, frame: FrameLocalisation, rate: Array, sigma_radps: float) -> FrameEstimate:
        """Solve with the newest keyframe at rest, whose gyroscope has the bias ``rate``, rad/s, imu frame, (3,)."""
        window, stamp_ns = self.started_window, frame.tracks.stamp_ns
        speed = self._config.standstill.velocity_mps
        window.newest.rest_terms = self._sources.rest(window.newest.number, rate, sigma_radps, speed)
        predicted = self._predicted_covariance(window, frame.motion)
        if self._try_to_solve(window, stamp_ns) is None:
            return self._restart(frame, predicted)
        return self.stay_at_keyframe(stamp_ns)

    def add_keyframe(self, frame: FrameLocalisation, external: ExternalOdometry) -> FrameEstimate:
        """Make a frame a keyframe: solve the window with it, and marginalise the oldest one."""
        began_s = time.process_time()
        window, stamp_ns, motion = self.started_window, frame.tracks.stamp_ns, frame.motion
        before, predicted = window.newest, self._predicted_covariance(window, motion)
        ties = self._sources.ties(self.newest_state, stamp_ns, motion)
        self._insert(window, frame, ties)
        solution = self._try_to_solve(window, stamp_ns)
        if solution is None:
            return self._restart(frame, predicted)
        is_exchanged = self.given_start is not None and external.delta is not None
        evidence = self._try_evidence(window, ties.terms) if is_exchanged else None
        if len(window.keyframes) > self._config.keyframes:
            self._marginalise_oldest(window, stamp_ns)
        marginal = None if evidence is None else self._try_marginal(window)
        self.keyframe_result = self._result(window, marginal, evidence)
        self._sources.restart(self.newest_state)
        used, compute_s = int(np.count_nonzero(~frame.is_wrong)), time.process_time() - began_s
        self._log.add_keyframe(stamp_ns, used, len(window.keyframes), solution, compute_s)
        T, velocity = window.pose(window.newest.number), self._velocity(window, before)
        return FrameEstimate(stamp_ns, T, velocity, self.keyframe_covariance[:9, :9])

    def restart_without_velocity(self, frame: FrameLocalisation) -> FrameEstimate:
        """Begin anew at the predicted pose and at rest: after so long without vision no velocity is known."""
        failure, motion = self._config.failure, frame.motion
        detail = (
            f"no vision for more than {failure.max_without_vision_s} s; the velocity by the IMU is discarded, and the "
            f"window starts anew at the predicted pose with a speed of 0 +- {failure.restart_speed_mps} m/s"
        )
        self._log.add(frame.tracks.stamp_ns, "dead_reckoning_stopped", detail)
        covariance = self._predicted_covariance(self.started_window, motion)
        covariance[6:] = covariance[:, 6:] = 0.0
        covariance[6:, 6:] = np.eye(3) * failure.restart_speed_mps**2
        return self.begin(frame.tracks, motion.T_world_body, covariance, np.zeros(3))

    def begin_anew(self, frame: FrameLocalisation, detail: str, late_s: float) -> FrameEstimate:
        """Begin anew with a frame, whose velocity and tilt are as uncertain as they can be in motion.

        Args:
            frame: the first one of the window.
            detail: why, for the event.
            late_s: stamps of the frames before were late by this against the frame's: the body has moved for so much
                longer than they say.
        """
        motion, failure, stamp_ns = frame.motion, self._config.failure, frame.tracks.stamp_ns
        covariance = self._predicted_covariance(self.started_window, motion)
        T, velocity = motion.T_world_body.copy(), motion.velocity_world
        if frame.fit is not None:
            T = frame.fit.T_world_body
        else:
            T[:3, 3] += velocity * late_s
            covariance[3:6, 3:6] += np.eye(3) * (failure.restart_speed_mps * late_s) ** 2
        tilt = T[:3, :3].T @ np.diag([1.0, 1.0, 0.0]) @ T[:3, :3]
        covariance[:3, :3] += tilt * self._config.start.moving_tilt_rad**2
        covariance[6:] = covariance[:, 6:] = 0.0
        covariance[6:, 6:] = np.eye(3) * failure.restart_speed_mps**2
        self._log.add(stamp_ns, "window_restart", detail)
        return self.begin(frame.tracks, T, covariance, velocity)

    def _restart(self, frame: FrameLocalisation, covariance: Array) -> FrameEstimate:
        """Begin anew at the predicted pose, with the covariance (9, 9) that the prediction had before solving."""
        stamp_ns, motion = frame.tracks.stamp_ns, frame.motion
        self._log.add(stamp_ns, "window_restart", "the window was discarded; it starts anew at the predicted pose")
        return self.begin(frame.tracks, motion.T_world_body, covariance, motion.velocity_world)

    def _insert(self, window: Window, frame: FrameLocalisation, ties: Ties) -> None:
        """Add a frame to the window at its localised or predicted pose."""
        stamp_ns, motion = frame.tracks.stamp_ns, frame.motion
        keyframe = Keyframe(window.newest.number + 1, stamp_ns, frame.tracks, list(ties.terms))
        if ties.gap is not None:
            self._log.add(stamp_ns, "imu_gap", ties.gap)
        T = motion.T_world_body if frame.fit is None else frame.fit.T_world_body
        window.add(keyframe, T, frame.is_wrong, self._sources.initial(motion))

    def _try_to_solve(self, window: Window, stamp_ns: int) -> Solution | None:
        """Solve and take over biases and covariance; None where it failed or diverged."""
        try:
            solution = window.solve()
        except SmootherError as error:
            self._log.add(stamp_ns, "solver_failed", f"{error}; the window is discarded")
            return None
        self._log.add_dropped(stamp_ns, solution.dropped, solution.landmarks)
        self._log.count("poses_supported", solution.supported)
        if window.last_speed_mps > self._config.failure.fastest_mps:
            detail = (
                f"the solution moves at {window.last_speed_mps:.0f} m/s, faster than failure.fastest_mps = "
                f"{self._config.failure.fastest_mps}; the window is discarded"
            )
            self._log.add(stamp_ns, "solver_failed", detail)
            return None
        self.keyframe_covariance = window.variables.state_covariance(solution.covariance)
        if VELOCITY not in window.variables:
            self.keyframe_covariance[6:9, 6:9] = np.eye(3) * self._config.motion.acceleration_mps2**2 * 0.01
        self._sources.update(self.newest_state)
        return solution

    def _try_evidence(self, window: Window, without: Sequence[Term]) -> PoseEvidence | None:
        try:
            return pair_evidence(window, without)
        except SmootherError as error:
            detail = f"{error}; this keyframe's result has no evidence"
            self._log.add(window.newest.stamp_ns, "evidence_unavailable", detail)
            return None

    def _try_marginal(self, window: Window) -> PoseMarginal | None:
        """The newest keyframe's marginal once the oldest one has left, and with it what the prior does not keep."""
        try:
            return newest_marginal(window)
        except SmootherError as error:
            detail = f"{error}; the solver's covariance stands for this keyframe's marginal"
            self._log.add(window.newest.stamp_ns, "evidence_unavailable", detail)
            return None

    def _result(
        self, window: Window, marginal: PoseMarginal | None, evidence: PoseEvidence | None
    ) -> KeyframeResult | None:
        """The newest keyframe's result; its marginal is by the solver where there is no other."""
        if self.given_start is None:
            return None
        newest = window.newest
        by_solver = PoseMarginal(newest.stamp_ns, window.pose(newest.number), self.keyframe_covariance[:6, :6])
        return KeyframeResult(marginal or by_solver, evidence)

    def _marginalise_oldest(self, window: Window, stamp_ns: int) -> None:
        try:
            window.drop_oldest()
        except SmootherError as error:
            detail = f"{error}; of the past only a prior on the oldest pose is kept"
            self._log.add(stamp_ns, "prior_simplified", detail)
            pose = self.keyframe_covariance[: POSE.dimensions, : POSE.dimensions]
            window.discard_oldest(pose, self._sources.priors(self._state_of(window, window.keyframes[1])))

    def _velocity(self, window: Window, before: Keyframe) -> Array:
        """Velocity of the newest keyframe, m/s, world frame, (3,)."""
        if VELOCITY in window.variables:
            return window.velocity(window.newest.number)
        dt_s = (window.newest.stamp_ns - before.stamp_ns) / NS_PER_S
        return np.asarray((window.pose(window.newest.number)[:3, 3] - window.pose(before.number)[:3, 3]) / dt_s)

    def _propagated(self, motion: PredictedMotion, fit: PoseFit | None) -> Array:
        """The last keyframe's covariance propagated to a frame, with that of the motion since then, (9, 9)."""
        T, added = motion.T_world_body, motion.covariance
        if fit is not None:
            T, added = fit.T_world_body, fit.covariance
        before = self.started_window.pose(self.started_window.newest.number)
        return propagated_covariance(self.keyframe_covariance[:9, :9], before, T, added)

    def _predicted_covariance(self, window: Window, motion: PredictedMotion) -> Array:
        """Of pose in the world and velocity where the body is predicted, (9, 9)."""
        covariance = self._propagated(motion, None)
        covariance[:6, :6] += window.gauge_covariance(motion.T_world_body)
        return covariance

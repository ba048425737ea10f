# SPDX-License-Identifier: BSD-3-Clause
"""The smoother from the outside: tracks in, a pose for every frame out.

Between keyframes a frame is placed against landmarks that stay; at a keyframe the window is solved. Keyframes are tied
together by preintegrated IMU readings (``vins``), by the odometry that somebody gives, or by what they both see alone.
Source: Qin, Cao, Pan, Shen, "A general optimization-based framework for local odometry estimation with multiple
sensors", 2019 (VINS-Fusion); what is ours is the prior on landmarks still seen, and what happens when sight fails.
"""

import time
from collections.abc import Callable, Mapping

import gtsam
import numpy as np

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.diary import Diary
from coclo_vio.backend.window.exchange import Exchange, Told
from coclo_vio.backend.window.expectation import Expectation
from coclo_vio.backend.window.frame import Frame, carried
from coclo_vio.backend.window.inertial import InertialWatch, Preintegration, Quiet, is_possible
from coclo_vio.backend.window.keyframe_choice import has_turned_over, is_keyframe, stand_still
from coclo_vio.backend.window.localisation import Located, PixelModel
from coclo_vio.backend.window.motion import Motion, SteadyMotion
from coclo_vio.backend.window.sight import Glance, glance, sees_enough
from coclo_vio.backend.window.standstill import Standstill
from coclo_vio.backend.window.start import Starter
from coclo_vio.backend.window.window import Keyframe, Solution, Window
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import ImuCalibration, RectifiedStereo
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.estimates import NavState, StateEstimate
from coclo_vio.values.keyframes import FrameResult, KeyframeResult, OdometryDelta, PoseEvidence, PoseMarginal
from coclo_vio.values.measurements import InertialReading, StereoTracks
from coclo_vio.values.units import NS_PER_S

_REST_TIE_NS = 500_000_000  # of a rest are part of the motion after it: they tell tilt and bias together


class SlidingWindowSmoother:
    """Where the body is, from stereo tracks and what else there is; an estimate for every frame once it has started.

    The world has its origin and heading at the body's first frame, and is z up where an accelerometer says where up
    is. Nothing that tracks or readings hold raises: what goes wrong is an event, and the smoother carries on.
    """

    def __init__(
        self,
        rig: RectifiedStereo,
        config: SmootherConfig | None = None,
        imu: ImuCalibration | None = None,
        *,
        uses_imu: bool,
    ) -> None:
        self.config = config or SmootherConfig()
        self._rig = rig
        self._pixels = PixelModel(rig, self.config.noise)
        self._imu_calibration = imu or ImuCalibration()
        self._imu = Preintegration(self._imu_calibration, self.config.inertial) if uses_imu else None
        self._watch = InertialWatch(self.config.standstill)
        self._steady = SteadyMotion(self.config.motion, self.config.start.moving_velocity_mps)
        self._expectation = Expectation(self.config, self._imu, self._steady)
        self._window: Window | None = None
        self._last: Frame | None = None
        self._bias = gtsam.imuBias.ConstantBias()
        self._keyframe_covariance = np.eye(15)  # of [pose, velocity, accelerometer bias, gyroscope bias]
        self._starter = Starter(self.config.start, self._imu_calibration.T_body_imu[:3, :3], uses_imu=uses_imu)
        self._exchange = Exchange()
        self._silent_until_ns = 0
        self._longest_blind_s = self.config.failure.max_lost_s
        self._seen_ns = 0  # last time that the eyes saw anything
        density = self._imu_calibration.gyroscope_noise_density
        self._standstill = Standstill(max(density, self.config.inertial.gyroscope_noise_density))
        self._diary = Diary()

    @property
    def counts(self) -> Mapping[str, int]:
        """Frames, keyframes, frames without sight, standstills, restarts, stamps refused."""
        return self._diary.counts

    @property
    def latest_pose(self) -> Array | None:
        """``T_world_body`` of the last frame, (4, 4); None before the start."""
        return None if self._last is None else self._last.T_world_body

    @property
    def keyframe_ns(self) -> int | None:
        """The time of the last keyframe: where an ``OdometryDelta`` has to start."""
        return None if self._window is None else self._window.newest.stamp_ns

    def start_from(self, marginal: PoseMarginal) -> None:
        """Start, or start anew, with the frame of this stamp and in the world of this marginal.

        No other start is sought any more. From then on the window keeps what it knows of that world, and the result of
        each keyframe carries its marginal and evidence.
        """
        self._exchange.start_from(marginal)

    def push_imu(self, sample: InertialReading) -> None:
        """Take an IMU reading; readings come before the frame that they lead to."""
        if not is_possible(sample):
            self._diary.count("imu_refused")
            return
        self._watch.push(sample)
        if self._imu is not None:
            self._imu.push(sample)

    def predicted_pose(self, stamp_ns: int) -> Array | None:
        """``T_world_body`` expected at ``stamp_ns``, (4, 4); None before the start."""
        return None if self._window is None else self._expected(self._window, stamp_ns, None).T_world_body

    def push_tracks(
        self,
        tracks: StereoTracks,
        odometry: OdometryDelta | None = None,
        evidence: PoseEvidence | None = None,
    ) -> FrameResult:
        """Take a frame; without an estimate before the start and for a frame that is not newer than the last.

        Args:
            tracks: what the frame sees.
            odometry: the motion from ``keyframe_ns`` to the frame as something else measured it.
            evidence: what something else knows of the poses at both times, besides: where the frame becomes a
                keyframe, it takes the place of the odometry.
        """
        if self._last is not None and tracks.stamp_ns <= self._last.stamp_ns:
            self._diary.count("frame_stamp_refused")
            return FrameResult()
        self._diary.count("frames")
        estimate = self._estimate(tracks, odometry, evidence)
        return FrameResult(estimate, self._keyframe_result(tracks.stamp_ns), *self._diary.take())

    def _keyframe_result(self, stamp_ns: int) -> KeyframeResult | None:
        """Marginal and evidence of the frame of this stamp, if it is a keyframe and the start was given."""
        window = self._window
        if self._exchange.given is None or window is None or window.newest.stamp_ns != stamp_ns:
            return None
        marginal = self._exchange.marginal(stamp_ns) or PoseMarginal(
            stamp_ns, window.pose(window.newest.number), self._keyframe_covariance[:6, :6]
        )
        return KeyframeResult(marginal, self._exchange.evidence(stamp_ns))

    def _estimate(
        self, tracks: StereoTracks, odometry: OdometryDelta | None, evidence: PoseEvidence | None
    ) -> StateEstimate | None:
        given = self._exchange.given
        if given is not None and given.stamp_ns == tracks.stamp_ns:
            return self._start_as_given(tracks, given)
        if self._window is None:
            return self._try_to_start(tracks) if given is None else None
        if odometry is not None and odometry.start_ns != self._window.newest.stamp_ns:
            odometry = evidence = None
            self._diary.count("odometry_refused")
        motion = self._expected(self._window, tracks.stamp_ns, odometry)
        fewest = self.config.failure.fewest_inliers
        seen = glance(self._window.landmarks, self._pixels, tracks, motion, fewest)
        self._last = self._frame(self._window, seen, Told(odometry, evidence))
        seen_at = motion.T_world_body if seen.located is None else seen.located.T_world_body
        covariance = None if seen.located is None else seen.located.covariance
        is_keyframe = self._window.newest.stamp_ns == tracks.stamp_ns
        self._steady.add(tracks.stamp_ns, seen_at, self._last.T_world_body, covariance, is_keyframe=is_keyframe)
        return self._answer() if tracks.stamp_ns >= self._silent_until_ns else None

    def _frame(self, window: Window, seen: Glance, told: Told) -> Frame:
        tracks, located = seen.tracks, seen.located
        self._diary.tell_sight(tracks, is_blind=located is None)
        quiet = self._watch.quiet
        if quiet is not None and self._imu is not None and located is not None and self._stands(window, tracks):
            return self._hold(window, seen, quiet)
        self._standstill.end()
        sees_nothing = located is None and not sees_enough(tracks, self.config)
        if not sees_nothing:
            self._seen_ns = tracks.stamp_ns
        elif self._imu is not None and (tracks.stamp_ns - self._seen_ns) / NS_PER_S > self._longest_blind_s:
            return self._lost(window, tracks, seen.motion)
        if sees_nothing and not self._is_overdue(window, tracks):
            return self._unseen(tracks, seen.motion)
        if located is None or is_keyframe(self.config.keyframe, window.newest.tracks, tracks, self._rig.focal_px[0]):
            return self._solved(window, seen, told)
        return self._between(tracks, seen.motion, located)

    def _try_to_start(self, tracks: StereoTracks) -> StateEstimate | None:
        start = self._starter.try_at(tracks.stamp_ns, self._watch)
        if start is None:
            return None
        if start.rest is not None:
            self._bias = gtsam.imuBias.ConstantBias(np.zeros(3), start.rest.angular_velocity)
        elif self._imu is not None:
            self._diary.tell(tracks.stamp_ns, "moving_start", "no rest to start from: gravity is found on the way")
        self._silent_until_ns = start.silent_until_ns
        inertial, self._seen_ns = self.config.inertial, tracks.stamp_ns
        gyroscope = inertial.gyroscope_bias if start.rest is None else self._standstill.rate_sigma(start.rest.span_s)
        self._keyframe_covariance[9:, 9:] = np.diag(np.repeat([inertial.accelerometer_bias, gyroscope], 3) ** 2)
        self._last = self._begin(tracks, start.T_world_body, start.covariance, np.zeros(3))
        return self._answer() if tracks.stamp_ns >= self._silent_until_ns else None

    def _start_as_given(self, tracks: StereoTracks, given: PoseMarginal) -> StateEstimate:
        if self._window is not None:
            self._diary.tell(tracks.stamp_ns, "restart", "the window starts anew where it was told to")
        covariance = np.zeros((9, 9))
        covariance[:6, :6] = given.covariance
        covariance[6:, 6:] = np.eye(3) * self.config.start.rest_velocity_mps**2
        self._last = self._begin(tracks, given.T_world_body, covariance, np.zeros(3))
        return self._answer()

    def _begin(
        self,
        tracks: StereoTracks,
        T: Array,
        covariance: Array,
        velocity: Array,
    ) -> Frame:
        """A window of one keyframe, with the covariance (9, 9) of its pose in the world and its velocity."""
        number = 0 if self._window is None else self._window.newest.number + 1
        self._window = Window(self._rig, self.config, is_anchored=self._exchange.given is not None)
        keyframe = Keyframe(number, tracks.stamp_ns, tracks)
        self._window.add(keyframe, T, np.zeros(len(tracks), dtype=np.bool_))
        if self._imu is not None:
            sigmas, bias = np.sqrt(np.diag(self._keyframe_covariance)[9:]), self._bias.vector()
            keyframe.terms.append(factors.velocity_prior(number, velocity, float(np.sqrt(covariance[6, 6]))))
            keyframe.terms.append(factors.bias_prior(number, bias[:3], bias[3:], sigmas))
            self._window.set_inertial(number, velocity, self._bias)
            self._imu.restart(tracks.stamp_ns, self._bias)
        covariance = covariance.copy()
        covariance[:6, :6] = self._window.hold_first(covariance[:6, :6])
        self._steady.restart(tracks.stamp_ns, T)
        self._keyframe_covariance[:9, :] = self._keyframe_covariance[:, :9] = 0.0
        self._keyframe_covariance[:9, :9] = covariance
        return Frame(tracks.stamp_ns, T, velocity, covariance)

    def _expected(self, window: Window, stamp_ns: int, odometry: OdometryDelta | None) -> Motion:
        return self._expectation.of_frame(window, stamp_ns, odometry, self._bias, self._keyframe_covariance)

    def _is_overdue(self, window: Window, tracks: StereoTracks) -> bool:
        """Whether readings have been integrated for long enough to want a keyframe, seen or not."""
        age_s = (tracks.stamp_ns - window.newest.stamp_ns) / NS_PER_S
        return self._imu is not None and age_s >= self.config.keyframe.longest_s

    def _stands(self, window: Window, tracks: StereoTracks) -> bool:
        before = window.newest.tracks
        return stand_still(before, tracks, self.config.standstill.motion_px) and not has_turned_over(
            self.config.keyframe, before, tracks
        )

    def _unseen(self, tracks: StereoTracks, motion: Motion) -> Frame:
        return Frame(tracks.stamp_ns, motion.T_world_body, motion.velocity_world, self._widened(motion, None))

    def _between(self, tracks: StereoTracks, motion: Motion, located: Located) -> Frame:
        """A frame that is no keyframe."""
        off = located.T_world_body[:3, 3] - motion.T_world_body[:3, 3]
        velocity = motion.velocity_world + motion.velocity_gain @ off
        if not motion.is_measured:
            velocity = located.T_world_body[:3, :3] @ self._steady.twist[3:]
        return Frame(tracks.stamp_ns, located.T_world_body, velocity, self._widened(motion, located))

    def _widened(self, motion: Motion, located: Located | None) -> Array:
        """The last keyframe's covariance carried on, and the uncertainty of the motion since then, (9, 9)."""
        assert self._window is not None
        T, added = motion.T_world_body, motion.covariance
        if located is not None:
            T, added = located.T_world_body, located.covariance
        before = self._window.pose(self._window.newest.number)
        return carried(self._keyframe_covariance[:9, :9], before, T, added)

    def _hold(self, window: Window, seen: Glance, quiet: Quiet) -> Frame:
        """Nothing moves: the frame is the keyframe, which learns that it stands and what the gyroscope reads then."""
        assert self._imu is not None
        number, stamp_ns = window.newest.number, seen.tracks.stamp_ns
        self._diary.count("standstill_frames")
        if self._standstill.is_due(stamp_ns):
            rate, sigma = self._standstill.add(stamp_ns, quiet)
            speed = self.config.standstill.velocity_mps
            window.newest.rest_terms = [*factors.rest(number, speed, rate, sigma)]
            unseen = self._unseen_covariance(window, seen.motion)
            if self._try_to_solve(window, stamp_ns) is None:
                return self._restarted(seen.tracks, seen.motion, unseen)
        if self._imu.start_ns is None or stamp_ns - self._imu.start_ns > 2 * _REST_TIE_NS:
            self._imu.restart(stamp_ns - _REST_TIE_NS, self._bias)
        return Frame(stamp_ns, window.pose(number), window.velocity(number), self._keyframe_covariance[:9, :9])

    def _solved(self, window: Window, seen: Glance, told: Told) -> Frame:
        """A new keyframe: the window with it solved, the oldest one marginalised."""
        began_s = time.process_time()
        before, stamp_ns, motion = window.newest, seen.tracks.stamp_ns, seen.motion
        unseen = self._unseen_covariance(window, motion)
        ties = [*self._expectation.ties(window, stamp_ns, motion, told, self._bias)]
        keyframe = Keyframe(before.number + 1, stamp_ns, seen.tracks, list(ties))
        if self._imu is not None and not self._expectation.has_inertial_tie:
            self._diary.tell(stamp_ns, "imu_gap", "the IMU was silent for too long: this keyframe does without it")
        T = motion.T_world_body if seen.located is None else seen.located.T_world_body
        window.add(keyframe, T, seen.is_wrong)
        if self._imu is not None:
            window.set_inertial(keyframe.number, motion.velocity_world, self._bias)
        solution = self._try_to_solve(window, stamp_ns)
        if solution is None:
            return self._restarted(seen.tracks, motion, unseen)
        if told.odometry is not None:
            self._say(stamp_ns, lambda: self._exchange.note_evidence(window, ties))
        if len(window.keyframes) > self.config.keyframes:
            self._drop_oldest(window, stamp_ns)
        if told.odometry is not None:
            self._say(stamp_ns, lambda: self._exchange.note_marginal(window))
        if self._imu is not None:
            self._imu.restart(stamp_ns, self._bias)
        used, compute_s = int(np.count_nonzero(~seen.is_wrong)), time.process_time() - began_s
        self._diary.note(stamp_ns, used, len(window.keyframes), solution, compute_s)
        T, velocity = window.pose(keyframe.number), self._velocity(window, before)
        return Frame(stamp_ns, T, velocity, self._keyframe_covariance[:9, :9])

    def _say(self, stamp_ns: int, note: Callable[[], None]) -> None:
        """Note what is known of the newest keyframes, for whoever gave the odometry."""
        try:
            note()
        except SmootherError as error:
            self._diary.tell(stamp_ns, "nothing_to_say", str(error))

    def _velocity(self, window: Window, before: Keyframe) -> Array:
        if self._imu is not None:
            return window.velocity(window.newest.number)
        dt_s = (window.newest.stamp_ns - before.stamp_ns) / NS_PER_S
        return np.asarray((window.pose(window.newest.number)[:3, 3] - window.pose(before.number)[:3, 3]) / dt_s)

    def _try_to_solve(self, window: Window, stamp_ns: int) -> Solution | None:
        """Solve and take over biases and covariance; None where it failed or ran away."""
        try:
            solution = window.solve()
        except SmootherError as error:
            self._diary.tell(stamp_ns, "solver_failed", str(error))
            return None
        if window.last_speed_mps > self.config.failure.fastest_mps:
            what = f"the solution moves at {window.last_speed_mps:.0f} m/s, over {self.config.failure.fastest_mps}"
            self._diary.tell(stamp_ns, "solver_failed", what)
            return None
        self._keyframe_covariance = np.zeros((15, 15))
        size = len(solution.covariance)
        self._keyframe_covariance[:size, :size] = solution.covariance
        if self._imu is not None:
            self._bias = window.bias(window.newest.number)
        else:
            self._keyframe_covariance[6:9, 6:9] = np.eye(3) * self.config.motion.acceleration_mps2**2 * 0.01
        return solution

    def _restarted(self, tracks: StereoTracks, motion: Motion, covariance: Array) -> Frame:
        """A window anew from where the body is expected, with the covariance (9, 9) that this had before solving."""
        self._diary.tell(tracks.stamp_ns, "restart", "the window starts anew where the body was expected")
        return self._begin(tracks, motion.T_world_body, covariance, motion.velocity_world)

    def _lost(self, window: Window, tracks: StereoTracks, motion: Motion) -> Frame:
        """Blind for so long that what the IMU says of velocity is worth less than that bodies stop."""
        self._seen_ns = tracks.stamp_ns
        self._diary.tell(tracks.stamp_ns, "lost", f"blind for {self._longest_blind_s} s: velocity is given up")
        covariance = self._unseen_covariance(window, motion)
        covariance[6:] = covariance[:, 6:] = 0.0
        covariance[6:, 6:] = np.eye(3) * self.config.failure.blind_speed_mps**2
        return self._begin(tracks, motion.T_world_body, covariance, np.zeros(3))

    def _unseen_covariance(self, window: Window, motion: Motion) -> Array:
        """Of pose in the world and velocity where the body is expected, (9, 9)."""
        covariance = self._widened(motion, None)
        covariance[:6, :6] += window.world_covariance(motion.T_world_body)
        return covariance

    def _drop_oldest(self, window: Window, stamp_ns: int) -> None:
        try:
            window.drop_oldest()
        except SmootherError as error:
            self._diary.tell(stamp_ns, "prior_lost", f"{error}; the past is kept as a prior on the oldest pose alone")
            window.discard_oldest(self._keyframe_covariance)

    def _answer(self) -> StateEstimate:
        assert self._last is not None
        last, covariance = self._last, self._last.covariance.copy()
        if self._window is not None:
            covariance[:6, :6] += self._window.world_covariance(last.T_world_body)
        rate, gyroscope, accelerometer = self._steady.twist[:3], np.zeros(3), np.zeros(3)
        if self._imu is not None:
            to_body = self._imu.T_body_imu[:3, :3]
            gyroscope, accelerometer = to_body @ self._bias.gyroscope(), to_body @ self._bias.accelerometer()
            rate = self._imu.rate_body - gyroscope
        nav = NavState(last.T_world_body, last.velocity_world, rate, gyroscope, accelerometer)
        return StateEstimate(last.stamp_ns, nav, covariance)

# SPDX-License-Identifier: BSD-3-Clause
"""The leg odometry COCLO: measurements in, one at a time; an estimate out at every joint sample."""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from coclo_vio.filter.camera_imu import CameraImu
from coclo_vio.filter.coasting import coast, predict_gap
from coclo_vio.filter.config import FilterConfig
from coclo_vio.filter.evidence_gate import EvidenceGate
from coclo_vio.filter.frame_motion import BodyTrail, FrameMotion
from coclo_vio.filter.imu_delay import ImuDelay
from coclo_vio.filter.initialisation import initial_filter
from coclo_vio.filter.innovation_log import InnovationLog
from coclo_vio.filter.interruption import Learnt, learnt_by, take_learnt, widen_over_gap
from coclo_vio.filter.keyframe_exchange import KeyframeExchange, MarkedFrame
from coclo_vio.filter.leg_consistency import LegConsistency
from coclo_vio.filter.leg_preintegration import START, LegPreintegration, start_block
from coclo_vio.filter.paper_profile import PaperProfile
from coclo_vio.filter.profile import Profile
from coclo_vio.filter.revision import Prior, Snapshot, replace_prior, resume_from, shift_gyroscope
from coclo_vio.filter.robust_profile import RobustProfile
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.stance import Reading
from coclo_vio.filter.state import GYROSCOPE_BIAS, RATE
from coclo_vio.filter.state_blocks import StateBlock
from coclo_vio.filter.state_estimate import ADVICE, coasting_estimate, estimate_of
from coclo_vio.filter.state_level import SlipLevels
from coclo_vio.robot.foot_events import FootEvents
from coclo_vio.robot.leg_sensing import LegSensing
from coclo_vio.robot.model import RobotModel
from coclo_vio.robot.standstill import StartRule
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import ImuCalibration
from coclo_vio.values.errors import FilterError
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.measurements import ImuSample, Measurement
from coclo_vio.values.outputs import Calibration, Event, Innovation
from coclo_vio.values.units import NS_PER_S

_NOT_STARTED = "the filter has not started: it waits for the robot to stand still; push measurements first"
_MOUNTING_KNOWN = "the cameras' mounting is known: set filter.initial.camera_rotation_sigma_rad above 1e-5"
_RESUMED_SIGMAS = (0.003, 0.005)  # rad, m: of the motion by vision since the state that the filter resumes from


class LegOdometryFilter:
    """Pose and velocity of a legged robot from joints, torques or foot forces, and a cheap IMU (paper section III).

    The world is z up with its origin and heading at the body's first estimate. The filter waits for the robot to
    stand still (gravity, gyroscope bias), for at most ``rest_timeout_s``.

    Example:
        >>> odometry = LegOdometryFilter(RobotModel(load_robot("go1")))  # doctest: +SKIP
        >>> for measurement in dataset.measurements():  # doctest: +SKIP
        ...     estimate = odometry.push(measurement)
    """

    def __init__(
        self,
        robot: RobotModel,
        config: FilterConfig | None = None,
        *,
        remembers_frames: bool = False,
        preintegrates: bool = False,
        extra_blocks: Sequence[StateBlock] = (),
        camera_imu: ImuCalibration | None = None,
        reports_innovations: bool = False,
    ) -> None:
        """Take a robot and a configuration.

        Args:
            robot: the legs.
            config: of the filter; the robot's own if None.
            remembers_frames: keep frame, anchor keyframe and the cameras' errors in the state, for ``mark_frame``.
            preintegrates: keep the whole state of a keyframe in the state, for ``preintegration``; robust profile.
            extra_blocks: further blocks of the state of the robust profile.
            camera_imu: mounting and errors of the camera's IMU, which the robust profile uses beside the body's.
            reports_innovations: give an ``Innovation`` of the robust profile 25 times a second with the events.
        """
        self.config = config or FilterConfig.of_robot(robot.description)
        self._counts, self._innovations = Counter[str](), InnovationLog()
        self._robot, contact = robot, robot.description.contact
        self._profile: Profile
        self._camera_imu: CameraImu | None = None
        if self.config.profile == "paper":
            contact = contact.for_paper()
            self._profile = PaperProfile(
                robot, self.config.paper, self._counts, initial=self.config.initial, has_frame=remembers_frames
            )
        else:
            if camera_imu is not None and self.config.camera_imu.is_used:
                body_imu = robot.description.imu
                self._camera_imu = CameraImu(camera_imu, body_imu, self.config, is_passive=not preintegrates)
            extra = (*extra_blocks, *(() if self._camera_imu is None else self._camera_imu.blocks))
            start = (start_block(len(robot.leg_names), extra),) if preintegrates else ()
            self._profile = RobustProfile(
                robot,
                self.config.robust,
                self._counts,
                initial=self.config.initial,
                has_frame=remembers_frames,
                extra_blocks=(*extra, *start),
                holds_soles=not preintegrates,
            )
            self._profile.watch = self._innovations.add if reports_innovations else None
        rest, rocks, checks = self.config.standstill, self.config.rolls_feet, self.config.profile == "robust"
        self._sensing = LegSensing(
            robot, contact, rest, force_timeout_s=self.config.force_timeout_s, rocks_soles=rocks, checks_gravity=checks
        )
        self._feet = FootEvents(self.config.slip, contact, robot.leg_names)
        self._start_rule, self._stamp_ns, self._is_interrupted = StartRule(self.config.rest_timeout_s), 0, False
        self._core: SquareRootFilter | None = None
        self._exchange: KeyframeExchange | None = None
        self._levels: SlipLevels | None = None
        self._gate, self._trail = EvidenceGate(self.config.feedback_gate), BodyTrail(self.config)
        self._mounting_prior = Prior(np.zeros(3), np.eye(3) * self.config.initial.camera_rotation_sigma_rad**2)
        self._reading: Reading | None = None
        self._given: Learnt = {}

    @property
    def imu_rotations(self) -> tuple[Array, Array | None]:
        """``R_body_imu`` of the body's IMU and of the camera's, (3, 3); None where that one is not used."""
        own = None if self._camera_imu is None else self._camera_imu.rotation_body_imu
        return self._robot.description.imu.T_body_imu[:3, :3], own

    @property
    def reading(self) -> Reading | None:
        """What legs and IMU gave at the last joint sample; None before the first."""
        return self._reading

    @property
    def mounting_prior(self) -> Prior:
        """The prior on the rotation of the cameras' mounting that holds, as in ``camera_calibration``, rad."""
        return self._mounting_prior

    @property
    def counts(self) -> Mapping[str, int]:
        """How often each unusual thing happened, by name; see ``LegSensing`` and the profiles."""
        counts = self._counts + Counter(self._sensing.counts) + self._gate.counts
        if self._camera_imu is not None:
            counts += self._camera_imu.counts
        return {name: count for name, count in sorted(counts.items()) if count}

    def push(self, measurement: Measurement) -> StateEstimate | None:
        """Take one measurement; a joint sample in order gives an estimate once the filter has started.

        So does a sample of the body's IMU while joint samples are missing for longer than ``max_gap_s``.

        Raises:
            FilterError: the state is no longer finite.
            RobotModelError: another number of joints or legs than the robot's.
        """
        up_body = None if self._core is None else self._core.mean.rotation[2]
        reading = self._sensing.push(measurement, up_body)
        if self._camera_imu is not None and not (self._sensing.is_imu_aside and isinstance(measurement, ImuSample)):
            self._camera_imu.push(measurement, up_body if self._sensing.stands else None)
        if reading is None:
            return self._coast(measurement.stamp_ns) if isinstance(measurement, ImuSample) else None
        if self._camera_imu is not None:
            reading = self._camera_imu.completed(reading)
        self._reading = reading
        self._feet.push(reading)
        if self._core is None:
            return self._try_to_start(reading)
        if reading.stamp_ns <= self._stamp_ns:
            self._counts["joints_late"] += 1  # the IMU has gone on without them
            return None
        before, before_ns = self._core.mean, self._stamp_ns
        dt_s = (reading.stamp_ns - before_ns) / NS_PER_S
        is_gap = dt_s > self.config.max_gap_s
        if is_gap:
            self._counts["gap"] += 1
            reading, at_ns = predict_gap(self._core, self._profile, reading, before_ns, self._gyroscope_noise)
            dt_s = (reading.stamp_ns - at_ns) / NS_PER_S
        is_gap, self._is_interrupted = is_gap or self._is_interrupted, False
        try:
            is_stance = self._profile.step(self._core, reading, dt_s, self._gyroscope_noise(dt_s), is_gap=is_gap)
            if self._camera_imu is not None:
                self._camera_imu.update(self._core, reading, dt_s)
        except np.linalg.LinAlgError as error:
            raise FilterError(f"the filter failed numerically at {reading.stamp_ns} ns ({error}): {ADVICE}") from error
        self._stamp_ns = reading.stamp_ns
        self._trail.add(before, before_ns, self._core.mean, reading.stamp_ns)
        return estimate_of(self._core, reading, is_stance)

    def interrupt(self, gap_sigma_s: float) -> None:
        """From the last sample to the next a time passes that stamps do not tell; no foothold lasts.

        Args:
            gap_sigma_s: one sigma of that time beyond what the stamps say, s.
        """
        self._is_interrupted = True
        if self._core is not None and gap_sigma_s > 0.0:
            own = self.config.robust
            widen_over_gap(self._core, gap_sigma_s, own.acceleration_density, own.angular_acceleration_density)

    @property
    def learnt(self) -> Learnt:
        """Biases, leg constants and errors of the cameras as estimated, with sigmas; empty before the start."""
        return {} if self._core is None else learnt_by(self._core)

    def start_with(self, learnt: Learnt) -> None:
        """Start with what an earlier filter of the same robot has learnt; before the first measurement."""
        self._given = learnt

    @property
    def has_started(self) -> bool:
        """Whether there are estimates."""
        return self._core is not None

    @property
    def leg_consistency(self) -> LegConsistency | None:
        """How well the stance legs agree, over the last seconds; None before the start or without comparison."""
        check = self._profile.leg_check
        return None if check is None else check.consistency

    @property
    def imu_delay(self) -> ImuDelay | None:
        """Delay of the gyroscope behind the joints; None before the start, and in the paper's profile."""
        return self._profile.imu_delay

    def take_events(self) -> Sequence[Event | Innovation]:
        """What was reported since the last call: legs set aside or used again, feet, and requested innovations."""
        check = self._profile.leg_check
        of_legs = () if check is None else check.take_events()
        of_imu = () if self._camera_imu is None else self._camera_imu.take_events()
        return (*self._innovations.take(), *self._sensing.take_events(), *of_imu, *of_legs, *self._feet.take_events())

    def mark_frame(self, stamp_ns: int) -> MarkedFrame:
        """Remember the pose at the first camera frame, at its own stamp between samples; starts a new exchange.

        From the last sample on the body is predicted with constant rate and velocity. Whatever keyframe and frame were
        remembered before are replaced, and their objects void.

        Raises:
            FilterError: the filter has not started yet, or does not remember frames.
        """
        core = self._remembering()
        if self._exchange is None:
            self._exchange = KeyframeExchange(core, self._gate, self._motion_to)
        return self._exchange.first_frame(stamp_ns)

    def reaches(self, stamp_ns: int) -> bool:
        """Whether a frame of this stamp, which may be in the past, can be remembered yet."""
        return self._trail.reaches(stamp_ns, self._stamp_ns)

    def preintegration(self, anchor_ns: int) -> LegPreintegration:
        """The filter's states at keyframes and what it measures between them, for one estimator of all sensors.

        Args:
            anchor_ns: time of the first frame, from which poses by cameras are counted, in nanoseconds.

        Raises:
            FilterError: the filter has not started yet, or was made without ``preintegrates``.
        """
        core = self._started()
        core.mean.layout.at(START)
        return LegPreintegration(core, self._motion_to, self.config.initial, anchor_ns)

    def revise_mounting(self, prior: Prior) -> None:
        """Replace the prior of the cameras' mounting, in all states, as if the new one had held from the start.

        Args:
            prior: on the rotation vector of ``E`` of ``camera_calibration``, wider than the one that holds.

        Raises:
            FilterError: the filter has not started yet, does not remember frames, or knows the mounting.
        """
        core = self._remembering()
        if self._mounting_prior.is_known:
            raise FilterError(_MOUNTING_KNOWN)
        replace_prior(core, "camera", self._mounting_prior, prior)
        self._mounting_prior = prior

    def snapshot(self) -> Snapshot:
        """The state now, for ``revise_gyroscope``.

        Raises:
            FilterError: the filter has not started yet.
        """
        return Snapshot.of(self._started())

    def revise_gyroscope(self, bias: Array, sigma: float, resumed: tuple[Snapshot, Array] | None = None) -> None:
        """Set the gyroscope's bias anew, which has stepped.

        Args:
            bias: rad/s, body frame, (3,).
            sigma: of each axis, rad/s, which is added to what the filter has.
            resumed: the state before the step, and ``T_world_body`` (4, 4) at the last sample as vision gives it: the
                filter resumes from there, as the wrong bias has led it astray; None: it goes on from where it is.

        Raises:
            FilterError: the filter has not started yet.
        """
        core = self._started()
        rate = core.mean.vector[RATE] + core.mean.vector[GYROSCOPE_BIAS]
        if resumed is not None:
            resume_from(core, *resumed, _RESUMED_SIGMAS)
            core.mean.vector[RATE] = rate - core.mean.vector[GYROSCOPE_BIAS]
        shift_gyroscope(core, bias, sigma)

    def learn_levels(self) -> None:
        """Learn how large slip is in this recording; call it after a correction from outside.

        Raises:
            FilterError: the filter has not started yet.
        """
        core, robust = self._started(), self.config.robust
        if self.config.profile == "robust" and robust.learns_slip:
            self._levels = self._levels or SlipLevels(core.mean.layout, robust.slip_share)
            self._profile.creep_level = self._levels.learn(core, self._stamp_ns, self.leg_consistency)

    def camera_calibration(self, stamp_ns: int) -> Calibration:
        """The estimated errors of the cameras' mounting and stereo scale, with their sigmas.

        ``rotation_body`` is the rotation vector of ``E`` in ``R_body_camera(calibrated) = E R_body_camera(true)``: a
        motion ``T`` of the body is measured as ``E T E^-1``, and the true mounting is ``E^T`` times the calibrated one.
        ``stereo_scale`` is the factor from true to measured lengths.

        Args:
            stamp_ns: of the result, in nanoseconds.

        Raises:
            FilterError: the filter has not started yet, or does not remember frames.
        """
        value, sigma = self._remembering().report("camera")
        return Calibration(stamp_ns, value[:3], sigma[:3], float(1.0 + value[3]), float(sigma[3]))

    def reports(self) -> dict[str, tuple[Array, Array]]:
        """Value and one sigma of each block of the state that is declared as reported; empty before the start."""
        core = self._core
        if core is None:
            return {}
        return {block.name: core.report(block.name) for block in core.mean.layout.blocks if block.is_reported}

    def _motion_to(self, stamp_ns: int) -> FrameMotion:
        """From the last sample to a frame."""
        return self._trail.motion_to(stamp_ns, self._stamp_ns, self._started())

    def _coast(self, until_ns: int) -> StateEstimate | None:
        """Go on by the IMU alone where no joint sample has come for long; footholds end."""
        core, reading = self._core, self._reading
        longest_ns, can_coast = self.config.max_gap_s * NS_PER_S, self._profile.can_coast
        if core is None or reading is None or not can_coast or until_ns - reading.stamp_ns <= longest_ns:
            return None
        before, before_ns, samples = core.mean, self._stamp_ns, self._sensing.take_inertial()
        self._stamp_ns = coast(core, self._profile, samples, before_ns, until_ns + 1, self._gyroscope_noise)
        if self._stamp_ns == before_ns:
            return None
        self._counts["gap"] += not self._is_interrupted
        self._is_interrupted = True
        self._trail.add(before, before_ns, core.mean, self._stamp_ns)
        return coasting_estimate(core, self._stamp_ns, len(self._robot.leg_names))

    def _gyroscope_noise(self, dt_s: float) -> float:
        """One sigma of the gyroscope averaged over a step, rad/s."""
        return self.config.gyroscope_noise_radps(self._robot.description.imu.gyroscope_noise_density, dt_s)

    def _try_to_start(self, reading: Reading) -> StateEstimate | None:
        rest, camera_rest = self._sensing.rest, None
        if rest is None and self._camera_imu is not None:
            camera_rest = self._camera_imu.rest(reading.stamp_ns)
        if not self._start_rule.is_met(reading.stamp_ns, rest or camera_rest):
            return None
        is_moving = rest is None and camera_rest is None
        self._counts["started_moving"] += is_moving
        profile = self._profile
        self._core = initial_filter(
            profile.layout,
            self.config.initial,
            reading,
            rest,
            moving_force=self._sensing.mean_force if camera_rest is None else camera_rest.specific_force,
            is_moving=is_moving,
            foot_prior=profile.foot_prior(reading),
            is_wide=profile.is_wide,
        )
        if self._camera_imu is not None and camera_rest is not None:
            self._camera_imu.level(self._core, camera_rest)
        take_learnt(self._core, self._given)
        profile.start(reading)
        self._stamp_ns = reading.stamp_ns
        return estimate_of(self._core, reading, reading.is_stance)

    def _started(self) -> SquareRootFilter:
        """The filter, once it has started."""
        if self._core is None:
            raise FilterError(_NOT_STARTED)
        return self._core

    def _remembering(self) -> SquareRootFilter:
        """The filter, once it has started, where it remembers frames."""
        core = self._started()
        if not core.mean.layout.has_frame:
            raise FilterError("this filter remembers no frames; make it with remembers_frames=True")
        return core

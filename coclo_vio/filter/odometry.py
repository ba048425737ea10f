# SPDX-License-Identifier: BSD-3-Clause
"""COCLO from the outside: measurements in one at a time, an estimate out at every joint sample."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from coclo_vio.filter.cloning import correct_clone, delta_from_clone, frame_pair, placed
from coclo_vio.filter.config import FilterConfig
from coclo_vio.filter.core import SquareRootFilter
from coclo_vio.filter.feedback import EvidenceGate, Outcome, Verdict
from coclo_vio.filter.initialisation import initial_filter
from coclo_vio.filter.intake import Intake
from coclo_vio.filter.paper import PaperProfile
from coclo_vio.filter.robust import RobustProfile
from coclo_vio.filter.stance import Reading
from coclo_vio.filter.state import ACCELEROMETER_BIAS, GYROSCOPE_BIAS, POSITION, RATE, VELOCITY
from coclo_vio.geometry import se3, so3
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.errors import FilterError
from coclo_vio.values.estimates import FootState, NavState, StateEstimate
from coclo_vio.values.keyframes import OdometryDelta, PoseEvidence, PosePair
from coclo_vio.values.measurements import Measurement
from coclo_vio.values.units import NS_PER_S

_ADVICE = (
    "what was estimated before stays valid; look there for wild readings, or for stamps in another unit than their "
    "column says"
)


class LegOdometryFilter:
    """Where a legged robot is, from joints, torques or foot forces, and a cheap IMU (paper section III).

    The world is z up with its origin and heading at the body's first estimate. The filter waits for the robot to
    stand still (gravity, gyroscope bias), for at most ``rest_timeout_s``.

    Example:
        >>> odometry = LegOdometryFilter(RobotModel(load_robot("go1")))  # doctest: +SKIP
        >>> for measurement in dataset.measurements():  # doctest: +SKIP
        ...     estimate = odometry.push(measurement)
    """

    def __init__(
        self, robot: RobotModel, config: FilterConfig | None = None, *, remembers_frames: bool = False
    ) -> None:
        """Take a robot and a configuration.

        Args:
            robot: whose legs they are.
            config: of the filter; the robot's own if None.
            remembers_frames: keep two more poses in the state, of a camera frame and of the anchor, and what is wrong
                with the cameras, for ``mark_frame``.
        """
        self.config = config or FilterConfig.of_robot(robot.description)
        self._counts: Counter[str] = Counter()
        self._robot = robot
        contact = robot.description.contact
        self._profile: RobustProfile | PaperProfile
        if self.config.profile == "paper":
            contact = contact.model_copy(update={"method": "paper", "compensation": "none"})
            self._profile = PaperProfile(robot, self.config.paper, self._counts, has_frame=remembers_frames)
        else:
            self._profile = RobustProfile(robot, self.config.robust, self._counts, has_frame=remembers_frames)
        self._intake = Intake(robot, self.config, contact, self._counts)
        self._core: SquareRootFilter | None = None
        self._first_ns: int | None = None
        self._stamp_ns = 0
        self._clone_ns: int | None = None
        self._frame_ns: int | None = None
        self._gate = EvidenceGate(self.config.feedback_gate)

    @property
    def counts(self) -> Mapping[str, int]:
        """How often each unusual thing happened, by name; see ``Intake`` and the profiles."""
        counts = {**self._counts, **self._intake.counts, **self._gate.counts}
        return {name: count for name, count in sorted(counts.items()) if count}

    def push(self, measurement: Measurement) -> StateEstimate | None:
        """Take one measurement; a joint sample in order gives an estimate once the filter has started.

        Raises:
            FilterError: another number of joints than the robot's, or the state is no longer finite.
            RobotModelError: another number of legs than the robot's.
        """
        up_body = None if self._core is None else self._core.mean.rotation[2]
        reading = self._intake.push(measurement, up_body)
        if reading is None:
            return None
        if self._core is None:
            return self._try_to_start(reading)
        dt_s = (reading.stamp_ns - self._stamp_ns) / NS_PER_S
        is_gap = dt_s > self.config.max_gap_s
        if is_gap:
            self._counts["gap"] += 1
            reading, dt_s = self._bridge(self._core, reading)
        try:
            is_stance = self._profile.step(self._core, reading, dt_s, self._gyroscope_noise(dt_s), is_gap=is_gap)
        except np.linalg.LinAlgError as error:
            raise FilterError(f"the filter broke down at {reading.stamp_ns} ns ({error}): {_ADVICE}") from error
        self._stamp_ns = reading.stamp_ns
        return self._estimate(self._core, reading, is_stance)

    def clone(self) -> None:
        """Remember the present pose as the start of the next ``delta_since_clone``.

        Raises:
            FilterError: the filter has not started yet.
        """
        self._started().clone()
        self._clone_ns = self._stamp_ns

    def delta_since_clone(self) -> OdometryDelta:
        """Relative motion from the cloned pose to the present one.

        Raises:
            FilterError: no pose has been cloned.
        """
        core, clone_ns = self._cloned()
        return delta_from_clone(core, clone_ns, self._stamp_ns)

    def correct_at_clone(self, T_world_body: Array, covariance: Array) -> float:
        """Take a pose measured at the time of the clone, however late it comes.

        Args:
            T_world_body: the pose in the filter's world, (4, 4).
            covariance: of its right/local error [rotation rad, position m], (6, 6), positive definite.

        Returns:
            The normalised innovation squared, chi-square with 6 degrees of freedom.

        Raises:
            FilterError: no pose has been cloned.
        """
        core, _ = self._cloned()
        return correct_clone(core, T_world_body, covariance).innovation_squared

    @property
    def has_started(self) -> bool:
        """Whether there are estimates."""
        return self._core is not None

    @property
    def keyframe_ns(self) -> int | None:
        """The time of the cloned pose; None where there is none."""
        return self._clone_ns

    def expected_pose(self, stamp_ns: int) -> Array:
        """``T_world_body`` at a time near the last sample, the body going on as it does, (4, 4).

        Raises:
            FilterError: the filter has not started yet.
        """
        mean = self._started().mean
        dt_s = (stamp_ns - self._stamp_ns) / NS_PER_S
        rotation = mean.rotation @ so3.exp(mean.vector[RATE] * dt_s)
        return se3.transform(rotation, mean.vector[POSITION] + mean.vector[VELOCITY] * dt_s)

    def mark_frame(self, stamp_ns: int) -> Array:
        """Remember the pose at a frame's stamp, which lies between samples; the last frame is forgotten.

        From the last sample on the body is taken to go on with its rate and velocity; across a gap it may wander off.

        Returns:
            ``T_world_body`` of the frame, (4, 4).

        Raises:
            FilterError: the filter has not started yet, or does not remember frames.
        """
        core = self._started()
        if not core.mean.layout.has_frame:
            raise FilterError("this filter remembers no frames; make it with remembers_frames=True")
        dt_s = (stamp_ns - self._stamp_ns) / NS_PER_S
        core.mark_frame(dt_s, self._wandering(dt_s))
        self._frame_ns = stamp_ns
        return self.frame_pose

    def _wandering(self, dt_s: float) -> tuple[float, float]:
        """One sigma of turn (rad) and way (m) beyond steady motion; nothing between two samples."""
        if dt_s <= self.config.max_gap_s:
            return 0.0, 0.0
        robust, reach = self.config.robust, float(np.sqrt(dt_s**3 / 3.0))
        return robust.angular_acceleration_density * reach, robust.acceleration_density * reach

    def anchor_frame(self) -> None:
        """The frame becomes keyframe and anchor: poses of pairs and evidence are counted from there.

        Raises:
            FilterError: no frame has been marked.
        """
        self._marked()[0].anchor()
        self.keep_frame()

    def placed(self, T_anchor_seen: Array, covariance: Array) -> tuple[Array, Array]:
        """A pose that eyes see from the anchor, as it is in the world, with the covariance of its right/local error.

        Args:
            T_anchor_seen: as it is seen, (4, 4).
            covariance: of its right/local error, (6, 6).

        Raises:
            FilterError: no frame has been marked.
        """
        return placed(self._marked()[0], T_anchor_seen, covariance)

    def keep_frame(self) -> None:
        """The frame becomes the keyframe: where deltas start from.

        Raises:
            FilterError: no frame has been marked.
        """
        core, self._clone_ns = self._marked()
        core.keep_frame()

    def frame_pair(self) -> PosePair:
        """The poses of keyframe and frame from the anchor as the filter believes them now.

        Raises:
            FilterError: no frame has been marked, or no keyframe is kept.
        """
        core, frame_ns = self._marked()
        return frame_pair(core, self._cloned()[1], frame_ns)

    def take_evidence(
        self, evidence: PoseEvidence, widening: float = 1.0, whole: PoseEvidence | None = None
    ) -> Verdict:
        """Correct everything by what is known from outside of keyframe and frame, however late it comes.

        Args:
            evidence: of the poses, from the anchor, of the keyframe and the frame that are remembered.
            widening: the filter's own sigmas of rotation and places are multiplied by this where it is believed.
            whole: all that is believed outside, for a filter that gives in.

        Raises:
            FilterError: the evidence is of other times.
        """
        core, frame_ns = self._marked()
        of_ns = (evidence.start_ns, evidence.end_ns)
        if of_ns != (self._cloned()[1], frame_ns):
            raise FilterError(
                f"evidence of {of_ns} ns came while {(self._clone_ns, frame_ns)} ns are remembered; "
                "mark_frame, take_evidence and keep_frame go together"
            )
        before = core.factor
        core.widen_places(widening)
        verdict = self._gate.take(core, evidence, whole)
        if verdict.outcome in {Outcome.REFUSED, Outcome.EMPTY}:
            core.factor = before
        return verdict

    @property
    def frame_pose(self) -> Array:
        """``T_world_body`` of the frame as it is believed now, (4, 4).

        Raises:
            FilterError: no frame has been marked.
        """
        mean = self._marked()[0].mean
        return se3.transform(mean.frame_rotation, mean.vector[mean.layout.frame_position])

    def _marked(self) -> tuple[SquareRootFilter, int]:
        core = self._started()
        if self._frame_ns is None:
            raise FilterError("no frame has been marked; call mark_frame() first")
        return core, self._frame_ns

    def _bridge(self, core: SquareRootFilter, reading: Reading) -> tuple[Reading, float]:
        """Turn with the gyroscope while the joints were silent; returns what is left of the reading and of the step.

        The paper's profile takes the whole gap in one step, as printed.
        """
        rest_of = reading
        if isinstance(self._profile, RobustProfile):
            for stamp_ns, rate in reading.gyroscope:
                if stamp_ns <= self._stamp_ns or stamp_ns >= reading.stamp_ns:
                    continue
                dt_s = (stamp_ns - self._stamp_ns) / NS_PER_S
                self._profile.coast(core, rate, dt_s, self._gyroscope_noise(dt_s))
                self._stamp_ns = stamp_ns
            last = reading.gyroscope[-1] if reading.gyroscope else None
            is_current = last is not None and last[0] >= reading.stamp_ns
            rest_of = replace(reading, angular_velocity=last[1] if last is not None and is_current else None)
        return rest_of, (reading.stamp_ns - self._stamp_ns) / NS_PER_S

    def _gyroscope_noise(self, dt_s: float) -> float:
        """One sigma of the gyroscope averaged over a step, rad/s."""
        return float(self._robot.description.imu.gyroscope_noise_density / np.sqrt(dt_s))

    def _try_to_start(self, reading: Reading) -> StateEstimate | None:
        rest = self._intake.rest
        if self._first_ns is None:
            self._first_ns = reading.stamp_ns
        waited_s = (reading.stamp_ns - self._first_ns) / NS_PER_S
        if rest is None and waited_s < self.config.rest_timeout_s:
            return None
        self._counts["started_moving"] += rest is None
        profile = self._profile
        self._core = initial_filter(
            profile.layout,
            self.config.initial,
            reading,
            rest,
            moving_force=self._intake.mean_force,
            unsure=profile.unsure_feet(reading),
            is_wide=profile.is_wide,
        )
        profile.start(reading)
        self._stamp_ns = reading.stamp_ns
        return self._estimate(self._core, reading, reading.is_stance)

    def _estimate(self, core: SquareRootFilter, reading: Reading, is_stance: BoolArray) -> StateEstimate:
        mean = core.mean
        vector = mean.vector
        rows = mean.plain_jacobian() @ core.factor
        covariance = rows @ rows.T
        if not np.isfinite(vector).all() or not np.isfinite(covariance).all():
            raise FilterError(f"the state is not finite any more at {reading.stamp_ns} ns: {_ADVICE}")
        nav = NavState(
            se3.transform(mean.rotation, vector[POSITION]),
            vector[VELOCITY],
            vector[RATE],
            vector[GYROSCOPE_BIAS],
            vector[ACCELEROMETER_BIAS],
        )
        layout = mean.layout
        probability = np.clip(vector[layout.contacts], 0.0, 1.0) if layout.has_contacts else reading.contact.probability
        return StateEstimate(reading.stamp_ns, nav, covariance, FootState(mean.feet, probability, is_stance))

    def _started(self) -> SquareRootFilter:
        if self._core is None:
            raise FilterError(
                "the filter has not started: it waits for the robot to stand still; push measurements first"
            )
        return self._core

    def _cloned(self) -> tuple[SquareRootFilter, int]:
        core = self._started()
        if self._clone_ns is None:
            raise FilterError("no pose has been cloned; call clone() at a keyframe first")
        return core, self._clone_ns

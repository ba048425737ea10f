# SPDX-License-Identifier: BSD-3-Clause
"""From single measurements to one reading of legs and IMU at each joint sample, for every estimator with legs.

Order of the stamps, kinematics of the feet, load and contact, averaged IMU, rest: each once. Every refused or missing
sample is counted.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from coclo_vio.robot.contact import ContactConfig, ContactDetector, ContactState
from coclo_vio.robot.foot_load import FootLoad
from coclo_vio.robot.foot_motion import FootMotion
from coclo_vio.robot.foot_motion_model import FootMotionModel
from coclo_vio.robot.gravity_check import GravityCheck
from coclo_vio.robot.model import FeetKinematics, RobotModel
from coclo_vio.robot.sole_contact import SoleContact
from coclo_vio.robot.standstill import ImuMeans, StandstillConfig, StandstillDetector
from coclo_vio.robot.unloading import Unloading
from coclo_vio.values.arrays import Array, BoolArray, frozen
from coclo_vio.values.errors import RobotModelError
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample, Measurement
from coclo_vio.values.outputs import Event

_MAX_FORCES = 200  # accelerometer samples that are kept while no joint sample comes


class InertialStep(NamedTuple):
    """One sample of the body's IMU, in body axes.

    Attributes:
        stamp_ns: time in nanoseconds.
        angular_velocity: rad/s, (3,).
        specific_force: m/s^2, (3,).
    """

    stamp_ns: int
    angular_velocity: Array
    specific_force: Array


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """All sensors at one joint sample; missing values are None or NaN.

    Attributes:
        stamp_ns: time in nanoseconds.
        feet: foot kinematics; rows of an unknown leg are NaN.
        contact: probability and decision for each leg.
        angular_velocity: gyroscope mean since the last joint sample, body frame, rad/s, (3,).
        inertial: each sample of the IMU since the last joint sample, oldest first.
        specific_force: accelerometer mean since the last joint sample and the one before, body frame, m/s^2, (3,).
        is_stationary: whether the robot stands still.
        joint_position: as read, rad, (J,); None where it was not kept.
        contact_shift_body: how far the point of contact of each foot went along its sole since the last reading, m, in
            body axes of then and of now, (2, n, 3): ``feet`` are at these points; None where they are at the centres.
        motion: of the feet, as standing feet would measure the body; None where it was not kept.
        is_known: legs whose kinematics are known, (n,).
        is_stance: legs in stance, (n,): by contact, or all of them while the robot stands still; unknown legs never.
        stands: whether any leg is in stance.
    """

    stamp_ns: int
    feet: FeetKinematics
    contact: ContactState
    angular_velocity: Array | None
    inertial: tuple[InertialStep, ...]
    specific_force: Array | None
    is_stationary: bool
    joint_position: Array | None = None
    contact_shift_body: Array | None = None
    motion: FootMotion | None = None
    is_known: BoolArray = field(init=False)
    is_stance: BoolArray = field(init=False)
    stands: bool = field(init=False)

    def __post_init__(self) -> None:
        is_known = np.isfinite(self.feet.velocity_body[:, 0])
        is_stance = is_known & (self.contact.is_stance | self.is_stationary)
        frozen(self, "is_known", is_known)
        frozen(self, "is_stance", is_stance)
        frozen(self, "stands", bool(is_stance.any()))


class LegSensing:
    """Collects measurements until a joint sample completes a reading.

    A sample whose stamp is not later than the last of its kind is refused and counted, and changes nothing.
    """

    def __init__(
        self,
        robot: RobotModel,
        contact: ContactConfig,
        standstill: StandstillConfig,
        *,
        force_timeout_s: float,
        rocks_soles: bool = False,
        checks_gravity: bool = False,
    ) -> None:
        """Take a robot.

        Args:
            robot: the legs.
            contact: how the load on a foot becomes contact.
            standstill: limits of a standstill.
            force_timeout_s: foot forces older than this count as missing, s.
            rocks_soles: whether a flat foot is taken at the point where it touches the ground, not at its centre.
            checks_gravity: whether an IMU that contradicts the attitude is left out, as if it were silent.
        """
        self._robot = robot
        self._soles = SoleContact(robot) if rocks_soles else None
        self._contact = ContactDetector(contact, len(robot.leg_names))
        self._standstill = StandstillDetector(standstill.limits_of(has_flat_feet=robot.description.has_flat_feet))
        self._load = FootLoad(robot, contact, force_timeout_s)
        is_used = contact.source == "force_sensor" and contact.unloaded_force is not None
        self._unloading = Unloading(contact.unloaded_force or 0.0, len(robot.leg_names)) if is_used else None
        self._motion = FootMotionModel(robot)
        self._counts: Counter[str] = Counter()
        self._rotation_body_imu = robot.description.imu.T_body_imu[:3, :3]
        self._imu: ImuSample | None = None
        self._force_sum: Array = np.zeros(3)
        self._force_count = 0
        self._inertial: list[InertialStep] = []  # since the last joint sample, or since they were taken
        self._forces_body: list[Array] = []  # since the last joint sample, and the one before
        self._joint_ns: int | None = None
        self._rest: ImuMeans | None = None
        self._gravity = GravityCheck("body's") if checks_gravity else None
        self._stands = False  # whether a foot was in stance at the last joint sample

    @property
    def counts(self) -> Mapping[str, int]:
        """Samples refused or missing, unknown legs, standstills and loads, by name."""
        return {**self._counts, **self._contact.counts, **self._standstill.counts}

    @property
    def is_imu_aside(self) -> bool:
        """Whether the samples of the body's IMU are left out."""
        return self._gravity is not None and self._gravity.is_aside

    @property
    def stands(self) -> bool:
        """Whether a foot was in stance at the last joint sample."""
        return self._stands

    @property
    def rest(self) -> ImuMeans | None:
        """Mean IMU samples at the last joint sample if the robot stood still then, in the body frame."""
        return self._rest

    @property
    def imu(self) -> ImuSample | None:
        """The newest IMU sample that was in order."""
        return self._imu

    @property
    def mean_force(self) -> Array | None:
        """Mean specific force of all samples so far, body frame, m/s^2, (3,): near gravity if the robot only sways."""
        return None if self._force_count == 0 else self._force_sum / self._force_count

    @property
    def specific_force(self) -> Array | None:
        """Mean of the accelerometer since the last joint sample and the one before, body frame, m/s^2, (3,).

        With one accelerometer sample for each joint sample it is the mean of two of section III-D.
        """
        if not self._forces_body:
            return None
        return _mean(self._forces_body)

    def push(self, measurement: Measurement, up_body: Array | None) -> Reading | None:
        """Take one measurement; a joint sample in order gives a reading.

        Args:
            measurement: the measurement.
            up_body: the upward direction in the body frame, (3,), or None before the start.

        Raises:
            RobotModelError: the sample has another number of joints or legs than the robot.
        """
        match measurement:
            case ImuSample():
                self._take_imu(measurement, up_body)
            case FootForceSample():
                self._take_force(measurement)
            case JointSample():
                return self._take_joints(measurement, up_body)
        return None

    def take_inertial(self) -> Sequence[InertialStep]:
        """The samples of the IMU since the last joint sample, of which the next one will know nothing."""
        taken, self._inertial, self._forces_body = self._inertial, [], self._forces_body[-1:]
        return taken

    def take_events(self) -> Sequence[Event]:
        """Whether the IMU was set aside or used again since the last call."""
        return () if self._gravity is None else self._gravity.take_events()

    def _take_imu(self, sample: ImuSample, up_body: Array | None) -> None:
        if self._imu is not None and sample.stamp_ns <= self._imu.stamp_ns:
            self._counts["imu_stamp_refused"] += 1
            return
        self._imu = sample
        rate_body, force_body = (self._rotation_body_imu @ v for v in (sample.angular_velocity, sample.specific_force))
        if self._gravity is not None:
            self._gravity.push(sample.stamp_ns, force_body, up_body if self._stands else None)
        if self.is_imu_aside:
            self._counts["imu_contradicts_gravity"] += 1
            return
        self._standstill.push(sample)
        self._inertial.append(InertialStep(sample.stamp_ns, rate_body, force_body))
        self._force_sum += force_body
        self._force_count += 1
        self._forces_body.append(force_body)
        if len(self._forces_body) > _MAX_FORCES + 1:
            del self._forces_body[0]

    def _take_force(self, sample: FootForceSample) -> None:
        self._counts["foot_force_stamp_refused"] += not self._load.push(sample)

    def _take_joints(self, sample: JointSample, up_body: Array | None) -> Reading | None:
        count = len(self._robot.joint_names)
        if len(sample.position) != count:
            raise RobotModelError(
                f"a joint sample has {len(sample.position)} joints, robot {self._robot.description.name!r} has "
                f"{count}; give them in the order of its joint_names"
            )
        if self._joint_ns is not None and sample.stamp_ns <= self._joint_ns:
            self._counts["joint_stamp_refused"] += 1
            return None
        self._standstill.push(sample)
        force = self.specific_force if self._inertial else None  # without new IMU samples gravity is unknown
        if up_body is None:
            up_body = np.array([0.0, 0.0, 1.0]) if force is None else force / max(float(np.linalg.norm(force)), 1e-6)
        feet = self._robot.feet(sample.position, sample.velocity)
        inertial = tuple(self._inertial)
        rate = _mean([each.angular_velocity for each in inertial]) if inertial else None
        load = self._load.loads_at(sample, up_body, rate, feet.jacobian)
        self._rest = self._rest_now()
        stamp_ns, is_stationary = sample.stamp_ns, self._rest is not None
        motion = self._motion.at(stamp_ns, feet, rate, force, up_body, is_stationary=is_stationary)
        contact = self._contact.update(stamp_ns, load, motion)
        if self._unloading is not None:
            contact = self._unloading.corrected(
                stamp_ns, contact, self._load.by_torques(sample, up_body, feet.jacobian)
            )
        feet, shift = self._soles.moved(feet, up_body) if self._soles else (feet, None)
        self._counts["imu_missing"] += rate is None
        self._inertial = []
        self._forces_body = self._forces_body[-1:]
        self._joint_ns = sample.stamp_ns
        reading = Reading(stamp_ns, feet, contact, rate, inertial, force, is_stationary, sample.position, shift, motion)
        self._stands = reading.stands
        self._counts["leg_unknown"] += len(reading.is_known) - int(np.count_nonzero(reading.is_known))
        self._counts["standstill"] += reading.is_stationary
        return reading

    def _rest_now(self) -> ImuMeans | None:
        means = self._standstill.rest
        return None if means is None else means.rotated(self._rotation_body_imu)


def _mean(vectors: Sequence[Array]) -> Array:
    """Mean (3,) of vectors, added in order."""
    total = vectors[0]
    for vector in vectors[1:]:
        total = total + vector
    return total / float(len(vectors))

# SPDX-License-Identifier: BSD-3-Clause
"""From single measurements to one reading at each joint sample: order, averaging, contact.

Every refused or missing sample is counted.
"""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from coclo_vio.filter.config import FilterConfig
from coclo_vio.filter.stance import Reading
from coclo_vio.robot.contact import ContactConfig, ContactDetector
from coclo_vio.robot.foot_load import FootLoad
from coclo_vio.robot.model import RobotModel
from coclo_vio.robot.standstill import Rest, StandstillDetector
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import FilterError
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample, Measurement

_MAX_FORCES = 200  # accelerometer samples that are kept while no joint sample comes


class ReadingBuilder:
    """Collects measurements until a joint sample completes a reading.

    A sample whose stamp is not later than the last of its kind is refused and counted, and changes nothing.
    """

    def __init__(self, robot: RobotModel, config: FilterConfig, contact: ContactConfig, counts: Counter[str]) -> None:
        self._robot = robot
        self._config = config
        self._contact = ContactDetector(contact, len(robot.leg_names))
        self._standstill = StandstillDetector(config.standstill)
        self._counts = counts
        self._rotation_body_imu = robot.description.imu.T_body_imu[:3, :3]
        self._imu_ns: int | None = None
        self._force_sum: Array = np.zeros(3)
        self._force_count = 0
        self._rates: list[tuple[int, Array]] = []  # stamp and rate of each sample since the last joint sample
        self._forces_body: list[Array] = []  # since the last joint sample, and the one before
        self._load = FootLoad(robot, contact, config.force_timeout_s)
        self._joint_ns: int | None = None

    @property
    def counts(self) -> Mapping[str, int]:
        """Counts of contact and standstill."""
        return {**self._contact.counts, **self._standstill.counts}

    @property
    def rest(self) -> Rest | None:
        """Mean IMU samples while the robot stands still, rotated to the body frame; None while it moves."""
        rest = self._standstill.rest
        if rest is None:
            return None
        turn = self._rotation_body_imu
        return Rest(rest.stamp_ns, turn @ rest.angular_velocity, turn @ rest.specific_force, rest.sample_count)

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
            FilterError: the sample has another number of joints than the robot.
            RobotModelError: it has another number of legs.
        """
        match measurement:
            case ImuSample():
                self._take_imu(measurement)
            case FootForceSample():
                self._take_force(measurement)
            case JointSample():
                return self._take_joints(measurement, up_body)
        return None

    def _take_imu(self, sample: ImuSample) -> None:
        if self._imu_ns is not None and sample.stamp_ns <= self._imu_ns:
            self._counts["imu_stamp_refused"] += 1
            return
        self._imu_ns = sample.stamp_ns
        self._standstill.push(sample)
        self._rates.append((sample.stamp_ns, self._rotation_body_imu @ sample.angular_velocity))
        force_body = self._rotation_body_imu @ sample.specific_force
        self._force_sum += force_body
        self._force_count += 1
        self._forces_body.append(force_body)
        if len(self._forces_body) > _MAX_FORCES + 1:
            del self._forces_body[0]

    def _take_force(self, sample: FootForceSample) -> None:
        self._counts["foot_force_stamp_refused"] += not self._load.push(sample)

    def _take_joints(self, sample: JointSample, up_body: Array | None) -> Reading | None:
        joints = len(self._robot.joint_names)
        if len(sample.position) != joints:
            raise FilterError(
                f"a joint sample has {len(sample.position)} joints, robot {self._robot.description.name!r} has "
                f"{joints}; give them in the order of its joint_names"
            )
        if self._joint_ns is not None and sample.stamp_ns <= self._joint_ns:
            self._counts["joint_stamp_refused"] += 1
            return None
        self._standstill.push(sample)
        force = self.specific_force if self._rates else None  # without new IMU samples gravity is unknown
        if up_body is None:
            up_body = np.array([0.0, 0.0, 1.0]) if force is None else force / max(float(np.linalg.norm(force)), 1e-6)
        feet = self._robot.feet(sample.position, sample.velocity)
        rates = tuple(self._rates)
        rate = _mean([each for _, each in rates]) if rates else None
        load = self._load.loads_at(sample, up_body, rate, feet.jacobian)
        contact = self._contact.update(sample.stamp_ns, load)
        if rate is None:
            self._counts["imu_missing"] += 1
        self._rates = []
        self._forces_body = self._forces_body[-1:]
        self._joint_ns = sample.stamp_ns
        reading = Reading(sample.stamp_ns, feet, contact, rate, rates, force, self._standstill.is_stationary)
        self._counts["leg_unknown"] += int(np.count_nonzero(~reading.is_known))
        self._counts["standstill"] += reading.is_stationary
        return reading


def _mean(vectors: Sequence[Array]) -> Array:
    """Mean (3,) of vectors, added in order."""
    total = vectors[0]
    for vector in vectors[1:]:
        total = total + vector
    return total / float(len(vectors))

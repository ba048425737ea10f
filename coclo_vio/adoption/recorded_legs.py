# SPDX-License-Identifier: BSD-3-Clause
"""The leg sensors of a recording as arrays, and when the robot stood still."""

from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from coclo_vio.datasets.dataset import DatasetConfig, open_dataset
from coclo_vio.robot.description import LegDescription, RobotDescription
from coclo_vio.values.arrays import Array, BoolArray, IntArray
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.measurements import LEG_SENSORS, FootForceSample, ImuSample, JointSample
from coclo_vio.values.units import NS_PER_S

_MOST_MEASUREMENTS = 150_000
_REST_S = 0.5
_REST_RAD, _REST_RADPS = 0.01, 0.06  # scatter of a joint and of the gyroscope over half a second of rest
_ESTIMATED = "estimated"  # word of the readers' notes on velocities that a log lacks


@dataclass(frozen=True, slots=True, eq=False)
class RecordedLegs:
    """Leg sensors over a recording; N joint samples, M IMU samples, K readings of the foot sensors.

    Attributes:
        joint_ns: stamps in nanoseconds, (N,), increasing.
        position: as read, (N, J).
        velocity: as read, or estimated where the log has none, (N, J).
        effort: as read, (N, J); NaN where the log has none.
        has_velocity: whether the log has velocities.
        imu_ns: stamps in nanoseconds, (M,).
        angular_velocity: imu frame, (M, 3).
        specific_force: imu frame, (M, 3).
        force: of each foot at the joint samples, (N, legs); NaN where there is none.
    """

    joint_ns: IntArray
    position: Array
    velocity: Array
    effort: Array
    has_velocity: bool
    imu_ns: IntArray
    angular_velocity: Array
    specific_force: Array
    force: Array

    @property
    def rate_hz(self) -> float:
        """Median rate of the joint samples, Hz."""
        return float(NS_PER_S / max(float(np.median(np.diff(self.joint_ns))), 1.0))

    @property
    def has_imu(self) -> bool:
        """Whether there is an IMU with more than a few samples."""
        return len(self.imu_ns) > 10

    @property
    def has_effort(self) -> bool:
        """Whether torques were read, and are not all zero."""
        return bool(np.isfinite(self.effort).any() and np.nanmax(np.abs(self.effort)) > 0.0)

    @property
    def has_force(self) -> bool:
        """Whether the feet have sensors that read anything but a constant."""
        return bool(np.isfinite(self.force).any() and np.nanstd(self.force) > 0.0)

    def imu_at_joints(self, delay_s: float = 0.0) -> tuple[Array, Array]:
        """Angular velocity and specific force (N, 3) interpolated at the joint samples, of an IMU late by a delay."""
        times = (self.joint_ns - self.imu_ns[0]) / NS_PER_S + delay_s
        own = (self.imu_ns - self.imu_ns[0]) / NS_PER_S
        return (
            np.column_stack([np.interp(times, own, column) for column in self.angular_velocity.T]),
            np.column_stack([np.interp(times, own, column) for column in self.specific_force.T]),
        )

    def is_rest(self) -> BoolArray:
        """Joint samples (N,) in the middle of half a second in which neither joints nor gyroscope moved."""
        width = max(int(_REST_S * self.rate_hz), 3)
        is_quiet = np.nanmax(_scatter(self.position, width), axis=1) < _REST_RAD
        if self.has_imu:
            rate = self.imu_at_joints()[0]
            is_quiet &= np.sqrt((_scatter(rate, width) ** 2).sum(axis=1)) < _REST_RADPS
        is_quiet[: width // 2] = is_quiet[len(is_quiet) - width // 2 :] = False
        return np.asarray(is_quiet)


def read_legs(path: Path, robot: RobotDescription, config: DatasetConfig) -> RecordedLegs:
    """Read joints, IMU and foot sensors of a recording, at most its first minutes.

    Raises:
        DatasetError: the recording is malformed, or has no sample of a joint.
    """
    dataset = open_dataset(path, robot, config)
    joints: list[JointSample] = []
    inertial: list[ImuSample] = []
    forces: list[Array] = []
    none = np.full(len(robot.legs), np.nan)
    force = none
    for sample in islice(dataset.measurements(LEG_SENSORS), _MOST_MEASUREMENTS):
        match sample:
            case JointSample() if not joints or sample.stamp_ns > joints[-1].stamp_ns:
                joints.append(sample)
                forces.append(force)
            case ImuSample() if not inertial or sample.stamp_ns > inertial[-1].stamp_ns:
                inertial.append(sample)
            case FootForceSample():
                force = sample.force
    if len(joints) < 20:
        raise DatasetError(
            f"{path} has {len(joints)} readings of the joints; a robot is adopted from a walk of some seconds"
        )
    return RecordedLegs(
        joint_ns=np.array([sample.stamp_ns for sample in joints], dtype=np.int64),
        position=np.array([sample.position for sample in joints]),
        velocity=np.array([sample.velocity for sample in joints]),
        effort=np.array([sample.effort for sample in joints]),
        has_velocity=not any(_ESTIMATED in note for note in dataset.report().notes),
        imu_ns=np.array([sample.stamp_ns for sample in inertial], dtype=np.int64),
        angular_velocity=np.array([sample.angular_velocity for sample in inertial]).reshape(-1, 3),
        specific_force=np.array([sample.specific_force for sample in inertial]).reshape(-1, 3),
        force=np.array(forces).reshape(len(joints), len(robot.legs)),
    )


def log_robot(names: tuple[str, ...]) -> RobotDescription:
    """A stand-in for reading a log whose joints are not matched yet: one leg that has the log's names as joints."""
    leg = LegDescription(name="log", joints=names, foot_frame="none")
    return RobotDescription.parse({"name": "log", "urdf": "none", "legs": (leg,)}, "log")


def _scatter(values: Array, width: int) -> Array:
    """Standard deviation over a centred window of ``width`` samples, (N, columns)."""
    filled = np.nan_to_num(values - np.nanmean(values, axis=0))
    ends = np.clip(np.arange(len(values)) + width // 2 + 1, 0, len(values))
    starts = np.clip(np.arange(len(values)) - width // 2, 0, len(values))
    count = (ends - starts)[:, None]
    sums = [np.vstack((np.zeros(values.shape[1]), np.cumsum(power, axis=0))) for power in (filled, filled**2)]
    mean, square = ((total[ends] - total[starts]) / count for total in sums)
    return np.asarray(np.sqrt(np.maximum(square - mean**2, 0.0)))

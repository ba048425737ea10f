# SPDX-License-Identifier: BSD-3-Clause
"""What the sensors say: frozen values, one class a sensor, stamped in integer nanoseconds.

Readers make them, the filter takes them. Arrays are checked once, here, and are read-only from then on.
"""

from dataclasses import dataclass

from coclo_vio.arrays import Array, checked, frozen


@dataclass(frozen=True, slots=True, eq=False)
class ImuSample:
    """One reading of an inertial measurement unit, in the imu frame.

    Attributes:
        stamp_ns: time in nanoseconds.
        angular_velocity: gyroscope, rad/s, (3,).
        specific_force: accelerometer, m/s^2, (3,); at rest it points up with 9.81.

    Raises:
        ValueError: a wrong shape, or a reading that is not finite.
    """

    stamp_ns: int
    angular_velocity: Array
    specific_force: Array

    def __post_init__(self) -> None:
        frozen(self, "angular_velocity", checked("ImuSample.angular_velocity", self.angular_velocity, (3,)))
        frozen(self, "specific_force", checked("ImuSample.specific_force", self.specific_force, (3,)))


@dataclass(frozen=True, slots=True, eq=False)
class JointSample:
    """One reading of all leg joints, in the order of ``RobotModel.joint_names``.

    NaN means "this joint said nothing"; the legs it belongs to are left out, the others used.

    Attributes:
        stamp_ns: time in nanoseconds.
        position: rad, (joints,).
        velocity: rad/s, (joints,).
        effort: Nm, (joints,), as measured: the torque the motor puts on the joint; all NaN where a robot measures none.

    Raises:
        ValueError: arrays of different length, or an infinite reading.
    """

    stamp_ns: int
    position: Array
    velocity: Array
    effort: Array

    def __post_init__(self) -> None:
        frozen(self, "position", checked("JointSample.position", self.position, (None,), allow_nan=True))
        shape = (len(self.position),)
        frozen(self, "velocity", checked("JointSample.velocity", self.velocity, shape, allow_nan=True))
        frozen(self, "effort", checked("JointSample.effort", self.effort, shape, allow_nan=True))


@dataclass(frozen=True, slots=True, eq=False)
class FootForceSample:
    """One reading of the foot sensors, in the order of the robot's legs.

    Attributes:
        stamp_ns: time in nanoseconds.
        force: normal force, (legs,), in the unit of the robot's contact thresholds (N, or raw counts);
            NaN where a sensor said nothing.

    Raises:
        ValueError: not a vector, or an infinite reading.
    """

    stamp_ns: int
    force: Array

    def __post_init__(self) -> None:
        frozen(self, "force", checked("FootForceSample.force", self.force, (None,), allow_nan=True))


Measurement = ImuSample | JointSample | FootForceSample

# SPDX-License-Identifier: BSD-3-Clause
"""From the kinematics of the feet and the IMU to ``FootMotion``, for contact estimators and the search for slip."""

import math

import numpy as np

from coclo_vio.geometry.compiled import compiled
from coclo_vio.geometry.so3_kernels import cross
from coclo_vio.robot.foot_motion import FootMotion
from coclo_vio.robot.model import FeetKinematics, RobotModel
from coclo_vio.values.arrays import Array


class FootMotionModel:
    """Turns kinematics and IMU into ``FootMotion``."""

    def __init__(self, robot: RobotModel) -> None:
        """Args: the legs."""
        self._radii_m = robot.foot_radii_m
        self._joint_variance = robot.description.joint_velocity_noise_radps**2
        self._lever = np.array(robot.description.imu.position_body_m)
        self._rate: Array = np.zeros(3)

    def at(
        self,
        stamp_ns: int,
        feet: FeetKinematics,
        rate: Array | None,
        force: Array | None,
        up_body: Array,
        *,
        is_stationary: bool,
    ) -> FootMotion:
        """The motion at a joint sample.

        Args:
            stamp_ns: time in nanoseconds.
            feet: kinematics.
            rate: of the gyroscope, rad/s, body axes, (3,), None where there is no sample.
            force: of the accelerometer, m/s^2, body axes, (3,), None where there is no sample.
            up_body: upward direction in the body frame, (3,).
            is_stationary: whether the robot stands still.
        """
        self._rate = self._rate if rate is None else rate
        of_feet, imu_turning = _motion_of(
            (
                np.ascontiguousarray(feet.position_body),
                np.ascontiguousarray(feet.velocity_body),
                np.ascontiguousarray(feet.angular_velocity_body),
                np.ascontiguousarray(feet.jacobian),
            ),
            self._radii_m,
            (self._rate, up_body, self._lever),
            self._joint_variance,
        )
        velocity, variance, depth, speed = of_feet[:, :3], of_feet[:, 3], of_feet[:, 4], of_feet[:, 5]
        return FootMotion(
            stamp_ns, velocity, variance, depth, speed, force, imu_turning, self._rate, up_body, is_stationary
        )


@compiled
def _motion_of(
    feet: tuple[Array, Array, Array, Array], radii_m: Array, body: tuple[Array, Array, Array], joint_variance: float
) -> tuple[Array, Array]:
    """What each foot measures if it stands, (n, 6), and the velocity of the IMU by the body's rate, (3,).

    Args:
        feet: centres, m, (n, 3), their velocities, m/s, (n, 3), rates of the foot links, rad/s, (n, 3), body axes, and
            Jacobian, (n, 6, J).
        radii_m: of the feet, (n,).
        body: its rate, rad/s, the upward direction, and the place of the IMU, m, body axes, (3,) each.
        joint_variance: of the joint velocities, (rad/s)^2.

    Returns:
        For each foot velocity of the body, m/s, its variance by the joints, depth, m, and speed, m/s.
    """
    position, velocity, turn, jacobian = feet
    rate, up, lever = body
    found, imu_turning = np.empty((len(radii_m), 6)), np.empty(3)
    imu_turning[0], imu_turning[1], imu_turning[2] = cross(rate[0], rate[1], rate[2], lever[0], lever[1], lever[2])
    for leg in range(len(radii_m)):
        p, v, w = position[leg], velocity[leg], turn[leg]
        rx, ry, rz = cross(rate[0] + w[0], rate[1] + w[1], rate[2] + w[2], up[0], up[1], up[2])
        tx, ty, tz = cross(rate[0], rate[1], rate[2], p[0], p[1], p[2])
        found[leg, 0] = radii_m[leg] * rx - v[0] - tx
        found[leg, 1] = radii_m[leg] * ry - v[1] - ty
        found[leg, 2] = radii_m[leg] * rz - v[2] - tz
        square = 0.0
        for i in range(3, 6):
            for j in range(jacobian.shape[2]):
                square += jacobian[leg, i, j] ** 2
        found[leg, 3] = joint_variance / 3.0 * square
        found[leg, 4] = radii_m[leg] - (p[0] * up[0] + p[1] * up[1] + p[2] * up[2])
        found[leg, 5] = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    return found, imu_turning

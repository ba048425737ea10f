# SPDX-License-Identifier: BSD-3-Clause
"""From the kinematics of the feet and the IMU to ``FootMotion``, for contact estimators and the search for slip."""

import numpy as np

from coclo_vio.geometry import so3
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
        turning = so3.hat(self._rate)
        rolling = (self._rate + feet.angular_velocity_body) @ so3.hat(up_body)  # rows: (rate of the foot) x up
        linear = feet.jacobian[:, 3:]
        return FootMotion(
            stamp_ns,
            self._radii_m[:, None] * rolling - feet.velocity_body - feet.position_body @ turning.T,
            self._joint_variance / 3.0 * np.einsum("nij,nij->n", linear, linear),
            self._radii_m - feet.position_body @ up_body,
            np.sqrt(np.einsum("ni,ni->n", feet.velocity_body, feet.velocity_body)),
            force,
            turning @ self._lever,
            self._rate,
            up_body,
            is_stationary,
        )

# SPDX-License-Identifier: BSD-3-Clause
"""What joints and IMU state of the feet's motion at one sample: the input of contact estimators without a load."""

from dataclasses import dataclass

from coclo_vio.values.arrays import Array


@dataclass(frozen=True, slots=True, eq=False)
class FootMotion:
    """The feet as they would measure the body if they stood, and the IMU; rows of an unknown leg are NaN.

    A foot that stands moves in the body by ``-v - w x c``, with ``v`` and ``w`` the body's velocity and rate and ``c``
    the point of contact. So each foot gives the ``v`` that the body has if this foot stands; standing feet agree on it.

    Attributes:
        stamp_ns: time in nanoseconds.
        body_velocity: velocity of the body origin if the foot stands, m/s, body axes, (n, 3).
        velocity_variance: of it by the noise of the joint velocities, mean of the axes, m^2/s^2, (n,).
        depth_m: of the lowest point of the foot below the body origin along gravity, m, (n,).
        foot_speed: of the foot relative to the body, m/s, (n,).
        specific_force: of the IMU, m/s^2, body axes, (3,); None where there is no sample.
        imu_turning: velocity of the IMU relative to the body origin by the body's rate, m/s, body axes, (3,).
        angular_velocity: of the body, rad/s, (3,); the last known one where there is no sample.
        up_body: upward direction in the body frame, (3,).
        is_stationary: whether the robot stands still.
    """

    stamp_ns: int
    body_velocity: Array
    velocity_variance: Array
    depth_m: Array
    foot_speed: Array
    specific_force: Array | None
    imu_turning: Array
    angular_velocity: Array
    up_body: Array
    is_stationary: bool

# SPDX-License-Identifier: BSD-3-Clause
"""The specific force of an IMU at the end of a lever arm, as GTSAM's preintegration has to be given it.

GTSAM takes the force of a step as constant in the axes of its beginning, and accounts only for the centripetal part of
a lever arm: here the force is rotated by half the step, and the effect of angular acceleration at the end of the arm
is subtracted.
"""

import numpy as np

from coclo_vio.geometry import so3
from coclo_vio.geometry.compiled import IS_COMPILED, compiled
from coclo_vio.geometry.so3_kernels import cross, rotated, set_exp
from coclo_vio.values.arrays import Array


def mean_reading(begin: Array, end: Array, rate_before: Array, bias: Array, lever: Array, dt_s: float) -> Array:
    """Mean angular velocity and specific force of a step, rad/s and m/s^2, imu frame, (6,).

    Args:
        begin: angular velocity and specific force at its beginning, (6,).
        end: the same at its end, (6,).
        rate_before: angular velocity up to which the lever arm has been accounted for, rad/s, (3,).
        bias: of accelerometer and gyroscope, as GTSAM orders them, (6,).
        lever: from the body's origin to the IMU, m, (3,).
        dt_s: its length, s.
    """
    if IS_COMPILED:
        result = np.empty(6)
        set_mean_reading(result, begin, end, rate_before, bias, lever, dt_s)
        return result
    return mean_reading_by_numpy(begin, end, rate_before, bias, lever, dt_s)


def mean_reading_by_numpy(
    begin: Array, end: Array, rate_before: Array, bias: Array, lever: Array, dt_s: float
) -> Array:
    """The readable form of ``mean_reading``."""
    mean = 0.5 * (begin + end)
    acceleration = (end[:3] - rate_before) / dt_s
    turning = mean[:3] - bias[3:]
    subtracted_by_gtsam = np.cross(turning, np.cross(turning, lever)) + bias[:3]
    at_origin = mean[3:] - np.cross(acceleration, lever) - subtracted_by_gtsam
    mean[3:] = so3.exp(0.5 * dt_s * turning) @ at_origin + subtracted_by_gtsam
    return np.asarray(mean)


@compiled
def set_mean_reading(
    result: Array, begin: Array, end: Array, rate_before: Array, bias: Array, lever: Array, dt_s: float
) -> None:
    """The compiled form of ``mean_reading``."""
    turning, acceleration, turn = np.empty(3), np.empty(3), np.empty((3, 3))
    for i in range(3):
        result[i] = 0.5 * (begin[i] + end[i])
        turning[i] = result[i] - bias[3 + i]
        acceleration[i] = (end[i] - rate_before[i]) / dt_s
    x, y, z = cross(turning[0], turning[1], turning[2], lever[0], lever[1], lever[2])
    x, y, z = cross(turning[0], turning[1], turning[2], x, y, z)
    x, y, z = x + bias[0], y + bias[1], z + bias[2]
    ax, ay, az = cross(acceleration[0], acceleration[1], acceleration[2], lever[0], lever[1], lever[2])
    half = 0.5 * dt_s
    set_exp(turn, half * turning[0], half * turning[1], half * turning[2])
    fx, fy, fz = rotated(
        turn,
        0.5 * (begin[3] + end[3]) - ax - x,
        0.5 * (begin[4] + end[4]) - ay - y,
        0.5 * (begin[5] + end[5]) - az - z,
    )
    result[3], result[4], result[5] = fx + x, fy + y, fz + z

# SPDX-License-Identifier: BSD-3-Clause
"""Compiled prediction: sigma points, their images by ``process_model``, mean, and rows of the new covariance.

The flat columns of the factor move only states in which the process is linear, so their rows follow from the columns
themselves; only the curved ones are moved as pairs of points.
"""

import math
from typing import NamedTuple

import numpy as np

from coclo_vio.filter.process_model import UNKNOWN_LEG_NOISE_M, Interval
from coclo_vio.filter.stance import FootMotion
from coclo_vio.filter.state import (
    BODY_ERRORS as BODY,
)
from coclo_vio.filter.state import (
    CURVED_IN_PROCESS as CURVED,
)
from coclo_vio.filter.state import (
    LEG_COMPLIANCE,
    LEG_SCALE,
    LOAD_SLIP,
    POSITION,
    RATE,
    SLIP,
    SLIP_TURN,
    VELOCITY,
)
from coclo_vio.filter.state_kernels import set_errors, set_rest_and_shares, set_spread
from coclo_vio.geometry.array_types import Array, IntArray
from coclo_vio.geometry.compiled import compiled, inlined
from coclo_vio.geometry.so3_kernels import cross, rotated, rotated_back, set_exp, set_product, set_product_transposed

_LEG_SCALE, _RATE, _LEG_COMPLIANCE, _SLIP_TURN = LEG_SCALE.start, RATE.start, LEG_COMPLIANCE.start, SLIP_TURN.start
_LOAD_SLIP = LOAD_SLIP.start
_SLIP, _VELOCITY, _POSITION = SLIP.start, VELOCITY.start, POSITION.start
_ACCELERATIONS = 6  # rows of noise of the body: angular and linear acceleration


class ProcessConstants(NamedTuple):
    """What the prediction knows of the robot, of the process (``RobustConfig``) and of the state (``StateLayout``)."""

    radii_m: Array
    hips_body: Array
    angular_acceleration: float
    walks: Array
    walking: IntArray
    memories_s: Array
    world_stop: int
    active: int


class Step(NamedTuple):
    """One step: its length, the speed at its begin, m/s, and what is left of the mean of each error, (L,)."""

    dt_s: float
    speed: float
    kept: Array


@compiled
def slip_velocity(vector: Array, position_body: Array, speed: float, takeover: float) -> tuple[float, float, float]:
    """Velocity of a standing foot's slip, body axes, m/s: ``process_model.slip_velocity`` of one foot (3,)."""
    x, y, z = position_body[0], position_body[1], position_body[2]
    x, y, z = cross(x, y, z, vector[_SLIP_TURN], vector[_SLIP_TURN + 1], vector[_SLIP_TURN + 2])
    return (
        speed * (vector[_SLIP] - x) + takeover * vector[_LOAD_SLIP],
        speed * (vector[_SLIP + 1] - y) + takeover * vector[_LOAD_SLIP + 1],
        speed * (vector[_SLIP + 2] - z) + takeover * vector[_LOAD_SLIP + 2],
    )


@inlined
def speed_of(vector: Array) -> float:
    """Speed of a state's vector (L,), m/s."""
    return math.sqrt(vector[_VELOCITY] ** 2 + vector[_VELOCITY + 1] ** 2 + vector[_VELOCITY + 2] ** 2)


@inlined
def _add(vector: Array, at: int, x: float, y: float, z: float) -> None:
    vector[at] += x
    vector[at + 1] += y
    vector[at + 2] += z


@compiled
def _set_flat(moved: Array, vector: Array, R: Array, motion: FootMotion, step: Step) -> None:
    """The part of the process that is linear in a vector (L,) given rotation, leg scale and rate."""
    for i in range(len(vector)):
        moved[i] = vector[i] * step.kept[i]
    for i in range(3):
        moved[_POSITION + i] += vector[_VELOCITY + i] * step.dt_s
    for leg in range(len(motion.holds)):
        at = BODY + 3 * leg
        if motion.holds[leg]:
            sx, sy, sz = slip_velocity(vector, motion.position_body[leg], step.speed, motion.takeover_speed)
            x, y, z = rotated(R, sx, sy, sz)
            _add(moved, at, x * step.dt_s, y * step.dt_s, z * step.dt_s)
        else:
            for i in range(3):
                moved[at + i] = moved[_POSITION + i]
            moved[at + 2] += vector[_LEG_COMPLIANCE] * motion.load_ratio[leg]


@compiled
def _set_moved(
    R_moved: Array, moved: Array, R: Array, vector: Array, motion: FootMotion, step: Step, constants: ProcessConstants
) -> None:
    """One point a step later: ``process_model.predict``."""
    _set_flat(moved, vector, R, motion, step)
    wx, wy, wz = vector[_RATE] * step.dt_s, vector[_RATE + 1] * step.dt_s, vector[_RATE + 2] * step.dt_s
    turn = np.empty((3, 3))
    set_exp(turn, wx, wy, wz)
    set_product(R_moved, R, turn)
    for leg in range(len(motion.holds)):
        at = BODY + 3 * leg
        if motion.holds[leg]:
            m = motion.turn_body[leg]
            cx, cy, cz = cross(m[0], m[1], m[2], wx, wy, wz)
            x, y, z = rotated(R, wx + m[0] - 0.5 * cx, wy + m[1] - 0.5 * cy, wz + m[2] - 0.5 * cz)
            normal, radius = motion.normals[leg], constants.radii_m[leg]
            x, y, z = cross(x, y, z, normal[0], normal[1], normal[2])
            _add(moved, at, radius * x, radius * y, radius * z)
        else:
            p, hip, scale = motion.position_body[leg], constants.hips_body[leg], vector[_LEG_SCALE]
            x, y, z = rotated(R_moved, p[0] + scale * (p[0] - hip[0]), p[1] + scale * (p[1] - hip[1]), p[2])
            _add(moved, at, x, y, z)


@compiled
def predicted(
    rotation: Array,
    vector: Array,
    covariance: tuple[Array, Array],
    motion: FootMotion,
    foot_noise: Array,
    constants: ProcessConstants,
    interval: Interval,
    width_squared: float,
) -> tuple[Array, Array, Array, Array]:
    """Prediction of mean and covariance: ``SquareRootFilter.predict`` up to the triangle.

    Args:
        rotation: of the mean, (3, 3).
        vector: of the mean, (L,).
        covariance: its lower factor, (L, L), and the covariance with the passive errors, (L, p).
        motion: of the feet, by the joints.
        foot_noise: lower factors of each foot position's covariance, body frame, m, (n, 3, 3).
        constants: of robot and process.
        interval: from the last sample to this one.
        width_squared: of the sigma points, see ``SigmaSpread``.

    Returns:
        Rotation (3, 3) and vector (L,) of the new mean, rows (m, L) of the new covariance, column by column in memory,
        and the new covariance with the passive errors.
    """
    legs, length = len(motion.holds), len(vector)
    dt_s = interval.dt_s
    kept = np.empty(length)
    for i in range(length):
        kept[i] = math.exp(-dt_s / constants.memories_s[i])
    step = Step(dt_s, speed_of(vector), kept)
    factor, cross = covariance
    turned, images = _images(rotation, vector, factor, motion, step, constants, width_squared)
    R, mean = _mean(turned, images, width_squared, constants)
    feet_at = length + CURVED + 1 + _ACCELERATIONS + len(constants.walking)
    rows = np.zeros((length, feet_at + 3 * legs)).T
    _set_spread_rows(rows, turned, images, R, mean, constants.world_stop, width_squared)
    turn = _turn(turned[0], R)
    _set_flat_rows(rows, factor, rotation, motion, step, turn, constants.world_stop)
    new_cross = _moved_cross(cross, rows, factor, rotation, motion, step, turn, constants.world_stop)
    noise = rows[length + CURVED + 1 :]
    _set_body_noise(noise, R, interval, constants)
    _set_world_noise(noise, R, mean, motion, constants)
    _set_foot_noise(rows[feet_at:], R, motion, foot_noise, interval.foothold_creep, math.sqrt(dt_s))
    return R, mean, rows, new_cross


@inlined
def _images(
    rotation: Array,
    vector: Array,
    factor: Array,
    motion: FootMotion,
    step: Step,
    constants: ProcessConstants,
    width_squared: float,
) -> tuple[Array, Array]:
    """Rotations (15, 3, 3) and vectors (15, L) of centre and curved points after the step: +, then -."""
    length, width = len(vector), math.sqrt(width_squared)
    count = 1 + 2 * CURVED
    turned, images = np.empty((count, 3, 3)), np.empty((count, length))
    R, point, error = np.empty((3, 3)), np.empty(length), np.zeros(length)
    for index in range(count):
        if index > 0:
            column = (index - 1) % CURVED
            sign = width if index <= CURVED else -width
            for i in range(length):
                error[i] = sign * factor[i, column]
        set_spread(R, point, rotation, vector, error, constants.world_stop)
        _set_moved(turned[index], images[index], R, point, motion, step, constants)
    return turned, images


@inlined
def _mean(turned: Array, images: Array, width_squared: float, constants: ProcessConstants) -> tuple[Array, Array]:
    """Weighted mean of the points, rotation (3, 3) and vector (L,): ``State.mean_and_deviations``."""
    length = images.shape[1]
    centre, shift, error = np.zeros(length), np.zeros(length), np.empty(length)
    for i in range(3, length):
        centre[i] = images[0, i]
    for index in range(1, len(images)):
        set_errors(error, turned[index], images[index], turned[0], centre, constants.world_stop)
        for i in range(constants.active):  # what is remembered does not move
            shift[i] += error[i] / (2.0 * width_squared)
    R, mean = np.empty((3, 3)), np.empty(length)
    set_spread(R, mean, turned[0], centre, shift, constants.world_stop)
    for i in range(3):
        mean[i] = 0.0
    return R, mean


@inlined
def _turn(R: Array, rotation: Array) -> Array:
    turn = np.empty((3, 3))
    set_product_transposed(turn, R, rotation)
    return turn


@inlined
def _set_spread_rows(
    rows: Array, turned: Array, images: Array, R: Array, mean: Array, world_stop: int, width_squared: float
) -> None:
    """Rows of curved points and centre: odd halves first, even halves and centre behind the flat rows."""
    length, scale = len(mean), 1.0 / math.sqrt(width_squared)
    plus, minus = np.empty(length), np.empty(length)
    for column in range(CURVED):
        set_errors(plus, turned[1 + column], images[1 + column], R, mean, world_stop)
        at = 1 + CURVED + column
        set_errors(minus, turned[at], images[at], R, mean, world_stop)
        for i in range(length):
            rows[column, i] = scale * 0.5 * (plus[i] - minus[i])
            rows[length + column, i] = scale * 0.5 * (plus[i] + minus[i])
    set_errors(plus, turned[0], images[0], R, mean, world_stop)
    for i in range(length):
        rows[length + CURVED, i] = math.sqrt(1.0 - CURVED / width_squared) * plus[i]


@compiled
def _set_flat_error(
    moved: Array, error: Array, rotation: Array, motion: FootMotion, step: Step, turn: Array, world_stop: int
) -> None:
    """An error along flat columns (L,) moved by the linear part, seen from the new mean."""
    _set_flat(moved, error, rotation, motion, step)
    for at in range(_VELOCITY, world_stop, 3):
        moved[at], moved[at + 1], moved[at + 2] = rotated_back(turn, moved[at], moved[at + 1], moved[at + 2])


@inlined
def _set_flat_rows(
    rows: Array, factor: Array, rotation: Array, motion: FootMotion, step: Step, turn: Array, world_stop: int
) -> None:
    """Rows of the flat columns: each column moved by the linear part, seen from the new mean."""
    length = len(factor)
    column, moved = np.zeros(length), np.empty(length)
    for j in range(CURVED, length):
        column[j - 1] = 0.0
        for i in range(j, length):
            column[i] = factor[i, j]
        _set_flat_error(moved, column, rotation, motion, step, turn, world_stop)
        for i in range(j - 2, length):  # the turn mixes three at a time
            rows[j, i] = moved[i]


@compiled
def _moved_cross(
    cross: Array,
    rows: Array,
    factor: Array,
    rotation: Array,
    motion: FootMotion,
    step: Step,
    turn: Array,
    world_stop: int,
) -> Array:
    """Covariance of the moved errors with the passive ones, (L, p): ``PassiveStates.predict``.

    A column is an error that is moved: its part along the curved columns of the factor by their odd halves, the rest
    by the linear part of the process.
    """
    length, moved_cross = len(factor), np.empty(cross.shape)
    rest, moved, shares = np.empty(length), np.empty(length), np.empty(CURVED)
    for passive in range(cross.shape[1]):
        set_rest_and_shares(rest, shares, cross[:, passive], factor)
        _set_flat_error(moved, rest, rotation, motion, step, turn, world_stop)
        for i in range(length):
            for k in range(CURVED):
                moved[i] += shares[k] * rows[k, i]
            moved_cross[i, passive] = moved[i]
    return moved_cross


@inlined
def _set_body_noise(rows: Array, R: Array, interval: Interval, constants: ProcessConstants) -> None:
    """Noise of the body's accelerations and of random walks: ``process_model.noise_rows`` before the feet."""
    dt_s, acceleration = interval.dt_s, interval.acceleration
    root = math.sqrt(dt_s)
    for i in range(3):
        rows[i, _RATE + i] = constants.angular_acceleration * root
        rows[3 + i, _POSITION + i] = acceleration * root * 0.5 * dt_s
        rows[3 + i, _VELOCITY + i] = acceleration * root
        for j in range(3):
            rows[i, j] = constants.angular_acceleration * root * (0.5 * dt_s + interval.imu_delay_s) * R[j, i]
    for k in range(len(constants.walking)):
        at = constants.walking[k]
        rows[_ACCELERATIONS + k, at] = constants.walks[at] * root


@inlined
def _set_world_noise(rows: Array, R: Array, mean: Array, motion: FootMotion, constants: ProcessConstants) -> None:
    """Noise of rotation (rows 0 to 2) and motion (3 to 5) on velocity, position and feet."""
    for leg in range(len(motion.holds)):
        at, p = BODY + 3 * leg, motion.position_body[leg]
        normal, radius = motion.normals[leg], constants.radii_m[leg]
        lx, ly, lz = radius * normal[0], radius * normal[1], radius * normal[2]
        if not motion.holds[leg]:
            lx, ly, lz = rotated(R, p[0], p[1], p[2])
            for i in range(3):
                rows[3 + i, at + i] = rows[3 + i, _POSITION + i]
        for i in range(3):
            x, y, z = cross(rows[i, 0], rows[i, 1], rows[i, 2], lx, ly, lz)
            rows[i, at], rows[i, at + 1], rows[i, at + 2] = x, y, z
    for at in range(_VELOCITY, constants.world_stop, 3):
        for i in range(3):
            x, y, z = cross(rows[i, 0], rows[i, 1], rows[i, 2], mean[at], mean[at + 1], mean[at + 2])
            _add(rows[i], at, -x, -y, -z)


@inlined
def _set_foot_noise(rows: Array, R: Array, motion: FootMotion, foot_noise: Array, creep: Array, root_dt: float) -> None:
    """Noise of each foot by itself: creep (n,) of one that holds, otherwise of its kinematics."""
    for leg in range(len(motion.holds)):
        at = BODY + 3 * leg
        for i in range(3):
            if motion.holds[leg]:
                rows[3 * leg + i, at + i] = creep[leg] * root_dt
            elif motion.is_known[leg]:
                x, y, z = rotated(R, foot_noise[leg, 0, i], foot_noise[leg, 1, i], foot_noise[leg, 2, i])
                rows[3 * leg + i, at], rows[3 * leg + i, at + 1], rows[3 * leg + i, at + 2] = x, y, z
            else:
                for j in range(3):
                    rows[3 * leg + i, at + j] = UNKNOWN_LEG_NOISE_M * R[j, i]

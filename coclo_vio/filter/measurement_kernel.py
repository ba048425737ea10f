# SPDX-License-Identifier: BSD-3-Clause
"""Compiled measurements: the blocks of ``measurement_model`` as one table of triples, what is expected, and the gate.

A triple is three rows of measurement with one noise factor: of the gyroscope, of a standstill, or of one leg.
"""

import math

import numpy as np

from coclo_vio.filter.measurement_model import NO_LEG
from coclo_vio.filter.measurement_table import (
    FOOT_POSITION,
    GRAVITY,
    GYROSCOPE,
    LEG_VELOCITY,
    REST_RATE,
    REST_VELOCITY,
    Measured,
    Sensed,
    SensingConstants,
    Triples,
)
from coclo_vio.filter.process_kernel import slip_velocity, speed_of
from coclo_vio.filter.stance import FootMotion
from coclo_vio.filter.state import (
    ACCELEROMETER_BIAS,
    GYROSCOPE_BIAS,
    GYROSCOPE_SCALE,
    LEG_COMPLIANCE,
    LEG_SCALE,
    POSITION,
    RATE,
    VELOCITY,
)
from coclo_vio.filter.state import (
    BODY_ERRORS as BODY,
)
from coclo_vio.filter.state import (
    CURVED_IN_MEASUREMENT as CURVED,
)
from coclo_vio.filter.state_kernels import set_rest_and_shares, set_spread
from coclo_vio.filter.triangle_kernels import cholesky_in_place, set_noise_factor, squared_norm
from coclo_vio.geometry.array_types import Array, BoolArray, IntArray
from coclo_vio.geometry.compiled import compiled, inlined
from coclo_vio.geometry.so3_kernels import cross, rotated_back
from coclo_vio.values.units import GRAVITY_MPS2

_LEG_SCALE, _RATE = LEG_SCALE.start, RATE.start
_GYROSCOPE_BIAS, _GYROSCOPE_SCALE = GYROSCOPE_BIAS.start, GYROSCOPE_SCALE.start
_ACCELEROMETER_BIAS = ACCELEROMETER_BIAS.start
_LEG_COMPLIANCE, _VELOCITY, _POSITION = LEG_COMPLIANCE.start, VELOCITY.start, POSITION.start


@compiled
def measured_of(
    sensed: Sensed,
    motion: FootMotion,
    foot_noise: Array,
    mean: tuple[Array, Array],
    covariance: tuple[Array, Array],
    width_squared: float,
    sensing: SensingConstants,
) -> Measured:
    """The measurements of one joint sample: ``DirectModels.expect``.

    Args:
        sensed: the measured values.
        motion: of the feet.
        foot_noise: lower factors of each foot position's covariance, body frame, m, (n, 3, 3).
        mean: its rotation, (3, 3), and vector, (L,).
        covariance: its lower factor, (L, L), and the covariance with the passive errors, (L, p).
        width_squared: of the sigma points, see ``SigmaSpread``.
        sensing: of robot and noise.
    """
    rotation, vector = mean
    factor, cross = covariance
    table = _triples_of(sensed, motion, foot_noise, rotation, vector[_LEG_COMPLIANCE], sensing)
    predicted, rows, observed = expected(rotation, vector, factor, cross, table, sensing.world_stop, width_squared)
    for i in range(len(predicted)):
        predicted[i] = table.measured[i // 3, i % 3] - predicted[i]
    rejected = _rejected_legs(rows, predicted, table, sensing.gate, len(sensed.is_used))
    return Measured(table, rows, observed, predicted, rejected)


@inlined
def _triples_of(
    sensed: Sensed,
    motion: FootMotion,
    foot_noise: Array,
    rotation: Array,
    compliance_m: float,
    sensing: SensingConstants,
) -> Triples:
    """The measurements of one joint sample: ``measurement_model.blocks``."""
    has_rate = sensed.gyroscope_noise_radps > 0.0
    count = int(has_rate) + 2 * int(sensed.is_stationary)
    for leg in range(len(sensed.is_used)):
        count += int(sensed.is_used[leg]) * (1 + int(motion.holds[leg]))
    table = Triples(
        np.empty(count, dtype=np.int64),
        np.empty(count, dtype=np.int64),
        np.zeros((count, 3)),
        np.zeros((count, 3, 3)),
        np.zeros((count, 3)),
        np.zeros((count, 3)),
        np.zeros((count, 3)),
        motion.takeover_speed,
    )
    at = 0
    if has_rate:
        for i in range(3):
            table.measured[at, i] = table.lever[at, i] = sensed.angular_velocity[i]
        at = _set_imu(table, at, GYROSCOPE, sensed.gyroscope_noise_radps)
    if sensed.is_stationary:
        at = _set_imu(table, at, REST_VELOCITY, sensing.standstill_velocity_noise_mps)
        at = _set_imu(table, at, REST_RATE, sensing.standstill_rate_noise_radps)
    at = _set_velocities(table, at, sensed, motion, rotation, compliance_m, sensing)
    _set_positions(table, at, sensed, motion, rotation[2], foot_noise, sensing.hips_body)
    return table


@inlined
def _set_imu(table: Triples, at: int, kind: int, sigma: float) -> int:
    table.kind[at], table.leg[at] = kind, NO_LEG
    for i in range(3):
        table.noise[at, i, i] = sigma
    return at + 1


@inlined
def _set_velocities(
    table: Triples,
    at: int,
    sensed: Sensed,
    motion: FootMotion,
    rotation: Array,
    compliance_m: float,
    sensing: SensingConstants,
) -> int:
    """Velocity of the body over the contact point of each used leg: ``measurement_model`` with ``_velocity_of``."""
    up, arm = rotation[2], np.empty(3)
    for leg in range(len(sensed.is_used)):
        if not sensed.is_used[leg]:
            continue
        normal, radius = motion.normals[leg], sensing.radii_m[leg]
        arm[0], arm[1], arm[2] = rotated_back(rotation, radius * normal[0], radius * normal[1], radius * normal[2])
        sigmas = sensing.joint_velocity_noise_radps, sensed.foot_velocity_noise_mps[leg]
        set_noise_factor(table.noise[at], sensed.jacobian[leg], arm, sigmas[0], sigmas[1])
        turn = sensed.angular_velocity_body[leg]
        rolling = cross(turn[0], turn[1], turn[2], arm[0], arm[1], arm[2])
        table.kind[at], table.leg[at] = LEG_VELOCITY, leg
        for i in range(3):
            table.measured[at, i] = rolling[i] - sensed.velocity_body[leg, i]
            table.lever[at, i] = sensed.position_body[leg, i] - arm[i]
            table.added[at, i] = compliance_m * motion.load_ratio_rate[leg] * up[i]
        table.scaled[at, 0], table.scaled[at, 1] = rolling[0], rolling[1]
        at += 1
    return at


@inlined
def _set_positions(
    table: Triples, at: int, sensed: Sensed, motion: FootMotion, up: Array, foot_noise: Array, hips_body: Array
) -> None:
    """Position of each used foot that holds: ``measurement_model`` with ``_position_of``."""
    for leg in range(len(sensed.is_used)):
        if not (sensed.is_used[leg] and motion.holds[leg]):
            continue
        table.kind[at], table.leg[at] = FOOT_POSITION, leg
        for i in range(3):
            for j in range(3):
                table.noise[at, i, j] = foot_noise[leg, i, j]
            table.measured[at, i] = sensed.position_body[leg, i]
            table.lever[at, i] = motion.load_ratio[leg] * up[i]
        table.scaled[at, 0] = hips_body[leg, 0] - sensed.position_body[leg, 0]
        table.scaled[at, 1] = hips_body[leg, 1] - sensed.position_body[leg, 1]
        at += 1


@compiled
def _set_linear(predicted: Array, vector: Array, R: Array, scale: float, table: Triples, speed: float) -> None:
    """The part of all triples (3 k,) that is linear in a vector (L,) given rotation and leg scale."""
    wx, wy, wz = vector[_RATE], vector[_RATE + 1], vector[_RATE + 2]
    vx, vy, vz = vector[_VELOCITY], vector[_VELOCITY + 1], vector[_VELOCITY + 2]
    bx, by, bz = rotated_back(R, vx, vy, vz)
    for row in range(len(table.kind)):
        kind, lever = table.kind[row], table.lever[row]
        if kind == GYROSCOPE:
            bias, ratio = _GYROSCOPE_BIAS, _GYROSCOPE_SCALE
            x = wx + vector[bias] + lever[0] * vector[ratio]
            y = wy + vector[bias + 1] + lever[1] * vector[ratio + 1]
            z = wz + vector[bias + 2] + lever[2] * vector[ratio + 2]
        elif kind == REST_VELOCITY:
            x, y, z = vx, vy, vz
        elif kind == REST_RATE:
            x, y, z = wx, wy, wz
        elif kind == GRAVITY:
            at = _ACCELEROMETER_BIAS
            x, y, z = vector[at], vector[at + 1], vector[at + 2]
        elif kind == LEG_VELOCITY:
            x, y, z = cross(wx, wy, wz, lever[0], lever[1], lever[2])
            sx, sy, sz = slip_velocity(vector, lever, speed, table.takeover_speed)
            x, y, z = (1.0 - scale) * (x + bx - sx), (1.0 - scale) * (y + by - sy), z + bz - sz
        else:
            foot, compliance = BODY + 3 * table.leg[row], vector[_LEG_COMPLIANCE]
            rx, ry = vector[foot] - vector[_POSITION], vector[foot + 1] - vector[_POSITION + 1]
            x, y, z = rotated_back(R, rx, ry, vector[foot + 2] - vector[_POSITION + 2])
            x, y, z = x - compliance * lever[0], y - compliance * lever[1], z - compliance * lever[2]
        predicted[3 * row], predicted[3 * row + 1], predicted[3 * row + 2] = x, y, z


@compiled
def expected(
    rotation: Array, vector: Array, factor: Array, cross: Array, table: Triples, world_stop: int, width_squared: float
) -> tuple[Array, Array, Array]:
    """Predicted measurement: mean (M,), square-root rows (L + curved + 1, M), covariance with passive errors (M, p).

    ``SquareRootFilter.observe`` and ``PassiveStates.observed``.

    Args:
        rotation: of the mean, (3, 3).
        vector: of the mean, (L,).
        factor: lower factor, (L, L).
        cross: covariance with the passive errors, (L, p).
        table: the M / 3 triples.
        world_stop: end of the vectors of the world, see ``StateLayout.world``.
        width_squared: of the sigma points, see ``SigmaSpread``.
    """
    length, size = len(vector), 3 * len(table.kind)
    speed = speed_of(vector)
    images = _images(rotation, vector, factor, table, world_stop, speed, width_squared)
    mean, rows = np.empty(size), np.empty((length + CURVED + 1, size))
    scale, centre_scale = 0.5 / math.sqrt(width_squared), math.sqrt(1.0 - CURVED / width_squared)
    for i in range(size):
        shift = 0.0
        for index in range(1, len(images)):
            shift += images[index, i] - images[0, i]
        mean[i] = images[0, i] + shift / (2.0 * width_squared)
        for column in range(CURVED):
            plus, minus = images[1 + column, i], images[1 + CURVED + column, i]
            rows[column, i] = scale * (plus - minus)
            rows[length + column, i] = scale * ((plus - mean[i]) + (minus - mean[i]))
        rows[length + CURVED, i] = centre_scale * (images[0, i] - mean[i])
    column_of = np.zeros(length)
    for j in range(CURVED, length):
        column_of[j - 1] = 0.0
        for i in range(j, length):
            column_of[i] = factor[i, j]
        _set_linear(rows[j], column_of, rotation, vector[_LEG_SCALE], table, speed)
    observed, image, shares = np.empty((size, cross.shape[1])), np.empty(size), np.empty(CURVED)
    for passive in range(cross.shape[1]):
        set_rest_and_shares(column_of, shares, cross[:, passive], factor)
        _set_linear(image, column_of, rotation, vector[_LEG_SCALE], table, speed)
        for i in range(size):
            for k in range(CURVED):
                image[i] += shares[k] * rows[k, i]
            observed[i, passive] = image[i]
    return mean, rows, observed


@inlined
def _images(
    rotation: Array, vector: Array, factor: Array, table: Triples, world_stop: int, speed: float, width_squared: float
) -> Array:
    """Measurements (9, M) predicted at centre and curved points: +, then -."""
    length, width = len(vector), math.sqrt(width_squared)
    images = np.empty((1 + 2 * CURVED, 3 * len(table.kind)))
    R, point, error = np.empty((3, 3)), np.empty(length), np.zeros(length)
    for index in range(len(images)):
        if index > 0:
            column = (index - 1) % CURVED
            sign = width if index <= CURVED else -width
            for i in range(length):
                error[i] = sign * factor[i, column]
        set_spread(R, point, rotation, vector, error, world_stop)
        scale = point[_LEG_SCALE]
        _set_linear(images[index], point, R, scale, table, speed)
        for row in range(len(table.kind)):
            for i in range(3):
                images[index, 3 * row + i] += table.added[row, i] + scale * table.scaled[row, i]
                if table.kind[row] == GRAVITY:
                    images[index, 3 * row + i] += GRAVITY_MPS2 * R[2, i]
    return images


@inlined
def _rejected_legs(rows: Array, innovation: Array, table: Triples, limits: tuple[float, float], legs: int) -> BoolArray:
    """Legs (n,) whose innovation is larger than its covariance allows, by chi-square limits of 3 and of 6 rows."""
    rejected = np.zeros(legs, dtype=np.bool_)
    own = np.empty(len(limits), dtype=np.int64)
    for leg in range(legs):
        count = 0
        for row in range(len(table.leg)):
            if table.leg[row] == leg:
                own[count] = row
                count += 1
        if count > 0:
            rejected[leg] = _normalised_squared(rows, innovation, table, own, count) > limits[count - 1]
    return rejected


@inlined
def _normalised_squared(rows: Array, innovation: Array, table: Triples, own: IntArray, count: int) -> float:
    """Normalised innovation squared of the first ``count`` of some triples."""
    size = 3 * count
    covariance, difference = np.zeros((size, size)), np.empty(size)
    for i in range(size):
        at, part = 3 * own[i // 3] + i % 3, table.noise[own[i // 3]]
        difference[i] = innovation[at]
        for j in range(i + 1):
            other = 3 * own[j // 3] + j % 3
            for row in range(len(rows)):
                covariance[i, j] += rows[row, at] * rows[row, other]
            if i // 3 == j // 3:
                for k in range(j % 3 + 1):
                    covariance[i, j] += part[i % 3, k] * part[j % 3, k]
    cholesky_in_place(covariance)
    return squared_norm(covariance, difference)

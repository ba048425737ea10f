# SPDX-License-Identifier: BSD-3-Clause
"""Compiled forms of ``State``: one sigma point at a time, and the correction of a mean.

A point is its rotation ``R_world_body``, (3, 3), and its vector, (L,), in the order of ``StateLayout``.
"""

import math

import numpy as np

from coclo_vio.filter.state import POSITION, VELOCITY
from coclo_vio.filter.triangle_kernels import lower_of
from coclo_vio.geometry.array_types import Array
from coclo_vio.geometry.compiled import compiled, inlined
from coclo_vio.geometry.so3_kernels import (
    cross,
    rotated,
    rotated_back,
    set_exp,
    set_log,
    set_product,
    set_product_transposed,
)

_VELOCITY, _POSITION = VELOCITY.start, POSITION.start
_REMEMBERED = 6  # errors of a remembered pose, rotation first


@compiled
def set_spread(R: Array, point: Array, rotation: Array, vector: Array, error: Array, world_stop: int) -> None:
    """The point that differs from a mean by an error vector (L,): ``State.spread``; remembered poses do not turn."""
    turn = np.empty((3, 3))
    set_exp(turn, error[0], error[1], error[2])
    set_product(R, turn, rotation)
    for i in range(len(vector)):
        point[i] = vector[i] + error[i]
    for at in range(_VELOCITY, world_stop, 3):
        point[at], point[at + 1], point[at + 2] = rotated(turn, point[at], point[at + 1], point[at + 2])


@compiled
def set_errors(error: Array, R: Array, point: Array, rotation: Array, vector: Array, world_stop: int) -> None:
    """The error vector (L,) of a point about a mean: ``State.errors_of``."""
    turn = np.empty((3, 3))
    set_product_transposed(turn, R, rotation)
    for i in range(len(vector)):
        error[i] = point[i] - vector[i]
    for at in range(_VELOCITY, world_stop, 3):
        x, y, z = rotated_back(turn, point[at], point[at + 1], point[at + 2])
        error[at], error[at + 1], error[at + 2] = x - vector[at], y - vector[at + 1], z - vector[at + 2]
    set_log(error, turn)


@inlined
def _clear_rotation(vector: Array, at: int) -> None:
    for i in range(3):
        vector[at + i] = 0.0


@compiled
def set_rest_and_shares(rest: Array, shares: Array, error: Array, factor: Array) -> None:
    """An error (L,) as shares of the first columns of a lower factor (L, L) and a rest that those do not reach.

    Args:
        rest: is written, (L,); zero where the columns reach.
        shares: is written; its length is the number of columns.
        error: is taken apart.
        factor: the lower factor; an error without uncertainty has no share.
    """
    curved = len(shares)
    for i in range(len(error)):
        rest[i] = error[i]
    for k in range(curved):
        shares[k] = 0.0 if factor[k, k] == 0.0 else rest[k] / factor[k, k]
        rest[k] = 0.0
        for i in range(k + 1, len(error)):
            rest[i] -= shares[k] * factor[i, k]


@compiled
def corrected(
    rotation: Array, vector: Array, remembered: Array, step: Array, world_stop: int, active: int
) -> tuple[Array, Array, Array]:
    """A mean moved by one error vector (L,): ``State.corrected``.

    Args:
        rotation: of the body, (3, 3).
        vector: everything else, (L,).
        remembered: rotations of the remembered poses, (k, 3, 3).
        step: the error vector, (L,).
        world_stop: end of the vectors of the world, see ``StateLayout.world``.
        active: number of errors before those of the remembered poses.

    Returns:
        The three first, moved.
    """
    moved, moved_vector, moved_remembered = np.empty((3, 3)), np.empty(len(vector)), np.empty(remembered.shape)
    turn = np.empty((3, 3))
    set_spread(moved, moved_vector, rotation, vector, step, world_stop)
    _clear_rotation(moved_vector, 0)
    for k in range(len(remembered)):
        at = active + _REMEMBERED * k
        set_exp(turn, step[at], step[at + 1], step[at + 2])
        set_product(moved_remembered[k], turn, remembered[k])
        x, y, z = moved_vector[at + 3], moved_vector[at + 4], moved_vector[at + 5]
        moved_vector[at + 3], moved_vector[at + 4], moved_vector[at + 5] = rotated(turn, x, y, z)
        _clear_rotation(moved_vector, at)
    return moved, moved_vector, moved_remembered


@compiled
def bounded_factor(triangle: Array, limit: float) -> tuple[Array, Array]:
    """Lower factor (L, L) of a triangle, and the scales (3,) that keep its rotation sigmas below a limit.

    The scales are applied; ``SquareRootFilter`` does the same.
    """
    factor, scales = lower_of(triangle, 0, triangle.shape[1]), np.empty(3)
    for row in range(3):
        scales[row] = 1.0
        squared = 0.0
        for column in range(row + 1):
            squared += factor[row, column] * factor[row, column]
        if squared > limit * limit:
            scales[row] = limit / math.sqrt(squared)
            for column in range(row + 1):
                factor[row, column] *= scales[row]
    return factor, scales


@compiled
def plain_covariance(rotation: Array, vector: Array, factor: Array) -> Array:
    """Covariance (9, 9) of the errors of ``StateEstimate``: of ``State.plain_jacobian`` times the factor."""
    length = len(factor)
    rows = np.empty((9, length))
    for j in range(length):
        ex, ey, ez = factor[0, j], factor[1, j], factor[2, j]
        rows[0, j], rows[1, j], rows[2, j] = rotated_back(rotation, ex, ey, ez)
        at = _POSITION
        x, y, z = cross(ex, ey, ez, vector[at], vector[at + 1], vector[at + 2])
        x, y, z = x + factor[at, j], y + factor[at + 1, j], z + factor[at + 2, j]
        rows[3, j], rows[4, j], rows[5, j] = rotated_back(rotation, x, y, z)
        at = _VELOCITY
        x, y, z = cross(ex, ey, ez, vector[at], vector[at + 1], vector[at + 2])
        rows[6, j], rows[7, j], rows[8, j] = x + factor[at, j], y + factor[at + 1, j], z + factor[at + 2, j]
    covariance = np.empty((9, 9))
    for i in range(9):
        for k in range(i + 1):
            total = 0.0
            for j in range(length):
                total += rows[i, j] * rows[k, j]
            covariance[i, k] = covariance[k, i] = total
    return covariance

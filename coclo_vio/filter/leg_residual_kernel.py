# SPDX-License-Identifier: BSD-3-Clause
"""Each leg's motion of the body over an interval against what the other legs and the gyroscope predict (compiled)."""

import math

import numpy as np

from coclo_vio.filter.triangle_kernels import cholesky_in_place
from coclo_vio.geometry.array_types import Array, BoolArray, IntArray
from coclo_vio.geometry.compiled import compiled, inlined
from coclo_vio.geometry.so3_kernels import cross, rotated, set_log, set_product, set_product_transposed

MOST_STEPS = 2.0  # a residual is shortened to so many times the motion, that of a leg which moves backwards,
MOST_SIGMAS = 5.0  # ... and so many sigmas: a single jump of a joint is no lasting error


@compiled
def translations(
    feet: tuple[Array, Array], rotations: tuple[Array, Array], turn: Array, up: Array, radii_m: Array
) -> tuple[Array, Array]:
    """Translation of the body by each leg whose foot rolls on one spot, and where the foot is at the end, (n, 3) each.

    ``y = f_0 + rho phi x n - R f_1``, body axes at the begin; the second is ``R f_1``.

    Args:
        feet: foot centres at begin and end, m, body frame, (n, 3).
        rotations: ``R_body_foot`` at begin and end, (n, 3, 3).
        turn: ``R``, rotation of the body from begin to end, (3, 3).
        up: upward direction at the begin, body frame, (3,).
        radii_m: of the feet, (n,).
    """
    legs = len(radii_m)
    moved, carried = np.empty((legs, 3)), np.empty((legs, 3))
    now, relative, roll = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for leg in range(legs):
        set_product(now, turn, rotations[1][leg])
        set_product_transposed(relative, now, rotations[0][leg])
        set_log(roll, relative)
        x, y, z = cross(roll[0], roll[1], roll[2], up[0], up[1], up[2])
        cx, cy, cz = rotated(turn, feet[1][leg, 0], feet[1][leg, 1], feet[1][leg, 2])
        carried[leg, 0], carried[leg, 1], carried[leg, 2] = cx, cy, cz
        moved[leg, 0] = feet[0][leg, 0] + radii_m[leg] * x - cx
        moved[leg, 1] = feet[0][leg, 1] + radii_m[leg] * y - cy
        moved[leg, 2] = feet[0][leg, 2] + radii_m[leg] * z - cz
    return moved, carried


@compiled
def left_out(
    moved: Array, levers: Array, used: BoolArray, tested: BoolArray, sigma: float, turn_sigma_rad: float, least: int
) -> tuple[Array, Array]:
    """What the other legs predict of each leg's reading, (n, 3), and the mean variance of an axis of it, (n,).

    A reading is ``t + theta x lever``: ``t`` common to all legs, ``theta`` the error of the gyroscope, with a prior.
    NaN where a leg is not tested or fewer than ``least`` others are used.

    Args:
        moved: readings, m or m/s, (n, 3).
        levers: m, (n, 3).
        used: legs that predict, (n,).
        tested: legs that are predicted, (n,).
        sigma: of each axis of a reading.
        turn_sigma_rad: of each axis of ``theta``, rad or rad/s.
        least: number of other legs.
    """
    legs = len(moved)
    predicted, variance = np.full((legs, 3), math.nan), np.full(legs, math.nan)
    information, vector, rows = np.empty((6, 6)), np.empty(6), np.empty((3, 6))
    for leg in range(legs):
        count = 0
        for i in range(6):
            vector[i] = 0.0
            for j in range(6):
                information[i, j] = 0.0
        for i in range(3):
            information[3 + i, 3 + i] = 1.0 / (turn_sigma_rad * turn_sigma_rad)
        for other in range(legs):
            if other != leg and used[other]:
                count += 1
                _set_rows(rows, levers[other])
                _add(information, vector, rows, moved[other], 1.0 / (sigma * sigma))
        if not tested[leg] or count < least:
            continue
        _set_rows(rows, levers[leg])
        cholesky_in_place(information)
        variance[leg] = _predict(predicted[leg], information, vector, rows)
    return predicted, variance


@compiled
def compared(
    moved: Array, levers: Array, stood: BoolArray, trusted: BoolArray, sigma: float, turn_sigma_rad: float
) -> tuple[Array, Array, Array, Array]:
    """Residuals (n, 3), predictions (n, 3), variances (n,) and lengths of the predictions (n,); 0 where not predicted.

    A residual is shortened to ``MOST_SIGMAS`` and ``MOST_STEPS`` times the motion. The leg that is farthest beyond that
    predicts no other.

    Args:
        moved: readings, m, (n, 3).
        levers: m, (n, 3).
        stood: legs that are compared, (n,).
        trusted: legs that may predict others, (n,).
        sigma: of each axis of a reading, m.
        turn_sigma_rad: of the gyroscope, rad.
    """
    legs = len(moved)
    used, excess, steps_m = np.empty(legs, dtype=np.bool_), np.zeros(legs), np.zeros(legs)
    for leg in range(legs):
        used[leg] = stood[leg] and trusted[leg]
    predicted, variance = left_out(moved, levers, used, stood, sigma, turn_sigma_rad, 1)
    worst = _set_excess(excess, steps_m, moved, predicted, sigma)
    if excess[worst] > 1.0:
        used[worst] = False
        predicted, variance = left_out(moved, levers, used, stood, sigma, turn_sigma_rad, 1)
        _set_excess(excess, steps_m, moved, predicted, sigma)
    residual = np.zeros((legs, 3))
    for leg in range(legs):
        is_predicted = not math.isnan(variance[leg])
        variance[leg] = variance[leg] + sigma * sigma if is_predicted else 0.0
        for i in range(3):
            if is_predicted:
                residual[leg, i] = (moved[leg, i] - predicted[leg, i]) / max(excess[leg], 1.0)
            else:
                predicted[leg, i] = 0.0
    return residual, predicted, variance, steps_m


@compiled
def _set_excess(excess: Array, steps_m: Array, moved: Array, predicted: Array, sigma: float) -> int:
    """Length of each residual over the largest that a lasting error makes; the leg where that is largest."""
    worst = 0
    for leg in range(len(moved)):
        squared, step = 0.0, 0.0
        for i in range(3):
            difference = moved[leg, i] - predicted[leg, i]
            squared += difference * difference
            step += predicted[leg, i] * predicted[leg, i]
        excess[leg] = steps_m[leg] = 0.0
        if not math.isnan(squared):
            steps_m[leg] = math.sqrt(step)
            excess[leg] = math.sqrt(squared) / (MOST_SIGMAS * sigma + MOST_STEPS * steps_m[leg])
        if excess[leg] > excess[worst]:
            worst = leg
    return worst


@compiled
def regress(
    sums: tuple[Array, Array],
    jacobians: tuple[Array, Array],
    turn: Array,
    columns: IntArray,
    residual: Array,
    variance: Array,
    kept: float,
) -> None:
    """Add the residuals of an interval to the regressions of each leg on each of its joints.

    Args:
        sums: information and vector, (n, joints of a leg), are changed.
        jacobians: of the feet at begin and end, (n, 6, J).
        turn: rotation of the body, (3, 3).
        columns: of the joints of each leg, (n, joints of a leg); -1 where there is none.
        residual: m, (n, 3).
        variance: of each axis, m^2, (n,); 0 where a leg does not count.
        kept: what is kept of the sums of a leg that counts.
    """
    for leg in range(len(columns)):
        if variance[leg] <= 0.0:
            continue
        for joint in range(columns.shape[1]):
            column = columns[leg, joint]
            if column < 0:
                continue
            after = jacobians[1][leg, 3, column], jacobians[1][leg, 4, column], jacobians[1][leg, 5, column]
            x, y, z = rotated(turn, after[0], after[1], after[2])
            x, y, z = (
                jacobians[0][leg, 3, column] - x,
                jacobians[0][leg, 4, column] - y,
                jacobians[0][leg, 5, column] - z,
            )
            along = x * residual[leg, 0] + y * residual[leg, 1] + z * residual[leg, 2]
            sums[0][leg, joint] = kept * sums[0][leg, joint] + (x * x + y * y + z * z) / variance[leg]
            sums[1][leg, joint] = kept * sums[1][leg, joint] + along / variance[leg]


@inlined
def _set_rows(rows: Array, lever: Array) -> None:
    """Derivatives of a reading by ``t`` and ``theta``, (3, 6)."""
    for i in range(3):
        for j in range(6):
            rows[i, j] = 1.0 if i == j else 0.0
    rows[0, 4], rows[0, 5] = lever[2], -lever[1]
    rows[1, 3], rows[1, 5] = -lever[2], lever[0]
    rows[2, 3], rows[2, 4] = lever[1], -lever[0]


@inlined
def _add(information: Array, vector: Array, rows: Array, reading: Array, weight: float) -> None:
    for k in range(3):
        for i in range(6):
            vector[i] += weight * rows[k, i] * reading[k]
            for j in range(6):
                information[i, j] += weight * rows[k, i] * rows[k, j]


@inlined
def _predict(predicted: Array, factor: Array, vector: Array, rows: Array) -> float:
    """The predicted reading by a lower factor of the information; returns the mean variance of an axis."""
    half, total = np.empty(6), 0.0
    for i in range(6):
        half[i] = vector[i]
        for k in range(i):
            half[i] -= factor[i, k] * half[k]
        half[i] /= factor[i, i]
    solved = np.empty(6)
    for axis in range(3):
        predicted[axis] = 0.0
        for i in range(6):
            solved[i] = rows[axis, i]
            for k in range(i):
                solved[i] -= factor[i, k] * solved[k]
            solved[i] /= factor[i, i]
            predicted[axis] += solved[i] * half[i]
            total += solved[i] * solved[i]
    return total / 3.0

# SPDX-License-Identifier: BSD-3-Clause
"""Small dense factorisations for kernels: Householder reflections of some rows, Cholesky factors, substitution.

The two large triangularisations of a step are LAPACK's: blocked, they are faster than a kernel that skips the zeros.
"""

import math

import numpy as np

from coclo_vio.geometry.array_types import Array
from coclo_vio.geometry.compiled import compiled
from coclo_vio.geometry.so3_kernels import cross


@compiled
def reflect(rows: Array, column: int, pivot: int, first: int, last: int) -> None:
    """A Householder reflection of the row ``pivot`` and the rows from ``first`` to ``last``, exclusive.

    It makes the column zero in those rows; columns before it are zero there already (Golub and Van Loan, section 5.1).
    """
    width = rows.shape[1]
    squared = 0.0
    for row in range(first, last):
        squared += rows[row, column] * rows[row, column]
    if squared == 0.0:
        return
    leading = rows[pivot, column]
    diagonal = -math.copysign(math.sqrt(leading * leading + squared), leading)
    rows[pivot, column] = diagonal
    share = (diagonal - leading) / diagonal
    along = np.empty(width)
    for at in range(column + 1, width):
        along[at] = rows[pivot, at]
    for row in range(first, last):
        rows[row, column] /= leading - diagonal
        for at in range(column + 1, width):
            along[at] += rows[row, column] * rows[row, at]
    for at in range(column + 1, width):
        along[at] *= share
        rows[pivot, at] -= along[at]
    for row in range(first, last):
        for at in range(column + 1, width):
            rows[row, at] -= rows[row, column] * along[at]
        rows[row, column] = 0.0


@compiled
def lower_of(triangle: Array, start: int, stop: int) -> Array:
    """Transposed upper triangle in rows and columns from ``start`` to ``stop``: a lower factor."""
    length = stop - start
    factor = np.zeros((length, length))
    for i in range(length):
        for j in range(i + 1):
            factor[i, j] = triangle[start + j, start + i]
    return factor


@compiled
def cholesky_in_place(matrix: Array) -> None:
    """Lower Cholesky factor of a positive definite matrix, of which only the lower half is read; zeros above."""
    for j in range(len(matrix)):
        for i in range(j, len(matrix)):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = math.sqrt(total) if i == j else total / matrix[j, j]
            matrix[j, i] = matrix[i, j] if i == j else 0.0


@compiled
def substitute(factor: Array, rows: Array) -> None:
    """Each row ``x`` becomes ``S^-1 x`` of a lower factor ``S``."""
    for row in range(len(rows)):
        for j in range(len(factor)):
            for k in range(j):
                rows[row, j] -= factor[j, k] * rows[row, k]
            rows[row, j] /= factor[j, j]


@compiled
def substitute_back(factor: Array, rows: Array) -> None:
    """Each row ``x`` becomes ``S^-T x`` of a lower factor ``S``."""
    for row in range(len(rows)):
        for j in range(len(factor) - 1, -1, -1):
            for k in range(j + 1, len(factor)):
                rows[row, j] -= factor[k, j] * rows[row, k]
            rows[row, j] /= factor[j, j]


@compiled
def squared_norm(factor: Array, vector: Array) -> float:
    """``v^T (S S^T)^-1 v`` of a lower factor ``S`` and a vector, by substitution; overwrites the vector."""
    squared = 0.0
    for i in range(len(vector)):
        for k in range(i):
            vector[i] -= factor[i, k] * vector[k]
        vector[i] /= factor[i, i]
        squared += vector[i] * vector[i]
    return squared


@compiled
def set_noise_factor(factor: Array, jacobian: Array, lever: Array, sigma: float, other_sigma: float) -> None:
    """Lower factor (3, 3) of ``J J^T sigma^2 + I other_sigma^2``, ``J`` the linear Jacobian at a point; NaN is 0.

    Args:
        factor: is written.
        jacobian: rows [angular 3, linear 3] of a foot centre, (6, J).
        lever: from the point to the foot centre, (3,).
        sigma: of each joint.
        other_sigma: of each direction.
    """
    for i in range(3):
        for j in range(i + 1):
            factor[i, j] = other_sigma * other_sigma if i == j else 0.0
    linear = np.empty(3)
    for k in range(jacobian.shape[1]):
        linear[0], linear[1], linear[2] = cross(
            lever[0], lever[1], lever[2], jacobian[0, k], jacobian[1, k], jacobian[2, k]
        )
        for i in range(3):
            linear[i] += jacobian[3 + i, k]
            for j in range(i + 1):
                added = linear[i] * linear[j] * sigma * sigma
                factor[i, j] += 0.0 if math.isnan(added) else added
    cholesky_in_place(factor)


@compiled
def foot_noises(jacobian: Array, encoder_noise_rad: float, bending_m: float) -> Array:
    """Lower factors (n, 3, 3) of the covariance of foot centres, of their Jacobians (n, 6, J): ``foot_noise``."""
    factors, lever = np.empty((len(jacobian), 3, 3)), np.zeros(3)
    for leg in range(len(jacobian)):
        set_noise_factor(factors[leg], jacobian[leg], lever, encoder_noise_rad, bending_m)
    return factors

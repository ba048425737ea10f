# SPDX-License-Identifier: BSD-3-Clause
"""Compiled forms of ``so3`` for one rotation at a time, which write into arrays of the caller.

Rotations are (3, 3), vectors (3,). Outputs come first, and never share memory with an input.
"""

import math

from coclo_vio.geometry.array_types import Array
from coclo_vio.geometry.compiled import compiled
from coclo_vio.geometry.so3 import TINY


@compiled
def set_exp(R: Array, x: float, y: float, z: float) -> None:
    """``R = exp([x, y, z])``, the rotation vector in radians: ``so3.exp``."""
    angle = math.sqrt(x * x + y * y + z * z + TINY)
    sinc = math.sin(angle) / angle
    root = math.sin(0.5 * angle) / angle
    half = 2.0 * root * root
    R[0, 0] = 1.0 - half * (y * y + z * z)
    R[1, 1] = 1.0 - half * (x * x + z * z)
    R[2, 2] = 1.0 - half * (x * x + y * y)
    R[0, 1], R[1, 0] = half * x * y - sinc * z, half * x * y + sinc * z
    R[0, 2], R[2, 0] = half * x * z + sinc * y, half * x * z - sinc * y
    R[1, 2], R[2, 1] = half * y * z - sinc * x, half * y * z + sinc * x


@compiled
def set_log(vector: Array, R: Array) -> None:
    """``vector[:3] = log(R)`` in radians, for angles below pi: ``so3.log_below_pi``."""
    x, y, z = 0.5 * (R[2, 1] - R[1, 2]), 0.5 * (R[0, 2] - R[2, 0]), 0.5 * (R[1, 0] - R[0, 1])
    sine = math.sqrt(x * x + y * y + z * z + TINY)
    factor = math.atan2(sine, 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)) / sine
    vector[0], vector[1], vector[2] = factor * x, factor * y, factor * z


@compiled
def set_product(C: Array, A: Array, B: Array) -> None:
    """``C = A B``."""
    for i in range(3):
        for j in range(3):
            C[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@compiled
def set_product_transposed(C: Array, A: Array, B: Array) -> None:
    """``C = A B^T``."""
    for i in range(3):
        for j in range(3):
            C[i, j] = A[i, 0] * B[j, 0] + A[i, 1] * B[j, 1] + A[i, 2] * B[j, 2]


@compiled
def rotated(R: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """``R [x, y, z]``."""
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@compiled
def rotated_back(R: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """``R^T [x, y, z]``."""
    return (
        R[0, 0] * x + R[1, 0] * y + R[2, 0] * z,
        R[0, 1] * x + R[1, 1] * y + R[2, 1] * z,
        R[0, 2] * x + R[1, 2] * y + R[2, 2] * z,
    )


@compiled
def cross(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> tuple[float, float, float]:
    """``a x b``."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx

# SPDX-License-Identifier: BSD-3-Clause
"""Compiled kinematics of legs that are chains of revolute and prismatic joints, and the forces on their feet.

The readable forms are ``PinocchioLegs.kinematics`` and ``model.damped_forces``. All vectors are in body axes.
"""

import math
from typing import NamedTuple

import numpy as np

from coclo_vio.geometry.array_types import Array, IntArray
from coclo_vio.geometry.compiled import compiled

SINGULAR_M = 0.02  # singular value (m for revolute joints) of a foot Jacobian below which a direction is damped
_MOST_SWEEPS = 20  # of Jacobi's iteration, which needs about four
_NEGLIGIBLE = 1e-18  # part of the trace that is zero beside the diagonal


class LegChains(NamedTuple):
    """Constants of all legs; the links of a leg are in order from the body to the foot.

    Attributes:
        first: the first link of each leg, and the number of links, (n + 1,).
        joint: the joint of each link among the robot's joints, (J,).
        steps: from the link before to each link, (J, 4, 3, 4): at joint position q the transform [rotation, offset (m)]
            is ``steps[0] + sin(q) steps[1] + (1 - cos(q)) steps[2] + q steps[3]`` (Rodrigues; the last for prismatic
            joints).
        axes: angular and linear axis of the joint in the axes of the link, one of them zero, (J, 2, 3).
        feet: transform [rotation, offset (m)] from the last link to each foot, (n, 3, 4).
    """

    first: IntArray
    joint: IntArray
    steps: Array
    axes: Array
    feet: Array


@compiled
def _set_composed(C: Array, A: Array, B: Array) -> None:
    """``C = A B`` of two transforms (3, 4)."""
    for i in range(3):
        for j in range(4):
            C[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]
        C[i, 3] += A[i, 3]


@compiled
def _set_step(step: Array, parts: Array, q: float) -> None:
    """The transform (3, 4) from one link to the next at joint position ``q``."""
    sine, half = math.sin(q), math.sin(0.5 * q)
    for i in range(3):
        for j in range(4):
            turned = sine * parts[1, i, j] + 2.0 * half * half * parts[2, i, j]
            step[i, j] = parts[0, i, j] + turned + q * parts[3, i, j]


@compiled
def kinematics(joints: Array, chains: LegChains) -> tuple[Array, Array, Array, Array, Array]:
    """What ``FeetKinematics`` holds, in its order: ``PinocchioLegs.kinematics`` and the rates of the feet.

    Args:
        joints: position and velocity of the joints, (2, J).
        chains: constants.
    """
    legs, count = len(chains.feet), len(chains.joint)
    centres, rotations, jacobian = np.empty((legs, 3)), np.empty((legs, 3, 3)), np.zeros((legs, 6, count))
    rates, step = np.zeros((2, legs, 3)), np.empty((3, 4))
    links = np.zeros((count + 1, 3, 4))  # of a leg, the body before them
    links[0, 0, 0] = links[0, 1, 1] = links[0, 2, 2] = 1.0
    for leg in range(legs):
        first, last = chains.first[leg], chains.first[leg + 1]
        for link in range(first, last):
            _set_step(step, chains.steps[link], joints[0, chains.joint[link]])
            _set_composed(links[link - first + 1], links[link - first], step)
        _set_composed(step, links[last - first], chains.feet[leg])
        for i in range(3):
            centres[leg, i] = step[i, 3]
            for j in range(3):
                rotations[leg, i, j] = step[i, j]
        for link in range(first, last):
            _set_column(jacobian[leg], chains.joint[link], links[link - first + 1], chains.axes[link], step)
            column = chains.joint[link]
            for i in range(6):
                rates[1 - i // 3, leg, i % 3] += jacobian[leg, i, column] * joints[1, column]
        if math.isnan(step[0, 3]):
            for i in range(6):
                for column in range(count):
                    jacobian[leg, i, column] = math.nan
    return centres, rates[0], rates[1], rotations, jacobian


@compiled
def _set_column(jacobian: Array, column: int, link: Array, axes: Array, foot: Array) -> None:
    """The column (6,) of one joint in the Jacobian of its foot."""
    for i in range(3):
        jacobian[i, column] = link[i, 0] * axes[0, 0] + link[i, 1] * axes[0, 1] + link[i, 2] * axes[0, 2]
        jacobian[3 + i, column] = link[i, 0] * axes[1, 0] + link[i, 1] * axes[1, 1] + link[i, 2] * axes[1, 2]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        moved = jacobian[j, column] * (foot[k, 3] - link[k, 3]) - jacobian[k, column] * (foot[j, 3] - link[j, 3])
        jacobian[3 + i, column] += moved


@compiled
def damped_forces(jacobian: Array, torque: Array, chains: LegChains) -> Array:
    """Foot forces (n, 3) by Jacobians (n, 6, J) and torques (J,): ``model.damped_forces``, NaN for a leg with a NaN."""
    forces, A, b = np.empty((len(jacobian), 3)), np.empty((3, 3)), np.empty(3)
    for leg in range(len(jacobian)):
        for i in range(3):
            b[i] = 0.0
            for j in range(3):
                A[i, j] = 0.0
        for link in range(chains.first[leg], chains.first[leg + 1]):
            column = chains.joint[link]
            for i in range(3):
                b[i] += jacobian[leg, 3 + i, column] * torque[column]
                for j in range(3):
                    A[i, j] += jacobian[leg, 3 + i, column] * jacobian[leg, 3 + j, column]
        if math.isnan(b[0] + b[1] + b[2]):
            for i in range(3):
                forces[leg, i] = math.nan
        elif _solve(forces[leg], A, b, SINGULAR_M * SINGULAR_M):
            _solve(forces[leg], A, b, 0.0)
        else:
            _solve_damped(forces[leg], A, b)
    return forces


@compiled
def _solve(x: Array, A: Array, b: Array, shift: float) -> bool:
    """``(A - shift) x = b`` of a symmetric ``A`` by Cholesky; False where ``A - shift`` is not positive definite."""
    d0 = A[0, 0] - shift
    l1, l2 = A[1, 0] / d0, A[2, 0] / d0
    d1 = A[1, 1] - shift - l1 * A[1, 0]
    l3 = (A[2, 1] - l2 * A[1, 0]) / d1
    d2 = A[2, 2] - shift - l2 * A[2, 0] - l3 * l3 * d1
    y1 = b[1] - l1 * b[0]
    x[2] = (b[2] - l2 * b[0] - l3 * y1) / d2
    x[1] = y1 / d1 - l3 * x[2]
    x[0] = b[0] / d0 - l1 * x[1] - l2 * x[2]
    return bool(d0 > 0.0 and d1 > 0.0 and d2 > 0.0)


@compiled
def _solve_damped(x: Array, A: Array, b: Array) -> None:
    """``A x = b`` of a symmetric ``A`` whose eigenvalues count as ``SINGULAR_M^2`` at least, by Jacobi's rotations.

    ``A`` becomes diagonal (Golub and Van Loan, "Matrix computations", 8.5).
    """
    V, negligible = np.zeros((3, 3)), _NEGLIGIBLE * (A[0, 0] + A[1, 1] + A[2, 2])
    V[0, 0] = V[1, 1] = V[2, 2] = 1.0
    for sweep in range(3 * _MOST_SWEEPS):
        p, q = (sweep % 3) // 2, 1 + (sweep % 3 + 1) // 2  # (0, 1), (0, 2), (1, 2)
        if abs(A[p, q]) <= negligible:
            continue
        tau = (A[q, q] - A[p, p]) / (2.0 * A[p, q])
        tangent = math.copysign(1.0, tau) / (abs(tau) + math.sqrt(1.0 + tau * tau))
        c = 1.0 / math.sqrt(1.0 + tangent * tangent)
        s = tangent * c
        for k in range(3):
            A[k, p], A[k, q] = c * A[k, p] - s * A[k, q], s * A[k, p] + c * A[k, q]
            V[k, p], V[k, q] = c * V[k, p] - s * V[k, q], s * V[k, p] + c * V[k, q]
        for k in range(3):
            A[p, k], A[q, k] = c * A[p, k] - s * A[q, k], s * A[p, k] + c * A[q, k]
    for i in range(3):
        x[i] = 0.0
        for k in range(3):
            along = V[0, k] * b[0] + V[1, k] * b[1] + V[2, k] * b[2]
            x[i] += V[i, k] * along / max(A[k, k], SINGULAR_M * SINGULAR_M)

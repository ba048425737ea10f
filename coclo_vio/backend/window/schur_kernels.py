# SPDX-License-Identifier: BSD-3-Clause
"""Compiled kernels of Schur's complement: normal equations of a window from which the points are eliminated.

A point touches only the poses that observe it: its elimination costs a few small products for each pair of them. The
readable form is GTSAM's elimination, with which the tests compare the result.
"""

import numpy as np

from coclo_vio.backend.window.reprojection_kernels import Camera, Indices, Observed, linearised
from coclo_vio.geometry.compiled import compiled, inlined
from coclo_vio.values.arrays import Array

_LEAST_SHARE = 2.0**-24  # of a variable's information that each of its dimensions has to keep: GTSAM's limit


@inlined
def add_pose(J_pose: Array, residual: Array, offset: int, information: Array, vector: Array) -> None:
    """Add an observation to information, lower triangle, (D, D), and vector (D,) of its pose at ``offset``."""
    for i in range(6):
        for k in range(3):
            vector[offset + i] -= J_pose[k, i] * residual[k]
            for j in range(i + 1):
                information[offset + i, offset + j] += J_pose[k, i] * J_pose[k, j]


@inlined
def add_point(J_pose: Array, J_point: Array, residual: Array, own: Array, vector: Array, cross: Array) -> None:
    """Add an observation to information (3, 3) and vector (3,) of its point; ``cross`` (3, 6) of it and the pose."""
    for i in range(3):
        for j in range(6):
            cross[i, j] = 0.0
        for k in range(3):
            vector[i] -= J_point[k, i] * residual[k]
            for j in range(3):
                own[i, j] += J_point[k, i] * J_point[k, j]
            for j in range(6):
                cross[i, j] += J_point[k, i] * J_pose[k, j]


@compiled
def factorised(own: Array, vector: Array) -> bool:
    """Replace information (3, 3) by its root L, lower triangle, and the vector (3,) by ``inv(L) vector``.

    Returns:
        Whether every direction is determined, by GTSAM's limit.
    """
    for i in range(3):
        whole = own[i, i]
        for j in range(i + 1):
            for k in range(j):
                own[i, j] -= own[i, k] * own[j, k]
            if j < i:
                own[i, j] /= own[j, j]
        if not own[i, i] > _LEAST_SHARE * whole:
            return False
        own[i, i] = np.sqrt(own[i, i])
        for k in range(i):
            vector[i] -= own[i, k] * vector[k]
        vector[i] /= own[i, i]
    return True


@compiled
def eliminate(root: Array, reduced: Array, cross: Array, offsets: Indices, information: Array, vector: Array) -> None:
    """Eliminate a point from the poses that observe it: Schur's complement.

    Args:
        root: L of the point's information, (3, 3).
        reduced: inv(L) times its vector, (3,).
        cross: of the point and each of M observing poses, (M, 3, 6); inv(L) times it afterwards.
        offsets: of those poses, (M,).
        information: of everything that is not eliminated, lower triangle, (D, D).
        vector: (D,).
    """
    for a in range(len(offsets)):
        for j in range(6):
            for i in range(3):
                for k in range(i):
                    cross[a, i, j] -= root[i, k] * cross[a, k, j]
                cross[a, i, j] /= root[i, i]
                vector[offsets[a] + j] -= cross[a, i, j] * reduced[i]
        for b in range(a + 1):
            first, second = (a, b) if offsets[a] >= offsets[b] else (b, a)
            for i in range(6):
                for j in range(6):
                    information[offsets[first] + i, offsets[second] + j] -= (
                        cross[first, 0, i] * cross[second, 0, j]
                        + cross[first, 1, i] * cross[second, 1, j]
                        + cross[first, 2, i] * cross[second, 2, j]
                    )


@inlined
def keep(
    own: Array, added: Array, cross: Array, offsets: Indices, place: int, information: Array, vector: Array
) -> None:
    """Add a point that is not eliminated at ``place``: information (3, 3), vector (3,) and cross terms (M, 3, 6)."""
    for i in range(3):
        vector[place + i] += added[i]
        for j in range(3):
            information[place + i, place + j] += own[i, j]
        for a in range(len(offsets)):
            for j in range(6):
                information[offsets[a] + j, place + i] += cross[a, i, j]


@compiled
def back_substituted(
    roots: Array, reduced: Array, cross: Array, starts: Indices, offsets: Indices, step: Array, points: Array
) -> None:
    """Steps (F, 3) of the eliminated points from the step (D,) of everything else.

    Args:
        roots: of each point, (F, 3, 3).
        reduced: of each point, (F, 3).
        cross: of each observation, as ``eliminate`` leaves it, (N, 3, 6).
        starts: first row of each point, and N, (P + 1,).
        offsets: of each observation's pose in the step, (N,).
        step: of everything that is not eliminated.
        points: result.
    """
    for point in range(len(points)):
        for i in range(3):
            points[point, i] = reduced[point, i]
            for row in range(starts[point], starts[point + 1]):
                for j in range(6):
                    points[point, i] -= cross[row, i, j] * step[offsets[row] + j]
        for i in range(2, -1, -1):
            for k in range(i + 1, 3):
                points[point, i] -= roots[point, k, i] * points[point, k]
            points[point, i] /= roots[point, i, i]


@compiled
def linearise(
    points: Array,
    observed: Observed,
    T_body_world: Array,
    camera: Camera,
    starts: Indices,
    offsets: tuple[Indices, Indices],
    system: tuple[Array, Array],
    free: tuple[Array, Array, Array],
) -> bool:
    """Add all observations to the normal equations; the first F points are eliminated.

    Args:
        points: m, world frame, (P, 3).
        observed: rows, those of a point together.
        T_body_world: of the keyframes, (K, 4, 4).
        camera: that observes.
        starts: first row of each point, and N, (P + 1,).
        offsets: in the system, of each row's pose, (N,), and of each point, (P,); those of eliminated ones are unused.
        system: information, lower triangle, (D, D), and vector (D,).
        free: results for ``back_substituted``: roots (F, 3, 3), reduced (F, 3), cross (N, 3, 6).

    Returns:
        Whether every eliminated point is determined.
    """
    row = np.empty(3), np.empty((3, 6)), np.empty((3, 3))
    own, vector = np.empty((3, 3)), np.empty(3)
    for point in range(len(points)):
        for i in range(3):
            vector[i] = 0.0
            for j in range(3):
                own[i, j] = 0.0
        begin, end = starts[point], starts[point + 1]
        for index in range(begin, end):
            pose = T_body_world[observed[1][index]]
            linearised(points[point], pose, camera, observed[2][index], observed[3][index], row)
            add_pose(row[1], row[0], offsets[0][index], system[0], system[1])
            add_point(row[1], row[2], row[0], own, vector, free[2][index])
        cross, poses = free[2][begin:end], offsets[0][begin:end]
        if point >= len(free[0]):
            keep(own, vector, cross, poses, offsets[1][point], system[0], system[1])
            continue
        if not factorised(own, vector):
            return False
        for i in range(3):
            free[1][point, i] = vector[i]
            for j in range(3):
                free[0][point, i, j] = own[i, j]
        eliminate(own, vector, cross, poses, system[0], system[1])
    return True


@compiled
def is_determined(root: Array, blocks: Indices) -> bool:
    """Whether, by GTSAM's limit, each variable is determined once the ones before it are eliminated.

    Args:
        root: Cholesky's root of the system, lower triangle, (D, D).
        blocks: first row of each variable, and D, (V + 1,).
    """
    for block in range(len(blocks) - 1):
        for row in range(blocks[block], blocks[block + 1]):
            whole = 0.0
            for column in range(blocks[block], row + 1):
                whole += root[row, column] ** 2
            if not root[row, row] ** 2 > _LEAST_SHARE * whole:
                return False
    return True

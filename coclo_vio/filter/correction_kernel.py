# SPDX-License-Identifier: BSD-3-Clause
"""Compiled update: the array before its triangularisation, and correction and factor after it.

The readable form is ``unscented_transform.correct``.
"""

import numpy as np

from coclo_vio.filter.measurement_table import Triples
from coclo_vio.filter.triangle_kernels import lower_of, reflect
from coclo_vio.geometry.array_types import Array, BoolArray
from coclo_vio.geometry.compiled import compiled, inlined


@compiled
def stacked(
    rows: Array, factor: Array, table: Triples, innovation: Array, rejected: BoolArray, observed: Array
) -> tuple[Array, Array, Array]:
    """``[[A_y, A_x], [R^(1/2), 0]]``, innovation and covariance with passive errors, without those of rejected legs.

    Args:
        rows: of the predicted measurement, (L + extra, M).
        factor: lower factor of the prior, (L, L).
        table: the M / 3 triples.
        innovation: measured less predicted, (M,).
        rejected: legs, (n,).
        observed: covariance of the predicted measurement with the passive errors, (M, p).

    Returns:
        The array, (L + extra + M', M' + L), column by column in memory, the innovation, (M',), and ``observed``,
        (M', p).
    """
    kept, count = np.empty(len(table.leg), dtype=np.int64), 0
    for row in range(len(table.leg)):
        if table.leg[row] < 0 or not rejected[table.leg[row]]:
            kept[count] = row
            count += 1
    size, length, height = 3 * count, len(factor), len(rows)
    columns = np.zeros((size + length, height + size))
    kept_innovation, kept_observed = np.empty(size), np.empty((size, observed.shape[1]))
    for index in range(count):
        for i in range(3):
            to, of = 3 * index + i, 3 * kept[index] + i
            kept_innovation[to] = innovation[of]
            for passive in range(observed.shape[1]):
                kept_observed[to, passive] = observed[of, passive]
            for row in range(height):
                columns[to, row] = rows[row, of]
            for j in range(i, 3):
                columns[3 * index + j, height + to] = table.noise[kept[index], j, i]
    for i in range(length):
        for j in range(i + 1):
            columns[size + i, j] = factor[i, j]
    return columns.T, kept_innovation, kept_observed


@compiled
def solved(
    triangle: Array, innovation: Array, considered: tuple[int, int], observed: Array, cross: Array, own: Array
) -> tuple[Array, Array]:
    """Correction (L + p,) and new lower factor (L, L); ``correct``, and ``PassiveStates.correct``.

    Args:
        triangle: of the array above, (M + L, M + L) or more rows; what is below the diagonal is not read.
        innovation: (M,).
        considered: first error that is only considered, and the one after the last.
        observed: covariance of the measurement with the passive errors, (M, p); is overwritten.
        cross: covariance of the active errors with the passive ones, (L, p); is updated.
        own: covariance of the passive errors, (p, p); is updated.
    """
    size = len(innovation)
    length = triangle.shape[1] - size
    whitened = np.empty(size)
    for i in range(size):
        total = innovation[i]
        for k in range(i):
            total -= triangle[k, i] * whitened[k]
        whitened[i] = total / triangle[i, i]
    step = np.zeros(length + len(own))
    for i in range(length):
        for k in range(size):
            step[i] += triangle[k, size + i] * whitened[k]
    _correct_passive(step[length:], triangle, whitened, observed, cross, own)
    first, last = considered
    if last == first:
        return step, lower_of(triangle, size, size + length)
    for i in range(first, last):
        step[i] = 0.0
    return step, _considered_factor(triangle, size, first, last)


@inlined
def _correct_passive(step: Array, triangle: Array, whitened: Array, observed: Array, cross: Array, own: Array) -> None:
    """``PassiveStates.correct``; ``observed`` becomes the gains."""
    size, passive = observed.shape
    for k in range(size):
        for i in range(k):
            for p in range(passive):
                observed[k, p] -= triangle[i, k] * observed[i, p]
        for p in range(passive):
            observed[k, p] /= triangle[k, k]
            step[p] += observed[k, p] * whitened[k]
        for q in range(passive):
            for p in range(passive):
                own[q, p] -= observed[k, q] * observed[k, p]
    for i in range(len(cross)):
        for k in range(size):
            for p in range(passive):
                cross[i, p] -= triangle[k, size + i] * observed[k, p]


@inlined
def _considered_factor(triangle: Array, size: int, first: int, last: int) -> Array:
    """The new lower factor, with the information of the step on the considered errors taken back."""
    length, few = triangle.shape[1] - size, last - first
    gained = np.empty((size, few))
    for i in range(size):
        for j in range(few):
            gained[i, j] = triangle[i, size + first + j]
    for k in range(few):
        reflect(gained, k, k, k + 1, size)
    rows = np.zeros((length + few, length))
    for i in range(length):
        for j in range(i, length):
            rows[i, j] = triangle[size + i, size + j]
    for i in range(few):
        for j in range(few):
            rows[length + i, first + j] = gained[i, j]
    for k in range(first, length):
        reflect(rows, k, k, length, length + few)
    factor = np.zeros((length, length))
    for i in range(length):
        for j in range(i + 1):
            factor[i, j] = rows[j, i]
    return factor

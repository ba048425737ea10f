# SPDX-License-Identifier: BSD-3-Clause
"""Compiled update: the array before its triangularisation, and correction and factor after it.

The readable form is ``unscented_transform.correct``.
"""

import numpy as np

from coclo_vio.filter.measurement_kernel import Triples
from coclo_vio.filter.triangle_kernels import lower_of, reflect
from coclo_vio.geometry.array_types import Array, BoolArray
from coclo_vio.geometry.compiled import compiled, inlined


@compiled
def stacked(rows: Array, factor: Array, table: Triples, innovation: Array, rejected: BoolArray) -> tuple[Array, Array]:
    """``[[A_y, A_x], [R^(1/2), 0]]`` and the innovation without the triples of rejected legs.

    Args:
        rows: of the predicted measurement, (L + extra, M).
        factor: lower factor of the prior, (L, L).
        table: the M / 3 triples.
        innovation: measured less predicted, (M,).
        rejected: legs, (n,).

    Returns:
        The array, (L + extra + M', M' + L), column by column in memory, and the innovation, (M',).
    """
    kept, count = np.empty(len(table.leg), dtype=np.int64), 0
    for row in range(len(table.leg)):
        if table.leg[row] < 0 or not rejected[table.leg[row]]:
            kept[count] = row
            count += 1
    size, length, observed = 3 * count, len(factor), len(rows)
    columns = np.zeros((size + length, observed + size))
    kept_innovation = np.empty(size)
    for index in range(count):
        for i in range(3):
            to, of = 3 * index + i, 3 * kept[index] + i
            kept_innovation[to] = innovation[of]
            for row in range(observed):
                columns[to, row] = rows[row, of]
            for j in range(i, 3):
                columns[3 * index + j, observed + to] = table.noise[kept[index], j, i]
    for i in range(length):
        for j in range(i + 1):
            columns[size + i, j] = factor[i, j]
    return columns.T, kept_innovation


@compiled
def solved(triangle: Array, innovation: Array, first: int, last: int) -> tuple[Array, Array]:
    """Correction (L,) and new lower factor (L, L); errors from ``first`` to ``last`` are only considered.

    Args:
        triangle: of the array above, (M + L, M + L) or more rows; what is below the diagonal is not read.
        innovation: (M,).
        first: first error that is only considered.
        last: the one after the last.
    """
    size = len(innovation)
    length = triangle.shape[1] - size
    whitened = np.empty(size)
    for i in range(size):
        total = innovation[i]
        for k in range(i):
            total -= triangle[k, i] * whitened[k]
        whitened[i] = total / triangle[i, i]
    step = np.empty(length)
    for i in range(length):
        step[i] = 0.0
        for k in range(size):
            step[i] += triangle[k, size + i] * whitened[k]
    if last == first:
        return step, lower_of(triangle, size, size + length)
    for i in range(first, last):
        step[i] = 0.0
    return step, _considered_factor(triangle, size, first, last)


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

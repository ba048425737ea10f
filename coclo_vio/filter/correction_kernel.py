# SPDX-License-Identifier: BSD-3-Clause
"""Compiled update: the array before its triangularisation, and correction and factor after it.

The readable form is ``unscented_transform.correct``.
"""

import numpy as np

from coclo_vio.filter.measurement_table import Triples
from coclo_vio.filter.triangle_kernels import cholesky_in_place, lower_of, reflect, substitute, substitute_back
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
    triangle: Array,
    innovation: Array,
    considered: tuple[int, int],
    prior: Array,
    observed: Array,
    cross: Array,
    own: Array,
) -> tuple[Array, Array]:
    """Correction (L + p,) and new lower factor (L, L); ``correct``, and ``PassiveStates.correct``.

    Args:
        triangle: of the array above, (M + L, M + L) or more rows; what is below the diagonal is not read.
        innovation: (M,).
        considered: first error that is only considered, and the one after the last.
        prior: covariance of all errors with those before the update, (L + p, k), where all others are corrected as if
            those were known (``unscented_transform.change_of_gain``); (0, 0) where they are not.
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
    if len(prior):
        return step, _conditional_factor(step, triangle, whitened, first, prior, observed, cross, own)
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
def _conditional_factor(
    step: Array, triangle: Array, whitened: Array, first: int, prior: Array, gains: Array, cross: Array, own: Array
) -> Array:
    """The new lower factor with the gains that take the considered errors for known; changes step and covariances."""
    size, few, passive = len(whitened), prior.shape[1], len(own)
    length = triangle.shape[1] - size
    change, shares = _change_of_gain(triangle, gains, prior, first)
    for j in range(few):
        total = 0.0
        for r in range(size):
            total += shares[r, j] * whitened[r]
        for i in range(length + passive):
            step[i] += change[i, j] * total
    for j in range(few):
        step[first + j] = 0.0
        reflect(shares, j, j, j + 1, len(shares))
    rows = np.zeros((length + few, length))
    for i in range(length):
        for j in range(i, length):
            rows[i, j] = triangle[size + i, size + j]
    added = np.zeros((few, length + passive))
    for k in range(few):
        for i in range(length + passive):
            for j in range(k, few):
                added[k, i] += shares[k, j] * change[i, j]
        rows[length + k] = added[k, :length]
        _add_outer_product(added[k, :length], added[k, length:], cross)
        _add_outer_product(added[k, length:], added[k, length:], own)
    for k in range(length):
        reflect(rows, k, k, length, length + few)
    return lower_of(rows, 0, length)


@inlined
def _add_outer_product(left: Array, right: Array, matrix: Array) -> None:
    for i in range(len(left)):
        for j in range(len(right)):
            matrix[i, j] += left[i] * right[j]


@inlined
def _change_of_gain(triangle: Array, gains: Array, prior: Array, first: int) -> tuple[Array, Array]:
    """``unscented_transform.change_of_gain``: (L + p, k), and its shares transposed, (max(M, k), k), zeros below M."""
    (size, passive), few = gains.shape, prior.shape[1]
    length = len(prior) - passive
    root, units, shares = prior[first : first + few].copy(), prior.copy(), np.zeros((max(size, few), few))
    cholesky_in_place(root)
    for r in range(size):
        for j in range(few):
            shares[r, j] = triangle[r, size + first + j]
    substitute(root, units)
    substitute(root, shares)
    squared, left = np.zeros((few, few)), np.zeros((few, few))
    for i in range(few):
        for j in range(few):
            for r in range(size):
                squared[i, j] += shares[r, i] * shares[r, j]
            left[i, j] = (1.0 if i == j else 0.0) - squared[i, j]
    cholesky_in_place(left)
    change = np.zeros((len(prior), few))
    for i in range(len(prior)):
        for j in range(few):
            for r in range(size):
                change[i, j] += shares[r, j] * (triangle[r, size + i] if i < length else gains[r, i - length])
            for k in range(few):
                change[i, j] -= units[i, k] * squared[k, j]
    substitute(left, change)
    substitute_back(left, change)
    for i in range(len(prior)):
        for j in range(few):
            change[i, j] -= units[i, j]
    return change, shares


@inlined
def _considered_factor(triangle: Array, size: int, first: int, last: int) -> Array:
    """The new lower factor, with the information of the step on the considered errors taken back."""
    length, few = triangle.shape[1] - size, last - first
    gained = np.zeros((max(size, few), few))
    for i in range(size):
        for j in range(few):
            gained[i, j] = triangle[i, size + first + j]
    for k in range(few):
        reflect(gained, k, k, k + 1, len(gained))
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

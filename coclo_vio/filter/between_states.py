# SPDX-License-Identifier: BSD-3-Clause
"""What a filter measured between two of its states, from their joint covariance, with the prior removed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from coclo_vio.values.arrays import Array

_LEAST_INFORMATION = 1e-7  # share of the prior's information below which a direction counts as not measured


@dataclass(frozen=True, slots=True, eq=False)
class Between:
    """``rows @ [a, b] = values + N(0, 1)`` of the errors of an earlier and a later state, (r, 2 n) and (r,)."""

    rows: Array
    values: Array


def between(
    prior_factor: Array,
    own: Array,
    cross: Array,
    present: Array,
    mean: Array,
    *,
    noise: Array,
    unmeasured: Sequence[int] = (),
) -> Between:
    """What a filter measured between two states, its prior on the earlier one removed.

    Args:
        prior_factor: lower factor of the prior of the earlier state, whose mean is zero, (n, n).
        own: covariance of the earlier state now, (n, n).
        cross: covariance of the present state with the earlier one, (n, n).
        present: covariance of the present state, about its mean, (n, n).
        mean: of the earlier state now, (n,).
        noise: covariance that is added to the present state given the earlier one, (n, n).
        unmeasured: directions of the state that nothing measures, and that the present state has unchanged.
    """
    size = len(own)
    whiten = solve_triangular(prior_factor, np.eye(size), lower=True)
    posterior = np.linalg.inv(symmetric(whiten @ own @ whiten.T))
    transition = cross @ whiten.T @ posterior @ whiten
    remaining = symmetric(present - transition @ cross.T + noise)
    information = whiten.T @ (posterior - np.eye(size)) @ whiten
    vector = whiten.T @ posterior @ whiten @ mean
    for each in unmeasured:
        transition[:, each] = np.eye(size)[each]
        information[each] = information[:, each] = vector[each] = 0.0
    conditional = np.linalg.inv(lower_factor(remaining))
    later = conditional @ np.concatenate((-transition, np.eye(size)), axis=1)
    scales = np.sqrt(np.sum(np.square(prior_factor), axis=1))
    values, axes = np.linalg.eigh(symmetric(scales[:, None] * information * scales))
    kept = values > _LEAST_INFORMATION
    root, directions = np.sqrt(values[kept]), axes[:, kept].T
    earlier = np.concatenate((root[:, None] * directions / scales, np.zeros((len(root), size))), axis=1)
    measured = -conditional @ transition @ mean, directions @ (scales * vector) / root
    return Between(np.concatenate((later, earlier)), np.concatenate(measured))


def symmetric(matrix: Array) -> Array:
    """The symmetric part of a matrix."""
    return np.asarray(0.5 * (matrix + matrix.T))


def lower_factor(covariance: Array) -> Array:
    """Lower factor of a covariance, whose correlations may by rounding not be positive definite."""
    scales = np.sqrt(covariance.diagonal())
    correlation = symmetric(covariance / np.outer(scales, scales))
    values, axes = np.linalg.eigh(correlation)
    bounded = (axes * np.maximum(values, 1e-13)) @ axes.T
    return np.asarray(scales[:, None] * np.linalg.cholesky(symmetric(bounded)))

# SPDX-License-Identifier: BSD-3-Clause
"""What leaves the window is summed up in a prior on what stays: Schur's complement, by GTSAM's elimination.

The prior is linear at the estimate at which it was made (``LinearContainerFactor``).
"""

from collections.abc import Iterable, Sequence

import gtsam
import numpy as np

from coclo_vio.arrays import Array
from coclo_vio.backend.window.factors import Term
from coclo_vio.errors import SmootherError


def marginal_prior(terms: Iterable[Term], leaving: Sequence[int], values: gtsam.Values) -> list[Term]:
    """The terms that say of the rest what ``terms`` say of everything, once ``leaving`` keys are eliminated.

    Args:
        terms: every term that touches a leaving key, and no other.
        leaving: keys to eliminate, landmarks before poses.
        values: where to linearise.

    Raises:
        SmootherError: something that leaves is not determined by the terms.
    """
    graph = gtsam.NonlinearFactorGraph()
    for term in terms:
        graph.push_back(term.factor)
    try:
        _, remaining = graph.linearize(values).eliminatePartialMultifrontal(_ordering(leaving))
    except RuntimeError as error:
        raise SmootherError(f"what leaves the window is not determined: {error}") from error
    kept = []
    for index in range(remaining.size()):
        factor = remaining.at(index)
        if factor is not None and factor.keys():
            container = gtsam.LinearContainerFactor(factor, values)
            kept.append(Term(container, tuple(int(key) for key in factor.keys())))
    return kept


def marginal_covariance(graph: gtsam.GaussianFactorGraph, keys: Sequence[int]) -> Array:
    """Covariance of ``keys`` in their order, from a linear graph.

    Raises:
        SmootherError: the graph does not determine them.
    """
    try:
        net = graph.marginalMultifrontalBayesNet(_ordering(keys))
        information, _ = gtsam.GaussianFactorGraph(net).hessian(_ordering(keys))
        return np.asarray(np.linalg.inv(information))
    except (RuntimeError, np.linalg.LinAlgError) as error:
        raise SmootherError(f"the newest keyframe is not determined: {error}") from error


def _ordering(keys: Sequence[int]) -> gtsam.Ordering:
    ordering = gtsam.Ordering()
    for key in keys:
        ordering.push_back(key)
    return ordering

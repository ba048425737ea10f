# SPDX-License-Identifier: BSD-3-Clause
"""What leaves the window is summed up in a prior on what stays: Schur's complement, by GTSAM's elimination.

The prior is linear at the estimate at which it was made (``LinearContainerFactor``).
"""

from collections.abc import Iterable, Sequence

import gtsam

from coclo_vio.backend.window.factors import Term
from coclo_vio.backend.window.solver import ordered
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
        _, remaining = graph.linearize(values).eliminatePartialMultifrontal(ordered(leaving))
    except (RuntimeError, ValueError) as error:  # ValueError: no term touches something that leaves
        raise SmootherError(f"what leaves the window is not determined: {error}") from error
    kept = []
    for index in range(remaining.size()):
        factor = remaining.at(index)
        keys = () if factor is None else tuple(int(key) for key in factor.keys())  # noqa: SIM118 -- a factor is no mapping
        if keys:
            kept.append(Term(gtsam.LinearContainerFactor(factor, values), keys))
    return kept

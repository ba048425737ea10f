# SPDX-License-Identifier: BSD-3-Clause
"""Gauss-Newton on a factor graph, with the covariance of its last variables at no extra cost; damped where it fails.

GTSAM linearises and eliminates. The last elimination also gives the covariance of what was eliminated last, which its
optimisers do not return; computing it with them costs as much as another iteration.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from coclo_vio.backend.window.factors import ordered
from coclo_vio.backend.window.indeterminate import indeterminate
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import SmootherError

_TINY = 1e-12
_ROUNDING = 1e-9
LENGTHS = (1.0, 0.5, 0.2, 0.05)  # shares of a step, tried in this order


@dataclass(frozen=True, slots=True, eq=False)
class Minimum:
    """The minimum of the cost.

    Attributes:
        values: of all variables.
        iterations: linear systems solved.
        covariance: of the variables eliminated last, in that order.
    """

    values: gtsam.Values
    iterations: int
    covariance: Array


def minimise(
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    elimination: Sequence[int],
    last: int,
    *,
    most_iterations: int,
    tolerance: float,
) -> Minimum:
    """The least cost near ``values``.

    Iterates until the linear model predicts the decrease of a step to within ``tolerance`` of the cost.

    Args:
        graph: the factors.
        values: where to start.
        elimination: keys of all variables in the order in which they are eliminated.
        last: number of keys at its end whose covariance is returned.
        most_iterations: the result after so many is returned, converged or not.
        tolerance: relative to the cost.

    Raises:
        IndeterminateError: the factors do not determine the variables.
        SmootherError: there is no finite minimum.
    """
    ordering = ordered(elimination)
    cost, iterations = graph.error(values), 0
    try:
        for _ in range(most_iterations):
            iterations += 1
            linear = graph.linearize(values)
            net = linear.eliminateSequential(ordering)
            step = net.optimize()
            length, proposed, proposed_cost = _shortened(graph, values, cost, step)
            if length == 0.0:
                return _damped(graph, values, elimination, last, most_iterations)
            predicted = linear.error(values.zeroVectors()) - linear.error(step)
            is_settled = length == 1.0 and abs(cost - proposed_cost - predicted) <= tolerance * proposed_cost
            values, cost = proposed, proposed_cost
            if is_settled:
                break
        return Minimum(values, iterations, _covariance(net, elimination[-last:]))
    except RuntimeError:  # GTSAM's "Indeterminate linear system"
        return _damped(graph, values, elimination, last, most_iterations)


def _shortened(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, cost: float, step: gtsam.VectorValues
) -> tuple[float, gtsam.Values, float]:
    """The longest share of a step that does not raise the cost, the values there and their cost; 0 if there is none."""
    for length in LENGTHS:
        proposed = values.retract(step.scale(length))
        proposed_cost = graph.error(proposed)
        if is_lower(proposed_cost, cost):
            return length, proposed, proposed_cost
    return 0.0, values, cost


def is_lower(proposed_cost: float, cost: float) -> bool:
    """Whether a step does not raise the cost, up to rounding."""
    return proposed_cost <= cost * (1.0 + _ROUNDING) + _TINY


def _damped(
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    elimination: Sequence[int],
    last: int,
    most_iterations: int,
) -> Minimum:
    ordering, solved = ordered(elimination), values
    params = gtsam.LevenbergMarquardtParams()
    params.setMaxIterations(most_iterations)
    try:
        optimizer = gtsam.LevenbergMarquardtOptimizer(graph, values, ordering, params)
        solved = optimizer.optimize()
        net = graph.linearize(solved).eliminateSequential(ordering)
        covariance = _covariance(net, elimination[-last:])
    except RuntimeError as error:
        message = f"a problem of {graph.size()} factors cannot be solved: {first_sentence(error)}"
        raise indeterminate(message, graph.linearize(solved), elimination, error) from error
    if not np.isfinite(optimizer.error()):
        raise SmootherError(f"a problem of {graph.size()} factors has no finite solution")
    return Minimum(solved, int(optimizer.iterations()), covariance)


def _covariance(net: gtsam.GaussianBayesNet, keys: Sequence[int]) -> Array:
    """Of the variables eliminated last, in the order of ``keys``."""
    end, missing = gtsam.GaussianFactorGraph(), set(keys)
    for index in reversed(range(net.size())):  # a net keeps parents after children, not the order of elimination
        conditional = net.at(index)
        if conditional.keys()[0] in missing:
            missing.remove(conditional.keys()[0])
            end.push_back(conditional)
        if not missing:
            break
    return covariance_of(end.hessian(ordered(keys))[0])


def covariance_of(information: Array) -> Array:
    """The inverse of the newest variables' information.

    Raises:
        SmootherError: they are not determined.
    """
    try:
        covariance = np.asarray(np.linalg.inv(information))
    except np.linalg.LinAlgError as error:
        raise SmootherError("the newest keyframe is not determined") from error
    if not np.isfinite(covariance).all():
        raise SmootherError("the newest keyframe has no finite covariance")
    return covariance


def first_sentence(error: Exception) -> str:
    """The first sentence of GTSAM's error, in a line, without the ten lines of advice after it."""
    return " ".join(str(error).strip().partition("\n\n")[0].split()).removesuffix(".")

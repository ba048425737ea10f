# SPDX-License-Identifier: BSD-3-Clause
"""Marginalisation: variables that leave the window become a prior on the others (Schur's complement, by GTSAM).

The prior is linear at the estimate at which it was made (``LinearContainerFactor``). Position in the world is measured
by nothing. Once the estimate has left the point of linearisation, a prior has spurious information on it all the same,
and the whole window drifts by metres. ``removing_terms`` removes that information.
"""

from collections.abc import Iterable, Sequence

import gtsam
import numpy as np
from scipy.linalg.lapack import dposv

from coclo_vio.backend.window.factors import Term, landmark_id, ordered
from coclo_vio.backend.window.indeterminate import indeterminate_points, supports
from coclo_vio.backend.window.solver import first_sentence
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import SmootherError

_LEAST_INFORMATION = 1e-6  # makes undetermined directions solvable


def evidence_of_poses(
    terms: Iterable[Term], leaving: Sequence[int], poses: Sequence[int], values: gtsam.Values
) -> tuple[Array, Array]:
    """Information (6 N, 6 N) and vector (6 N,) of ``terms`` on N poses once ``leaving`` keys are eliminated.

    Both are about the poses in ``values``, in the order of their keys ``poses``; directions may hold no information.

    Raises:
        SmootherError: a variable that leaves is not determined by the terms.
    """
    graph = gtsam.NonlinearFactorGraph()
    for term in terms:
        graph.push_back(term.factor)
    try:
        _, remaining = graph.linearize(values).eliminatePartialMultifrontal(ordered(leaving))
        for key in poses:  # also those that no factor is left of
            remaining.push_back(
                gtsam.JacobianFactor(key, np.zeros((6, 6)), np.zeros(6), gtsam.noiseModel.Unit.Create(6))
            )
        information, vector = remaining.hessian(ordered(poses))
    except RuntimeError as error:
        raise SmootherError(f"the evidence of keyframes is not determined: {first_sentence(error)}") from error
    return np.asarray(information), np.ravel(vector)


def marginal_prior(terms: Iterable[Term], leaving: Sequence[int], values: gtsam.Values) -> list[Term]:
    """The terms on the remaining variables that replace ``terms``, once ``leaving`` keys are eliminated.

    Args:
        terms: every term with a leaving key, and no other.
        leaving: keys to eliminate, landmarks before poses.
        values: where to linearise.

    Raises:
        SmootherError: a variable that leaves is not determined by the terms.
    """
    graph = gtsam.NonlinearFactorGraph()
    for term in terms:
        graph.push_back(term.factor)
    try:
        remaining = _eliminated(graph.linearize(values), leaving)
    except (RuntimeError, ValueError) as error:  # ValueError: a leaving key without a term
        raise SmootherError(f"what leaves the window is not determined: {first_sentence(error)}") from error
    kept = []
    for index in range(remaining.size()):
        factor = remaining.at(index)
        keys = () if factor is None else tuple(int(key) for key in factor.keys())  # noqa: SIM118 -- a factor is no mapping
        if keys:
            kept.append(Term(gtsam.LinearContainerFactor(factor, values), keys))
    return kept


def _eliminated(linear: gtsam.GaussianFactorGraph, leaving: Sequence[int]) -> gtsam.GaussianFactorGraph:
    """What remains of the factors; landmarks that they do not determine take nothing else with them."""
    try:
        return linear.eliminatePartialMultifrontal(ordered(leaving))[1]
    except RuntimeError as error:
        present = linear.keys()
        points = [key for key in leaving if landmark_id(key) is not None and present.count(key)]
        loose = indeterminate_points(linear, points, error)
        if not loose:
            raise
        for factor in supports(linear, loose):
            linear.push_back(factor)
        return linear.eliminatePartialMultifrontal(ordered(leaving))[1]


def removing_terms(prior: Sequence[Term], key: int, free: Array, values: gtsam.Values) -> list[Term]:
    """Terms that, added to ``prior``, remove its information on some directions of a pose, and nothing else.

    With g those directions and x everything else, information L and vector h, the prior is p(x | g) p(g); p(g) is
    removed, of information ``L_gg - L_gx inv(L_xx) L_xg`` and vector ``h_g - L_gx inv(L_xx) h_x``.

    Args:
        prior: every term.
        key: of the pose.
        free: the directions, orthonormal columns of its tangent space, (6, M).
        values: where to linearise.

    Raises:
        SmootherError: the prior is not finite.
    """
    if not any(key in term.keys for term in prior):
        return []
    graph = gtsam.GaussianFactorGraph()
    for term in prior:
        graph.push_back(term.factor.linearize(values))
    others = sorted({other for term in prior for other in term.keys} - {key})
    information, vector = (np.array(each) for each in graph.hessian(ordered([*others, key])))
    if not np.isfinite(information).all():
        raise SmootherError("the prior on what stays in the window is not finite")
    size = len(information) - len(free)
    turn = np.fliplr(np.linalg.qr(free, mode="complete")[0])
    turn[:, -free.shape[1] :] = free
    information[:, size:] = information[:, size:] @ turn
    information[size:] = turn.T @ information[size:]
    vector[size:] = turn.T @ vector[size:]
    size = len(information) - free.shape[1]
    rest = information[:size, :size] + _LEAST_INFORMATION * np.eye(size)
    columns = np.column_stack((information[:size, size:], vector[:size]))
    gain = _solved(rest, columns)
    alone = information[size:, size:] - information[size:, :size] @ gain[:, :-1]
    pull = vector[size:] - information[size:, :size] @ gain[:, -1]
    removed = gtsam.HessianFactor(key, -0.5 * free @ (alone + alone.T) @ free.T, -free @ pull, 0.0)
    return [Term(gtsam.LinearContainerFactor(removed, values), (key,))]


def _solved(matrix: Array, columns: Array) -> Array:
    """The solution of a symmetric system, which rounding may leave without a root of Cholesky; it may be empty."""
    if len(matrix):
        _, solution, failure = dposv(matrix, columns)
        if not failure:
            return np.asarray(solution)
    return np.asarray(np.linalg.solve(matrix, columns))

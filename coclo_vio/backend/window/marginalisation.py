# SPDX-License-Identifier: BSD-3-Clause
"""What leaves the window is summed up in a prior on what stays: Schur's complement, by GTSAM's elimination.

The prior is linear at the estimate at which it was made (``LinearContainerFactor``). Where the world is, nothing
measures: a prior that says so anyway lets the whole window slide, by metres, as soon as it is bent only a little off
where it is linear. ``relative_to`` takes that out.
"""

from collections.abc import Iterable, Sequence

import gtsam
import numpy as np

from coclo_vio.backend.window.factors import Term
from coclo_vio.backend.window.solver import first_sentence, ordered
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import SmootherError

_FAINT = 1e-6  # information that makes undetermined directions solvable


def evidence_of_poses(
    terms: Iterable[Term], leaving: Sequence[int], poses: Sequence[int], values: gtsam.Values
) -> tuple[Array, Array]:
    """What ``terms`` say of N poses once ``leaving`` keys are eliminated: information (6 N, 6 N), vector (6 N,).

    Both are about the poses in ``values``, in the order of their keys ``poses``; directions may be left open.

    Raises:
        SmootherError: something that leaves is not determined by the terms.
    """
    graph = gtsam.NonlinearFactorGraph()
    for term in terms:
        graph.push_back(term.factor)
    try:
        _, remaining = graph.linearize(values).eliminatePartialMultifrontal(ordered(leaving))
        for key in poses:  # also where nothing is said of one of them
            remaining.push_back(
                gtsam.JacobianFactor(key, np.zeros((6, 6)), np.zeros(6), gtsam.noiseModel.Unit.Create(6))
            )
        information, vector = remaining.hessian(ordered(poses))
    except RuntimeError as error:
        raise SmootherError(f"what is said of keyframes is not determined: {first_sentence(error)}") from error
    return np.asarray(information), np.ravel(vector)


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
        raise SmootherError(f"what leaves the window is not determined: {first_sentence(error)}") from error
    kept = []
    for index in range(remaining.size()):
        factor = remaining.at(index)
        keys = () if factor is None else tuple(int(key) for key in factor.keys())  # noqa: SIM118 -- a factor is no mapping
        if keys:
            kept.append(Term(gtsam.LinearContainerFactor(factor, values), keys))
    return kept


def relative_to(prior: Sequence[Term], key: int, free: Array, values: gtsam.Values) -> list[Term]:
    """Terms that, added to ``prior``, take back what it says of some directions of a pose, and nothing else.

    With g those directions and x everything else, information L and vector h, the prior is p(x | g) p(g); what is
    taken back is p(g), of information ``L_gg - L_gx inv(L_xx) L_xg`` and vector ``h_g - L_gx inv(L_xx) h_x``.

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
    information, vector = graph.hessian(ordered([*others, key]))
    if not np.isfinite(information).all():
        raise SmootherError("the prior on what stays in the window is not finite")
    size = len(information) - len(free)
    turned = np.eye(len(information))
    turned[size:, size:] = np.fliplr(np.linalg.qr(free, mode="complete")[0])
    turned[size:, -free.shape[1] :] = free
    information, vector = turned.T @ information @ turned, turned.T @ vector
    size = len(information) - free.shape[1]
    rest = information[:size, :size] + _FAINT * np.eye(size)
    gain = np.linalg.solve(rest, np.column_stack((information[:size, size:], vector[:size])))
    alone = information[size:, size:] - information[size:, :size] @ gain[:, :-1]
    pull = vector[size:] - information[size:, :size] @ gain[:, -1]
    taken_back = gtsam.HessianFactor(key, -0.5 * free @ (alone + alone.T) @ free.T, -free @ pull, 0.0)
    return [Term(gtsam.LinearContainerFactor(taken_back, values), (key,))]

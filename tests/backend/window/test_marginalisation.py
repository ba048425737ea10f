# SPDX-License-Identifier: BSD-3-Clause
"""On a linear problem a sliding window has exactly the estimate and covariance of the whole batch."""

import gtsam
import numpy as np
import pytest

from coclo_vio.backend.window.factors import Term, landmark_key, pose_key
from coclo_vio.backend.window.marginalisation import marginal_prior
from coclo_vio.backend.window.solver import minimise
from coclo_vio.values.errors import SmootherError

STEPS, WINDOW, TRACKED_FOR = 25, 4, 6  # landmarks stay longer than the keyframes that observed them first
ACROSS = np.array([[1.0, 0.3], [0.3, 2.0]])


def between(first: int, second: int, measured: np.ndarray, covariance: np.ndarray) -> Term:
    noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
    return Term(gtsam.BetweenFactorVector(first, second, measured, noise), (first, second))


def chain(seed: int) -> tuple[list[list[Term]], list[list[int]]]:
    """By step: the terms that come with it, and the landmarks that it observes; measurements contradict each other."""
    random = np.random.default_rng(seed)
    points = random.uniform(-5.0, 5.0, (STEPS + TRACKED_FOR, 2))
    terms: list[list[Term]] = []
    observed: list[list[int]] = []
    for step in range(STEPS):
        now: list[Term] = []
        if step == 0:
            kept_terms = gtsam.noiseModel.Isotropic.Sigma(2, 0.1)
            now.append(Term(gtsam.PriorFactorVector(pose_key(0), np.zeros(2), kept_terms), (pose_key(0),)))
        else:
            measured = np.array([1.0, 0.0]) + random.standard_normal(2)
            now.append(between(pose_key(step - 1), pose_key(step), measured, ACROSS))
        observed.append([*range(step, step + TRACKED_FOR)])
        for each in observed[-1]:
            measured = points[each] - [step, 0.0] + 0.3 * random.standard_normal(2)
            now.append(between(pose_key(step), landmark_key(each), measured, 0.09 * np.eye(2)))
        terms.append(now)
    return terms, observed


def solved(terms: list[Term]) -> tuple[gtsam.Values, list[int], np.ndarray]:
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for term in terms:
        graph.push_back(term.factor)
    keys = sorted({key for term in terms for key in term.keys}, key=lambda key: (key >= pose_key(0), key))
    for key in keys:
        values.insert(key, np.zeros(2))
    found = minimise(graph, values, keys, 1, most_iterations=3, tolerance=1e-12)
    return found.values, keys, found.covariance


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_window_has_estimate_and_covariance_of_the_batch_while_keyframes_leave(seed: int) -> None:
    terms, observed = chain(seed)
    kept_terms: list[Term] = []
    oldest, lost = 0, 0
    for step in range(STEPS):
        kept_terms += terms[step]
        values, _, covariance = solved(kept_terms)
        batch_values, _, batch_covariance = solved([term for some in terms[: step + 1] for term in some])
        newest = pose_key(step)
        np.testing.assert_allclose(values.atVector(newest), batch_values.atVector(newest), atol=1e-9)
        np.testing.assert_allclose(covariance, batch_covariance, atol=1e-9)
        if step - oldest < WINDOW:
            continue
        gone = [landmark_key(each) for each in range(lost, observed[step][0])]  # not by the newest keyframe
        leaving = [*gone, pose_key(oldest)]
        touched = [term for term in kept_terms if set(term.keys) & set(leaving)]
        rest = [term for term in kept_terms if not set(term.keys) & set(leaving)]
        kept_terms = rest + marginal_prior(touched, leaving, values)
        assert not {key for term in kept_terms for key in term.keys} & set(leaving)
        oldest, lost = oldest + 1, observed[step][0]
    assert oldest > STEPS // 2


def test_a_point_without_another_factor_leaves_no_information() -> None:
    """Two numbers measured once from a pose that stays: Schur's complement is zero."""
    term = between(pose_key(0), landmark_key(0), np.ones(2), np.eye(2))
    values = gtsam.Values()
    values.insert(pose_key(0), np.zeros(2))
    values.insert(landmark_key(0), np.ones(2))
    (kept,) = marginal_prior([term], [landmark_key(0)], values)
    assert kept.keys == (pose_key(0),)
    information = kept.factor.linearize(values).augmentedInformation()
    np.testing.assert_allclose(information, 0.0, atol=1e-12)


def test_an_undetermined_variable_cannot_be_marginalised() -> None:
    loose = between(pose_key(0), pose_key(1), np.ones(2), np.eye(2))
    values = gtsam.Values()
    for number in range(3):
        values.insert(pose_key(number), np.zeros(2))
    with pytest.raises(SmootherError, match="not determined"):
        marginal_prior([loose], [pose_key(0), pose_key(1)], values)

# SPDX-License-Identifier: BSD-3-Clause
"""Exchange of information on linear problems whose joint estimate is known: nothing is counted twice or lost."""

import numpy as np
import pytest
from linear_world import KEYFRAMES, LandmarkWindow, LegFilter, LinearWorld, joint
from linear_world import Information as LinearInformation

from coclo_vio.fusion.information import (
    end_evidence,
    evidence_beyond,
    intersection_weight,
    novel_information,
    pair_evidence,
)
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.keyframes import PoseEvidence, PoseMarginal, PosePair

SIZE = 2  # coordinates of a pose


def of_earlier(matrix: Array, vector: Array) -> tuple[Array, Array]:
    """Information of the earlier pose as that of a pair."""
    wide, long = np.zeros((2 * SIZE, 2 * SIZE)), np.zeros(2 * SIZE)
    wide[:SIZE, :SIZE], long[:SIZE] = matrix, vector
    return wide, long


def of_later(matrix: Array, vector: Array) -> tuple[Array, Array]:
    """Information of the later pose as that of a pair."""
    wide, long = np.zeros((2 * SIZE, 2 * SIZE)), np.zeros(2 * SIZE)
    wide[SIZE:, SIZE:], long[SIZE:] = matrix, vector
    return wide, long


@pytest.mark.parametrize("seed", range(5))
def test_decorrelated_exchange_is_the_joint_estimate(seed: int) -> None:
    """Filter and window, at every keyframe: all measurements, each counted once."""
    world = LinearWorld.of(seed, SIZE)
    leg_filter, window = LegFilter(world), LandmarkWindow(world)
    for k in range(1, KEYFRAMES):
        common = of_earlier(*window.last())
        by_legs, by_vision = leg_filter.pair(k), window.pair(k)
        novel_legs = novel_information(*by_legs, *common, 1e-9)
        novel_vision = novel_information(*by_vision, *common, 1e-9)
        leg_filter.take(by_legs[0] + novel_vision[0], by_legs[1] + novel_vision[1])
        window.take(*novel_legs)
        mean, covariance = joint(world, k)
        np.testing.assert_allclose(leg_filter.mean_and_covariance[0], mean, atol=1e-9)
        np.testing.assert_allclose(leg_filter.mean_and_covariance[1], covariance, atol=1e-9)
        np.testing.assert_allclose(np.linalg.inv(window.last()[0]), covariance, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_rejected_evidence_is_lost_to_the_filter_only_and_counted_twice_nowhere(seed: int) -> None:
    """Each subtracts what it knew itself: the window still has everything, the filter all but what it rejected."""
    world = LinearWorld.of(seed, SIZE)
    leg_filter, window = LegFilter(world), LandmarkWindow(world)
    for k in range(1, KEYFRAMES):
        known_to_legs, known_to_vision = of_earlier(leg_filter.matrix, leg_filter.vector), of_earlier(*window.last())
        by_legs, by_vision = leg_filter.pair(k), window.pair(k)
        novel_legs = novel_information(*by_legs, *known_to_legs, 1e-9)
        novel_vision = novel_information(*by_vision, *known_to_vision, 1e-9)
        is_accepted = k % 3 != 0
        leg_filter.take(by_legs[0] + is_accepted * novel_vision[0], by_legs[1] + is_accepted * novel_vision[1])
        window.take(*novel_legs)
        best = joint(world, k)[1]
        np.testing.assert_allclose(np.linalg.inv(window.last()[0]), best, atol=1e-9)
        excess = np.linalg.eigvalsh(leg_filter.mean_and_covariance[1] - best)
        assert excess.min() > -1e-9
        assert k < 3 or excess.max() > 1e-5


def fed_back(seed: int, policy: str) -> tuple[Array, Array]:
    """Claimed covariance after a policy that feeds the smoothed pose back, and the joint estimate's."""
    world = LinearWorld.of(seed, SIZE)
    leg_filter, window = LegFilter(world), LandmarkWindow(world)
    for k in range(1, KEYFRAMES):
        by_legs = leg_filter.pair(k)
        window.pair(k)
        step = LinearInformation(2, SIZE).add({1: 1.0, 0: -1.0}, world.steps[k - 1], world.step_noise)
        window.take(step.matrix, step.vector)
        last = window.last()
        share, own = 1.0, 1.0
        if policy == "ci":
            own = intersection_weight(np.linalg.inv(by_legs[0])[SIZE:, SIZE:], np.linalg.inv(last[0]))
            share = 1.0 - own
        smoothed = of_later(share * last[0], share * last[1])
        leg_filter.take(own * by_legs[0] + smoothed[0], own * by_legs[1] + smoothed[1])
    return leg_filter.mean_and_covariance[1], joint(world, KEYFRAMES - 1)[1]


@pytest.mark.parametrize("seed", range(5))
def test_naive_feedback_is_overconfident(seed: int) -> None:
    """The claimed covariance is smaller than all measurements together allow."""
    claimed, best = fed_back(seed, "paper")
    assert np.linalg.eigvalsh(best - claimed).max() > 0.0
    assert np.linalg.det(claimed) < 0.15 * np.linalg.det(best)


@pytest.mark.parametrize("seed", range(5))
def test_covariance_intersection_is_never_overconfident(seed: int) -> None:
    claimed, best = fed_back(seed, "ci")
    assert np.linalg.eigvalsh(claimed - best).min() > -1e-12
    assert np.linalg.det(claimed) > 1.01 * np.linalg.det(best)


def test_a_marginal_that_equals_what_is_known_has_no_novel_information() -> None:
    random = np.random.default_rng(3)
    root = random.normal(size=(4, 4))
    known, known_vector = root @ root.T + np.eye(4), random.normal(size=4)
    information, vector = novel_information(known, known_vector, known, known_vector, 1e-6)
    np.testing.assert_allclose(information, 0.0, atol=1e-12)
    np.testing.assert_allclose(vector, 0.0, atol=1e-12)


def test_directions_in_which_information_was_removed_are_left_out() -> None:
    """A marginal with less information in one direction than what was known, and more in another."""
    known = np.diag([4.0, 1.0])
    marginal, known_vector = np.diag([3.0, 6.0]), np.array([4.0, 1.0])
    information, vector = novel_information(marginal, np.array([3.0, 12.0]), known, known_vector, 1e-6)
    np.testing.assert_allclose(information, np.diag([0.0, 5.0]), atol=1e-9)
    np.testing.assert_allclose(vector, [0.0, 11.0], atol=1e-9)


def random_pair(seed: int) -> PosePair:
    random = np.random.default_rng(seed)
    root = 1e-2 * random.normal(size=(12, 12))
    T_start = se3.exp(random.normal(size=6))
    return PosePair(5, 9, T_start, T_start @ se3.exp(0.1 * random.normal(size=6)), root @ root.T + 1e-5 * np.eye(12))


def test_common_knowledge_and_evidence_make_up_the_marginal() -> None:
    pair = random_pair(1)
    known = PoseMarginal(5, pair.T_world_start @ se3.exp(1e-9 * np.ones(6)), 2.0 * pair.covariance[:6, :6])
    evidence = pair_evidence(pair, known, min_share=0.0, floor_m=1e-9)
    total = np.array(evidence.information)
    total[:6, :6] += np.linalg.inv(known.covariance)
    np.testing.assert_allclose(np.linalg.inv(total), pair.covariance, rtol=1e-5, atol=1e-10)


def test_a_mean_that_moved_is_novel() -> None:
    """The earlier pose is estimated elsewhere than was known: evidence and knowledge together give the estimate."""
    pair = random_pair(2)
    away = 1e-4 * np.arange(1.0, 7.0)
    known = PoseMarginal(5, pair.T_world_start @ se3.exp(away), 3.0 * pair.covariance[:6, :6])
    evidence = pair_evidence(pair, known, min_share=0.0, floor_m=1e-9)
    total, vector = np.array(evidence.information), np.array(evidence.vector)
    total[:6, :6] += np.linalg.inv(known.covariance)
    vector[:6] += np.linalg.inv(known.covariance) @ away
    np.testing.assert_allclose(np.linalg.solve(total, vector), 0.0, atol=1e-6)


def test_the_sigma_of_motion_is_never_below_the_floor() -> None:
    pair = PosePair(0, 1, np.eye(4), np.eye(4), 1e-20 * np.eye(12))
    evidence = pair_evidence(pair, None, min_share=1e-4, floor_m=1e-3)
    assert np.linalg.eigvalsh(evidence.information).max() == pytest.approx(3e6 / 2 * (1 + 5**0.5 / 3), rel=0.01)


def test_without_common_knowledge_all_evidence_is_novel() -> None:
    evidence = PoseEvidence(0, 1, np.eye(4), np.eye(4), np.eye(12), np.arange(12.0))
    assert evidence_beyond(evidence, None, 1e-4) is evidence


def test_evidence_of_the_end_has_no_information_of_the_start() -> None:
    pair = random_pair(4)
    evidence = end_evidence(pair, pair.end, 0.25)
    assert (evidence.start_ns, evidence.end_ns) == (pair.start_ns, pair.end_ns)
    assert not evidence.information[:6].any()
    np.testing.assert_allclose(4.0 * evidence.information[6:, 6:] @ pair.end.covariance, np.eye(6), atol=1e-6)


def test_rows_of_evidence_have_all_of_it_and_none_of_what_is_undetermined() -> None:
    random = np.random.default_rng(5)
    some = random.normal(size=(12, 7))
    evidence = PoseEvidence(0, 1, np.eye(4), np.eye(4), some @ some.T, some @ random.normal(size=7))
    rows, measured = evidence.rows()
    assert rows.shape == (7, 12)
    np.testing.assert_allclose(rows.T @ rows, evidence.information, atol=1e-9)
    np.testing.assert_allclose(rows.T @ measured, evidence.vector, atol=1e-9)


def test_a_marginal_that_is_no_covariance_is_a_smoother_error() -> None:
    with pytest.raises(SmootherError, match=r"not positive definite: no evidence is exchanged at this keyframe"):
        novel_information(-np.eye(12), np.zeros(12), np.eye(12), np.zeros(12), 1e-4)
    singular = PoseMarginal(9, np.eye(4), np.zeros((6, 6)))
    with pytest.raises(SmootherError, match=r"singular: no evidence is exchanged at this keyframe"):
        end_evidence(random_pair(6), singular)

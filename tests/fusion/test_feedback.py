# SPDX-License-Identifier: BSD-3-Clause
"""Feedback policies on poses so close together that their exchange is linear and its joint estimate is known."""

import runpy
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from linear_world import KEYFRAMES, Information, LandmarkWindow, LegFilter, LinearWorld, joint

from coclo_vio.fusion.config import BridgeConfig
from coclo_vio.fusion.feedback import (
    Feedback,
    FeedbackPolicy,
    NoFeedback,
    PolicyParameters,
    feedback_policies,
    make_feedback_policy,
    register_feedback_policy,
    unregister_feedback_policy,
)
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.keyframes import KeyframeResult, PoseEvidence, PoseMarginal, PosePair

SIZE = 6
SCALE = 1e-4  # m and rad: rotations commute up to 1e-8
PARAMETERS = PolicyParameters(min_novel_share=1e-7, floor_m=1e-12)
EARLIER, LATER = slice(0, SIZE), slice(SIZE, 2 * SIZE)


def pair_of(matrix: Array, vector: Array, k: int) -> PosePair:
    covariance = np.linalg.inv(matrix)
    start, end = np.split(covariance @ vector, 2)
    return PosePair(k - 1, k, se3.exp(start), se3.exp(end), covariance)


def marginal_of(matrix: Array, vector: Array, k: int) -> PoseMarginal:
    covariance = np.linalg.inv(matrix)
    return PoseMarginal(k, se3.exp(covariance @ vector), covariance)


def evidence_of(matrix: Array, vector: Array, k: int) -> PoseEvidence:
    return PoseEvidence(k - 1, k, np.eye(4), np.eye(4), matrix, vector)


def linear(evidence: PoseEvidence) -> tuple[Array, Array]:
    """Information and vector about 0 of evidence about its linearisation points."""
    points = np.concatenate((se3.log(evidence.T_world_start), se3.log(evidence.T_world_end)))
    return evidence.information, evidence.vector + evidence.information @ points


class Exchange:
    """Filter and window that exchange at every keyframe what a policy gives them."""

    def __init__(self, seed: int, policy: FeedbackPolicy) -> None:
        self.world = LinearWorld.of(seed, SIZE, SCALE)
        self.policy = policy
        self.leg_filter, self.window = LegFilter(self.world), LandmarkWindow(self.world)
        self.known_to_both = self.known_to_window = marginal_of(*self.window.last(), 0)

    def step(self, k: int) -> None:
        matrix, vector = self.leg_filter.pair(k)
        pair = pair_of(matrix, vector, k)
        result_evidence = evidence_of(*self.window.pair(k), k)
        evidence = self.policy.evidence_for_window(pair, self.known_to_both)
        if evidence is None:
            motion = Information(2, SIZE).add({1: 1.0, 0: -1.0}, self.world.steps[k - 1], self.world.step_noise)
            self.window.take(motion.matrix, motion.vector)
        else:
            self.window.take(*linear(evidence))
        result = KeyframeResult(marginal_of(*self.window.last(), k), result_evidence)
        feedback = self.policy.feedback_for_filter(pair, self.known_to_window, result)
        if feedback is not None:
            matrix, vector = matrix / feedback.inflation**2, vector / feedback.inflation**2
            added = linear(feedback.evidence)
            matrix, vector = matrix + added[0], vector + added[1]
        self.leg_filter.take(matrix, vector)
        self.known_to_window = result.marginal
        self.known_to_both = marginal_of(self.leg_filter.matrix, self.leg_filter.vector, k)


def exchanged(seed: int, name: str) -> tuple[Exchange, Array]:
    """Filter and window after all keyframes, and the covariance of the joint estimate."""
    exchange = Exchange(seed, make_feedback_policy(name, PARAMETERS))
    for k in range(1, KEYFRAMES):
        exchange.step(k)
    return exchange, joint(exchange.world, KEYFRAMES - 1)[1]


@pytest.mark.parametrize("seed", range(3))
def test_decorrelated_feedback_gives_the_filter_and_the_window_the_joint_estimate(seed: int) -> None:
    exchange, best = exchanged(seed, "decorrelated")
    mean, covariance = exchange.leg_filter.mean_and_covariance
    np.testing.assert_allclose(covariance / SCALE**2, best / SCALE**2, atol=1e-5)
    np.testing.assert_allclose(mean / SCALE, joint(exchange.world, KEYFRAMES - 1)[0] / SCALE, atol=1e-3)
    np.testing.assert_allclose(np.linalg.inv(exchange.window.last()[0]) / SCALE**2, best / SCALE**2, atol=1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_paper_feedback_is_overconfident(seed: int) -> None:
    exchange, best = exchanged(seed, "paper")
    claimed = exchange.leg_filter.mean_and_covariance[1]
    assert np.linalg.det(claimed / SCALE**2) < 0.15 * np.linalg.det(best / SCALE**2)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["ci", "off"])
def test_covariance_intersection_and_no_feedback_are_conservative(seed: int, name: str) -> None:
    exchange, best = exchanged(seed, name)
    claimed = exchange.leg_filter.mean_and_covariance[1]
    excess = np.linalg.eigvalsh((claimed - best) / SCALE**2)
    assert excess.min() > -1e-9
    assert excess.max() > 1e-4


@pytest.mark.parametrize("seed", range(3))
def test_covariance_intersection_knows_more_than_no_feedback(seed: int) -> None:
    by_intersection, alone = (exchanged(seed, name)[0].leg_filter.mean_and_covariance[1] for name in ("ci", "off"))
    assert np.linalg.det(by_intersection / SCALE**2) < np.linalg.det(alone / SCALE**2)


def one_keyframe() -> tuple[PosePair, PoseMarginal, KeyframeResult]:
    """Filter's poses, common knowledge and window's result of a first exchange."""
    exchange = Exchange(0, NoFeedback(PARAMETERS))
    pair = pair_of(*exchange.leg_filter.pair(1), 1)
    evidence = evidence_of(*exchange.window.pair(1), 1)
    exchange.window.take(np.zeros((2 * SIZE, 2 * SIZE)), np.zeros(2 * SIZE))
    return pair, exchange.known_to_both, KeyframeResult(marginal_of(*exchange.window.last(), 1), evidence)


@pytest.mark.parametrize("name", ["off", "paper", "ci"])
def test_only_decorrelated_feedback_replaces_the_relative_motion_by_evidence(name: str) -> None:
    pair, known, _ = one_keyframe()
    assert make_feedback_policy(name, PARAMETERS).evidence_for_window(pair, known) is None
    evidence = make_feedback_policy("decorrelated", PARAMETERS).evidence_for_window(pair, known)
    assert evidence is not None
    assert (evidence.start_ns, evidence.end_ns) == (0, 1)


def test_each_policy_gives_the_filter_what_its_description_claims() -> None:
    pair, known, result = one_keyframe()
    given = {name: make_feedback_policy(name, PARAMETERS).feedback_for_filter(pair, known, result) for name in POLICIES}
    assert given["off"] is None
    paper, intersection, decorrelated = given["paper"], given["ci"], given["decorrelated"]
    assert isinstance(paper, Feedback)
    np.testing.assert_allclose(
        paper.evidence.information[LATER, LATER] @ result.marginal.covariance, np.eye(SIZE), atol=1e-6
    )
    assert (paper.inflation, paper.fallback) == (1.0, None)
    assert isinstance(intersection, Feedback)
    own_share = intersection.inflation**-2
    assert 0.0 < own_share < 1.0
    np.testing.assert_allclose(
        intersection.evidence.information, (1.0 - own_share) * paper.evidence.information, rtol=1e-9, atol=1e-3
    )
    assert isinstance(decorrelated, Feedback)
    assert isinstance(result.evidence, PoseEvidence)
    rest = result.evidence.information - decorrelated.evidence.information
    np.testing.assert_allclose(rest[EARLIER, EARLIER] @ known.covariance, np.eye(SIZE), atol=1e-3)
    assert isinstance(decorrelated.fallback, PoseEvidence)
    np.testing.assert_allclose(decorrelated.fallback.information, paper.evidence.information)


POLICIES = ("off", "paper", "ci", "decorrelated")


def test_the_policies_are_listed_with_their_descriptions() -> None:
    assert tuple(feedback_policies()) == POLICIES
    assert all(feedback_policies().values())


@pytest.fixture
def own_policy() -> Iterator[str]:
    register_feedback_policy("own", NoFeedback, "for the test")
    yield "own"
    unregister_feedback_policy("own")


def test_a_registered_policy_can_be_configured_until_it_is_unregistered(own_policy: str) -> None:
    assert BridgeConfig.parse({"feedback": own_policy}, "file").feedback == "own"
    assert isinstance(make_feedback_policy(own_policy, PARAMETERS), NoFeedback)
    assert feedback_policies()[own_policy] == "for the test"
    with pytest.raises(ConfigError, match=r"a feedback policy 'own' already; register yours under another name"):
        register_feedback_policy(own_policy, NoFeedback, "twice")
    unregister_feedback_policy(own_policy)
    with pytest.raises(ConfigError, match=r"'own' is no feedback policy; there are: off, paper, ci, decorrelated"):
        BridgeConfig.parse({"feedback": own_policy}, "file")


def test_a_policy_is_made_with_the_parameters_of_the_configuration() -> None:
    config = BridgeConfig.parse({"min_novel_share": 0.01, "floor_m": 0.002}, "file")
    assert config.policy_parameters == PolicyParameters(min_novel_share=0.01, floor_m=0.002)


def test_a_plain_off_of_yaml_is_the_policy_off() -> None:
    assert BridgeConfig.parse({"feedback": False}, "file").feedback == "off"


@pytest.mark.parametrize("name", ["on", "Paper"])
def test_an_unknown_policy_lists_those_there_are(name: str) -> None:
    with pytest.raises(ConfigError, match=rf"feedback = '{name}': .*no feedback policy; there are: off, paper, ci"):
        BridgeConfig.parse({"feedback": name}, "file")
    with pytest.raises(ConfigError, match=rf"bridge\.feedback = '{name}' is no feedback policy; there are: off"):
        make_feedback_policy(name, PARAMETERS)


@pytest.fixture
def _example() -> Iterator[None]:
    """The policy ``inflated`` of the page on feedback policies."""
    runpy.run_path(str(EXAMPLE))
    yield
    unregister_feedback_policy("inflated")


EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "extending" / "examples" / "feedback_policy_plugin.py"


@pytest.mark.usefixtures("_example")
@pytest.mark.parametrize("seed", range(3))
def test_the_example_of_a_policy_is_far_less_overconfident_than_the_papers(seed: int) -> None:
    exchange, best = exchanged(seed, "inflated")
    claimed = {name: exchanged(seed, name)[0].leg_filter.mean_and_covariance[1] for name in ("paper", "off")}
    claimed["inflated"] = exchange.leg_filter.mean_and_covariance[1]
    volume = {name: np.linalg.det(covariance / SCALE**2) for name, covariance in claimed.items()}
    joint_volume = np.linalg.det(best / SCALE**2)
    assert volume["paper"] < 0.15 * joint_volume
    assert 0.5 * joint_volume < volume["inflated"] < volume["off"]

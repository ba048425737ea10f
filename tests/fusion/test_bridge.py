# SPDX-License-Identifier: BSD-3-Clause
"""The bridge on linear problems whose joint answer is known: nothing is counted twice, and nothing is lost."""

from dataclasses import dataclass

import numpy as np
import pytest

from coclo_vio.fusion.bridge import BridgeConfig, evidence_beyond, intersection_weight, legs_evidence, news, of_end
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import ConfigError, SmootherError
from coclo_vio.values.keyframes import PoseEvidence, PoseMarginal, PosePair

SIZE = 2  # of a pose on the line world below: two independent coordinates with coupled noise
KEYFRAMES = 12
LANDMARKS = 3


@dataclass(frozen=True)
class LinearWorld:
    """Poses that walk at random; legs measure the steps, something absolute, eyes see landmarks from each pose."""

    steps: Array
    absolute: Array
    sightings: Array
    step_noise: Array
    absolute_noise: Array
    sight_noise: Array

    @classmethod
    def of(cls, seed: int) -> "LinearWorld":
        random = np.random.default_rng(seed)

        def covariance(size: int, scale: float) -> Array:
            root = random.normal(size=(size, size))
            return scale**2 * (root @ root.T + 0.3 * np.eye(size))

        noises = covariance(SIZE, 0.03), covariance(SIZE, 2.0), covariance(SIZE, 0.2)
        true = np.cumsum(0.03 * random.normal(size=(KEYFRAMES, SIZE)), axis=0)
        true -= true[0]
        landmarks = 3.0 * random.normal(size=(LANDMARKS, SIZE))

        def noisy(values: Array, noise: Array) -> Array:
            return values + random.normal(size=values.shape) @ np.linalg.cholesky(noise).T

        return cls(
            noisy(np.diff(true, axis=0), noises[0]),
            noisy(true, noises[1]),
            noisy(landmarks[None] - true[:, None], noises[2]),
            *noises,
        )


class Information:
    """A Gaussian in information form over blocks of ``SIZE``."""

    def __init__(self, blocks: int) -> None:
        self.matrix = np.zeros((blocks * SIZE, blocks * SIZE))
        self.vector = np.zeros(blocks * SIZE)

    def add(self, signs: dict[int, float], measured: Array, noise: Array) -> "Information":
        """A measurement of a signed sum of blocks."""
        rows = np.zeros((SIZE, len(self.vector)))
        for block, sign in signs.items():
            rows[:, block * SIZE : (block + 1) * SIZE] = sign * np.eye(SIZE)
        weighed = rows.T @ np.linalg.inv(noise)
        self.matrix += weighed @ rows
        self.vector += weighed @ measured
        return self

    def of(self, blocks: list[int]) -> tuple[Array, Array]:
        """Marginal information and vector of some blocks, in this order."""
        kept = np.concatenate([np.arange(block * SIZE, (block + 1) * SIZE) for block in blocks])
        gone = np.setdiff1d(np.arange(len(self.vector)), kept)
        across = self.matrix[np.ix_(kept, gone)] @ np.linalg.inv(self.matrix[np.ix_(gone, gone)])
        return (
            self.matrix[np.ix_(kept, kept)] - across @ self.matrix[np.ix_(gone, kept)],
            self.vector[kept] - across @ self.vector[gone],
        )


START = 0.05**2 * np.eye(SIZE)


def joint(world: LinearWorld, until: int) -> tuple[Array, Array]:
    """Mean and covariance of the last pose from everything that was measured up to it, all at once."""
    everything = Information(until + 1 + LANDMARKS).add({0: 1.0}, np.zeros(SIZE), START)
    for k in range(until + 1):
        for landmark in range(LANDMARKS):
            seen = world.sightings[k, landmark]
            everything.add({until + 1 + landmark: 1.0, k: -1.0}, seen, world.sight_noise)
        if k:
            everything.add({k: 1.0, k - 1: -1.0}, world.steps[k - 1], world.step_noise)
            everything.add({k: 1.0}, world.absolute[k], world.absolute_noise)
    information, vector = everything.of([until])
    covariance = np.linalg.inv(information)
    return covariance @ vector, covariance


class Legs:
    """A Kalman filter in information form: the last keyframe, then the pair."""

    def __init__(self, world: LinearWorld) -> None:
        self.world = world
        self.matrix, self.vector = np.linalg.inv(START), np.zeros(SIZE)

    def pair(self, k: int) -> tuple[Array, Array]:
        """What is believed of keyframes k - 1 and k by steps and by what is absolute."""
        pair = Information(2)
        pair.matrix[:SIZE, :SIZE], pair.vector[:SIZE] = self.matrix, self.vector
        pair.add({1: 1.0, 0: -1.0}, self.world.steps[k - 1], self.world.step_noise)
        pair.add({1: 1.0}, self.world.absolute[k], self.world.absolute_noise)
        return pair.matrix, pair.vector

    def take(self, matrix: Array, vector: Array) -> None:
        """The pair as it is known now; its later pose stays."""
        pair = Information(2)
        pair.matrix, pair.vector = matrix, vector
        self.matrix, self.vector = pair.of([1])

    @property
    def mean_and_covariance(self) -> tuple[Array, Array]:
        covariance = np.linalg.inv(self.matrix)
        return covariance @ self.vector, covariance


class Eyes:
    """A window of one keyframe and all landmarks; block 0 is the last keyframe, block 1 the new one."""

    def __init__(self, world: LinearWorld) -> None:
        self.world = world
        self.known = Information(2 + LANDMARKS).add({0: 1.0}, np.zeros(SIZE), START)
        self._see(0, 0)
        self.landmarks = [2 + landmark for landmark in range(LANDMARKS)]

    def _see(self, block: int, k: int) -> None:
        for landmark in range(LANDMARKS):
            self.known.add({2 + landmark: 1.0, block: -1.0}, self.world.sightings[k, landmark], self.world.sight_noise)

    def pair(self, k: int) -> tuple[Array, Array]:
        """What is known of keyframes k - 1 and k without the step between them."""
        self._see(1, k)
        return self.known.of([0, 1])

    def take(self, matrix: Array, vector: Array) -> None:
        """Evidence of the pair; then the earlier keyframe leaves."""
        self.known.matrix[: 2 * SIZE, : 2 * SIZE] += matrix
        self.known.vector[: 2 * SIZE] += vector
        kept = self.known.of([1, *self.landmarks])
        self.known = Information(2 + LANDMARKS)
        places = np.r_[np.arange(SIZE), np.arange(2 * SIZE, (2 + LANDMARKS) * SIZE)]
        self.known.matrix[np.ix_(places, places)], self.known.vector[places] = kept

    def last(self) -> tuple[Array, Array]:
        """Information and vector of the last keyframe."""
        of_all = Information(1 + LANDMARKS)
        places = np.r_[np.arange(SIZE), np.arange(2 * SIZE, (2 + LANDMARKS) * SIZE)]
        of_all.matrix, of_all.vector = self.known.matrix[np.ix_(places, places)], self.known.vector[places]
        return of_all.of([0])


def of_earlier(matrix: Array, vector: Array) -> tuple[Array, Array]:
    """What is known of the earlier pose as knowledge of a pair."""
    wide, long = np.zeros((2 * SIZE, 2 * SIZE)), np.zeros(2 * SIZE)
    wide[:SIZE, :SIZE], long[:SIZE] = matrix, vector
    return wide, long


def of_later(matrix: Array, vector: Array) -> tuple[Array, Array]:
    wide, long = np.zeros((2 * SIZE, 2 * SIZE)), np.zeros(2 * SIZE)
    wide[SIZE:, SIZE:], long[SIZE:] = matrix, vector
    return wide, long


@pytest.mark.parametrize("seed", range(5))
def test_decorrelated_exchange_is_the_joint_estimate(seed: int) -> None:
    """Both sides, at every keyframe: all that was measured, each thing once."""
    world = LinearWorld.of(seed)
    legs, eyes = Legs(world), Eyes(world)
    for k in range(1, KEYFRAMES):
        common = of_earlier(*eyes.last())
        felt, seen = legs.pair(k), eyes.pair(k)
        from_legs, from_eyes = news(*felt, *common, 1e-9), news(*seen, *common, 1e-9)
        legs.take(felt[0] + from_eyes[0], felt[1] + from_eyes[1])
        eyes.take(*from_legs)
        mean, covariance = joint(world, k)
        np.testing.assert_allclose(legs.mean_and_covariance[0], mean, atol=1e-9)
        np.testing.assert_allclose(legs.mean_and_covariance[1], covariance, atol=1e-9)
        np.testing.assert_allclose(np.linalg.inv(eyes.last()[0]), covariance, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_what_the_filter_refused_is_missed_by_neither_side_and_told_to_none_twice(seed: int) -> None:
    """Each takes away what it knew itself: the eyes still know everything, the legs all but what they refused."""
    world = LinearWorld.of(seed)
    legs, eyes = Legs(world), Eyes(world)
    for k in range(1, KEYFRAMES):
        felt_before, seen_before = of_earlier(legs.matrix, legs.vector), of_earlier(*eyes.last())
        felt, seen = legs.pair(k), eyes.pair(k)
        from_legs, from_eyes = news(*felt, *felt_before, 1e-9), news(*seen, *seen_before, 1e-9)
        is_refused = k % 3 == 0
        legs.take(felt[0] + (not is_refused) * from_eyes[0], felt[1] + (not is_refused) * from_eyes[1])
        eyes.take(*from_legs)
        best = joint(world, k)[1]
        np.testing.assert_allclose(np.linalg.inv(eyes.last()[0]), best, atol=1e-9)
        surer = np.linalg.eigvalsh(legs.mean_and_covariance[1] - best)
        assert surer.min() > -1e-9
        assert k < 3 or surer.max() > 1e-5


def fed_back(seed: int, policy: str) -> tuple[Array, Array]:
    """Claimed covariance after a policy that hands back the smoothed pose, and the joint estimate's."""
    world = LinearWorld.of(seed)
    legs, eyes = Legs(world), Eyes(world)
    for k in range(1, KEYFRAMES):
        felt = legs.pair(k)
        eyes.pair(k)
        step = Information(2).add({1: 1.0, 0: -1.0}, world.steps[k - 1], world.step_noise)
        eyes.take(step.matrix, step.vector)
        last = eyes.last()
        share, own = 1.0, 1.0
        if policy == "ci":
            own = intersection_weight(np.linalg.inv(felt[0])[SIZE:, SIZE:], np.linalg.inv(last[0]))
            share = 1.0 - own
        told = of_later(share * last[0], share * last[1])
        legs.take(own * felt[0] + told[0], own * felt[1] + told[1])
    return legs.mean_and_covariance[1], joint(world, KEYFRAMES - 1)[1]


@pytest.mark.parametrize("seed", range(5))
def test_naive_feedback_is_surer_than_everything_together_allows(seed: int) -> None:
    claimed, best = fed_back(seed, "paper")
    assert np.linalg.eigvalsh(best - claimed).max() > 0.0
    assert np.linalg.det(claimed) < 0.15 * np.linalg.det(best)


@pytest.mark.parametrize("seed", range(5))
def test_covariance_intersection_is_never_surer(seed: int) -> None:
    claimed, best = fed_back(seed, "ci")
    assert np.linalg.eigvalsh(claimed - best).min() > -1e-12
    assert np.linalg.det(claimed) > 1.01 * np.linalg.det(best)


def test_nothing_new_is_no_news() -> None:
    random = np.random.default_rng(3)
    root = random.normal(size=(4, 4))
    known, vector = root @ root.T + np.eye(4), random.normal(size=4)
    information, told = news(known, vector, known, vector, 1e-6)
    np.testing.assert_allclose(information, 0.0, atol=1e-12)
    np.testing.assert_allclose(told, 0.0, atol=1e-12)


def test_what_was_taken_away_is_left_out_and_the_rest_is_told() -> None:
    """A belief that knows less in one direction than what was known, and more in another."""
    known = np.diag([4.0, 1.0])
    information, told = news(np.diag([3.0, 6.0]), np.array([3.0, 12.0]), known, np.array([4.0, 1.0]), 1e-6)
    np.testing.assert_allclose(information, np.diag([0.0, 5.0]), atol=1e-9)
    np.testing.assert_allclose(told, [0.0, 11.0], atol=1e-9)


def random_pair(seed: int) -> PosePair:
    random = np.random.default_rng(seed)
    root = 1e-2 * random.normal(size=(12, 12))
    T_start = se3.exp(random.normal(size=6))
    return PosePair(5, 9, T_start, T_start @ se3.exp(0.1 * random.normal(size=6)), root @ root.T + 1e-5 * np.eye(12))


def test_what_is_known_and_the_evidence_make_the_belief_again() -> None:
    pair = random_pair(1)
    known = PoseMarginal(5, pair.T_world_start @ se3.exp(1e-9 * np.ones(6)), 2.0 * pair.covariance[:6, :6])
    told = legs_evidence(pair, known, BridgeConfig(floor_m=1e-9, min_novel_share=0.0))
    total = np.array(told.information)
    total[:6, :6] += np.linalg.inv(known.covariance)
    np.testing.assert_allclose(np.linalg.inv(total), pair.covariance, rtol=1e-5, atol=1e-10)


def test_a_mean_that_moved_is_news() -> None:
    """The earlier pose is believed elsewhere than was known: evidence and knowledge together say where."""
    pair = random_pair(2)
    away = 1e-4 * np.arange(1.0, 7.0)
    known = PoseMarginal(5, pair.T_world_start @ se3.exp(away), 3.0 * pair.covariance[:6, :6])
    told = legs_evidence(pair, known, BridgeConfig(floor_m=1e-9, min_novel_share=0.0))
    total, vector = np.array(told.information), np.array(told.vector)
    total[:6, :6] += np.linalg.inv(known.covariance)
    vector[:6] += np.linalg.inv(known.covariance) @ away
    np.testing.assert_allclose(np.linalg.solve(total, vector), 0.0, atol=1e-6)


def test_motion_is_never_believed_better_than_the_floor() -> None:
    pair = PosePair(0, 1, np.eye(4), np.eye(4), 1e-20 * np.eye(12))
    told = legs_evidence(pair, None, BridgeConfig(floor_m=1e-3))
    assert np.linalg.eigvalsh(told.information).max() == pytest.approx(3e6 / 2 * (1 + 5**0.5 / 3), rel=0.01)


def test_without_knowledge_a_belief_is_evidence_as_it_is() -> None:
    told = PoseEvidence(0, 1, np.eye(4), np.eye(4), np.eye(12), np.arange(12.0))
    assert evidence_beyond(told, None, 1e-4) is told


def test_a_belief_of_the_end_says_nothing_of_the_start() -> None:
    pair = random_pair(4)
    start = PoseMarginal(5, pair.T_world_start, np.eye(6))
    told = of_end(start, pair.end, 0.25)
    assert not told.information[:6].any()
    np.testing.assert_allclose(4.0 * told.information[6:, 6:] @ pair.end.covariance, np.eye(6), atol=1e-6)


def test_rows_of_evidence_hold_all_of_it_and_leave_open_what_is_open() -> None:
    random = np.random.default_rng(5)
    some = random.normal(size=(12, 7))
    told = PoseEvidence(0, 1, np.eye(4), np.eye(4), some @ some.T, some @ random.normal(size=7))
    rows, measured = told.rows()
    assert rows.shape == (7, 12)
    np.testing.assert_allclose(rows.T @ rows, told.information, atol=1e-9)
    np.testing.assert_allclose(rows.T @ measured, told.vector, atol=1e-9)


def test_a_plain_off_of_yaml_is_understood() -> None:
    assert BridgeConfig.parse({"feedback": False}, "file").feedback == "off"
    with pytest.raises(ConfigError, match="feedback"):
        BridgeConfig.parse({"feedback": "on"}, "file")


def test_a_belief_that_is_none_is_a_sentence() -> None:
    with pytest.raises(SmootherError, match="not positive definite"):
        news(-np.eye(12), np.zeros(12), np.eye(12), np.zeros(12), 1e-4)
    singular = PoseMarginal(0, np.eye(4), np.zeros((6, 6)))
    with pytest.raises(SmootherError, match="singular"):
        of_end(singular, singular)

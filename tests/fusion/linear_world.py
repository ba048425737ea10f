# SPDX-License-Identifier: BSD-3-Clause
"""A linear world whose joint estimate is known: a filter of steps, a window of landmarks, and all data at once."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.values.arrays import Array

KEYFRAMES = 12
LANDMARKS = 3


@dataclass(frozen=True)
class LinearWorld:
    """A random walk of poses; leg odometry measures steps and an absolute quantity, vision landmarks from each pose.

    Attributes:
        size: coordinates of a pose; their noise is coupled.
        start: covariance of the first pose, which is 0.
    """

    size: int
    start: Array
    steps: Array
    absolute: Array
    observations: Array
    step_noise: Array
    absolute_noise: Array
    observation_noise: Array

    @classmethod
    def of(cls, seed: int, size: int, scale: float = 1.0) -> "LinearWorld":
        """A world from a seed, all lengths and sigmas multiplied by ``scale``."""
        random = np.random.default_rng(seed)

        def covariance(sigma: float) -> Array:
            root = random.normal(size=(size, size))
            return (scale * sigma) ** 2 * (root @ root.T + 0.3 * np.eye(size))

        noises = covariance(0.03), covariance(2.0), covariance(0.2)
        true = np.cumsum(0.03 * scale * random.normal(size=(KEYFRAMES, size)), axis=0)
        true -= true[0]
        landmarks = 3.0 * scale * random.normal(size=(LANDMARKS, size))

        def noisy(values: Array, noise: Array) -> Array:
            return values + random.normal(size=values.shape) @ np.linalg.cholesky(noise).T

        return cls(
            size,
            (0.05 * scale) ** 2 * np.eye(size),
            noisy(np.diff(true, axis=0), noises[0]),
            noisy(true, noises[1]),
            noisy(landmarks[None] - true[:, None], noises[2]),
            *noises,
        )


class Information:
    """A Gaussian in information form over blocks of a size."""

    def __init__(self, blocks: int, size: int) -> None:
        self.size = size
        self.matrix = np.zeros((blocks * size, blocks * size))
        self.vector = np.zeros(blocks * size)

    def rows_of(self, blocks: list[int]) -> Array:
        return np.concatenate([np.arange(block * self.size, (block + 1) * self.size) for block in blocks])

    def add(self, signs: dict[int, float], measured: Array, noise: Array) -> "Information":
        """A measurement of a signed sum of blocks."""
        jacobian = np.zeros((self.size, len(self.vector)))
        for block, sign in signs.items():
            jacobian[:, self.rows_of([block])] = sign * np.eye(self.size)
        weighed = jacobian.T @ np.linalg.inv(noise)
        self.matrix += weighed @ jacobian
        self.vector += weighed @ measured
        return self

    def of(self, blocks: list[int]) -> tuple[Array, Array]:
        """Marginal information and vector of some blocks, in this order."""
        kept = self.rows_of(blocks)
        gone = np.setdiff1d(np.arange(len(self.vector)), kept)
        across = self.matrix[np.ix_(kept, gone)] @ np.linalg.inv(self.matrix[np.ix_(gone, gone)])
        return (
            self.matrix[np.ix_(kept, kept)] - across @ self.matrix[np.ix_(gone, kept)],
            self.vector[kept] - across @ self.vector[gone],
        )


def joint(world: LinearWorld, until: int) -> tuple[Array, Array]:
    """Mean and covariance of the last pose from all measurements up to it at once."""
    everything = Information(until + 1 + LANDMARKS, world.size).add({0: 1.0}, np.zeros(world.size), world.start)
    for k in range(until + 1):
        for landmark in range(LANDMARKS):
            observed = world.observations[k, landmark]
            everything.add({until + 1 + landmark: 1.0, k: -1.0}, observed, world.observation_noise)
        if k:
            everything.add({k: 1.0, k - 1: -1.0}, world.steps[k - 1], world.step_noise)
            everything.add({k: 1.0}, world.absolute[k], world.absolute_noise)
    information, vector = everything.of([until])
    covariance = np.linalg.inv(information)
    return covariance @ vector, covariance


class LegFilter:
    """A Kalman filter in information form: the last keyframe, then the pair."""

    def __init__(self, world: LinearWorld) -> None:
        self.world = world
        self.matrix, self.vector = np.linalg.inv(world.start), np.zeros(world.size)

    def pair(self, k: int) -> tuple[Array, Array]:
        """Marginal of keyframes k - 1 and k by the step and the absolute measurement between them."""
        pair = Information(2, self.world.size)
        earlier = pair.rows_of([0])
        pair.matrix[np.ix_(earlier, earlier)], pair.vector[earlier] = self.matrix, self.vector
        pair.add({1: 1.0, 0: -1.0}, self.world.steps[k - 1], self.world.step_noise)
        pair.add({1: 1.0}, self.world.absolute[k], self.world.absolute_noise)
        return pair.matrix, pair.vector

    def take(self, matrix: Array, vector: Array) -> None:
        """The marginal of the pair after evidence; its later pose stays."""
        pair = Information(2, self.world.size)
        pair.matrix, pair.vector = matrix, vector
        self.matrix, self.vector = pair.of([1])

    @property
    def mean_and_covariance(self) -> tuple[Array, Array]:
        covariance = np.linalg.inv(self.matrix)
        return covariance @ self.vector, covariance


class LandmarkWindow:
    """A window of one keyframe and all landmarks; block 0 is the last keyframe, block 1 the new one."""

    _LANDMARK_BLOCKS = tuple(range(2, 2 + LANDMARKS))

    def __init__(self, world: LinearWorld) -> None:
        self.world = world
        self.known = Information(2 + LANDMARKS, world.size).add({0: 1.0}, np.zeros(world.size), world.start)
        self._observe(0, 0)

    def _observe(self, block: int, k: int) -> None:
        for landmark, observed in zip(self._LANDMARK_BLOCKS, self.world.observations[k], strict=True):
            self.known.add({landmark: 1.0, block: -1.0}, observed, self.world.observation_noise)

    def pair(self, k: int) -> tuple[Array, Array]:
        """Marginal of keyframes k - 1 and k without the step between them."""
        self._observe(1, k)
        return self.known.of([0, 1])

    def take(self, matrix: Array, vector: Array) -> None:
        """Evidence of the pair; then the earlier keyframe leaves."""
        pair = self.known.rows_of([0, 1])
        self.known.matrix[np.ix_(pair, pair)] += matrix
        self.known.vector[pair] += vector
        marginal = self.known.of([1, *self._LANDMARK_BLOCKS])
        self.known = Information(2 + LANDMARKS, self.world.size)
        kept = self.known.rows_of([0, *self._LANDMARK_BLOCKS])
        self.known.matrix[np.ix_(kept, kept)], self.known.vector[kept] = marginal

    def last(self) -> tuple[Array, Array]:
        """Information and vector of the last keyframe, once the earlier one has left."""
        without_new = Information(1 + LANDMARKS, self.world.size)
        kept = self.known.rows_of([0, *self._LANDMARK_BLOCKS])
        without_new.matrix, without_new.vector = self.known.matrix[np.ix_(kept, kept)], self.known.vector[kept]
        return without_new.of([0])

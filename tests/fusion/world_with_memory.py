# SPDX-License-Identifier: BSD-3-Clause
"""A linear world in which both sides remember: a bias of the legs, and landmarks that the window sees for long.

A body moves along a line. Legs measure each motion with white noise and a constant bias, by a share that differs from
keyframe to keyframe; cameras measure landmarks that stay. Errors are linear in the primitive noise, so the true
covariance of every estimate is known exactly, beside the one that it claims.
"""

from dataclasses import dataclass, field

import numpy as np

from coclo_vio.fusion.information import novel_information
from coclo_vio.values.arrays import Array

MIN_SHARE = 1e-9
KNOWN = 1e10  # information of the first pose


@dataclass
class Gaussian:
    """An estimator of some unknowns: information (n, n), and information times error as rows of primitives (n, D)."""

    information: Array
    vectors: Array

    def grow(self) -> int:
        """One more unknown, of which nothing is known; its index."""
        count = len(self.information)
        information = np.zeros((count + 1, count + 1))
        information[:count, :count] = self.information
        self.information = information
        self.vectors = np.vstack([self.vectors, np.zeros(self.vectors.shape[1])])
        return count

    def measure(self, row: dict[int, float], sigma: float, noise: Array) -> None:
        """Take a measurement of a combination of unknowns; its noise as a row of primitives (D,)."""
        rows = np.zeros(len(self.information))
        rows[list(row)] = list(row.values())
        self.information = self.information + np.outer(rows, rows) / sigma**2
        self.vectors = self.vectors + np.outer(rows, noise) / sigma**2

    def add(self, at: list[int], information: Array, vectors: Array) -> None:
        """Take evidence on some unknowns."""
        self.information[np.ix_(at, at)] += information
        self.vectors[at] += vectors

    def of(self, kept: list[int]) -> "Gaussian":
        """The marginal of some unknowns, in this order."""
        left = [index for index in range(len(self.information)) if index not in kept]
        across = self.information[np.ix_(kept, left)] @ np.linalg.inv(self.information[np.ix_(left, left)])
        information = self.information[np.ix_(kept, kept)] - across @ self.information[np.ix_(left, kept)]
        return Gaussian(information, self.vectors[kept] - across @ self.vectors[left])

    def variances(self, index: int) -> tuple[float, float]:
        """True and claimed variance of an unknown."""
        covariance = np.linalg.inv(self.information)
        error = covariance[index] @ self.vectors
        return float(error @ error), float(covariance[index, index])


@dataclass
class World:
    """Filter [pose, bias], window [pose, landmarks], and the joint estimator [pose, bias, landmarks] of the same data.

    Attributes:
        bias: one sigma of it.
        legs: one sigma of a motion.
        camera: one sigma of an observation.
        life: keyframes for which a landmark is seen.
        landmarks: how many at once.
    """

    bias: float = 0.02
    legs: float = 0.01
    camera: float = 0.02
    life: int = 8
    landmarks: int = 12
    keyframes: int = 60
    seed: int = 0
    _used: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self._size = 1 + self.keyframes * (2 * self.landmarks + 1) + self.landmarks
        generator = np.random.default_rng(self.seed)
        self._shares = generator.uniform(0.0, 2.0, self.keyframes)
        self._sigmas = self.legs * generator.uniform(0.3, 2.0, self.keyframes)
        bias = self._noise(self.bias)
        nothing = np.zeros(self._size)
        start = np.diag([KNOWN, self.bias**-2])
        self.filter = Gaussian(start.copy(), np.stack([nothing, -bias / self.bias**2]))
        self.joint = Gaussian(start, self.filter.vectors.copy())
        self.window = Gaussian(np.array([[KNOWN]]), nothing[None])
        self._ages: list[int] = []
        self._see_new()
        self._ages = [index % self.life for index in range(self.landmarks)]  # they do not go all at once

    def _noise(self, sigma: float) -> Array:
        row = np.zeros(self._size)
        row[self._used] = sigma
        self._used += 1
        return row

    def _see_new(self) -> None:
        """New landmarks in the place of those that have gone."""
        while len(self._ages) < self.landmarks:
            noise = self._noise(self.camera)
            for each in (self.window, self.joint):
                each.measure({each.grow(): 1.0, 0: -1.0}, self.camera, noise)
            self._ages.append(0)

    def step(self, number: int) -> None:
        """One keyframe: legs and cameras measure, and filter and window exchange what each has measured."""
        share, sigma, noise = self._shares[number], self._sigmas[number], self._noise(self._sigmas[number])
        before = self.filter.of([0]), self.window.of([0])
        ends = [each.grow() for each in (self.filter, self.window, self.joint)]
        for each, end in ((self.filter, ends[0]), (self.joint, ends[2])):
            each.measure({end: 1.0, 0: -1.0, 1: share}, sigma, noise)
        for index in range(len(self._ages)):
            seen = self._noise(self.camera)
            self.window.measure({1 + index: 1.0, ends[1]: -1.0}, self.camera, seen)
            self.joint.measure({2 + index: 1.0, ends[2]: -1.0}, self.camera, seen)
        by_filter = _novel(self.filter.of([0, ends[0]]), before[0])
        by_window = _novel(self.window.of([0, ends[1]]), before[1])
        self.window.add([0, ends[1]], *by_filter)
        self.filter.add([0, ends[0]], *by_window)
        self._ages = [age + 1 for age in self._ages]
        stay = [index for index, age in enumerate(self._ages) if age < self.life]
        self.filter = self.filter.of([ends[0], 1])
        self.window = self.window.of([ends[1], *(1 + index for index in stay)])
        self.joint = self.joint.of([ends[2], 1, *(2 + index for index in stay)])
        self._ages = [self._ages[index] for index in stay]
        self._see_new()


def _novel(pair: Gaussian, known: Gaussian) -> tuple[Array, Array]:
    """What a marginal of two poses knows beyond that of the first one."""
    information, vectors = np.zeros((2, 2)), np.zeros(pair.vectors.shape)
    information[0, 0], vectors[0] = known.information[0, 0], known.vectors[0]
    return novel_information(pair.information, pair.vectors, information, vectors, MIN_SHARE)

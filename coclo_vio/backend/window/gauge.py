# SPDX-License-Identifier: BSD-3-Clause
"""The gauge of the window: what becomes of the directions of its oldest keyframe that nothing measures.

Cameras measure positions relative to each other only, and gravity adds roll and pitch. Position in the world and
heading (without gravity the whole pose) are unobservable; there the oldest keyframe is held where it is, and its
uncertainty is kept beside the window and added to what goes out. A window that starts from a given marginal has no such
directions: it keeps its information on the world.
"""

from collections.abc import Sequence
from typing import Protocol

import gtsam
import numpy as np

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.factors import Term
from coclo_vio.backend.window.marginalisation import removing_terms
from coclo_vio.backend.window.variables import POSE
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array

_HELD = 1e-4  # rad and m, one sigma: where the oldest keyframe is held
_OPEN = 100.0  # rad, one sigma of its tilt where gravity measures it


class Gauge(Protocol):
    """What is done with the oldest keyframe's place in the world.

    Attributes:
        term: holds that keyframe; it holds no information and leaves with it. None where there is none.
        covariance: of the held directions, right/local, (6, 6).
    """

    term: Term | None
    covariance: Array

    def begin(self, number: int, T_world_body: Array, covariance: Array) -> tuple[list[Term], Array]:
        """Start with keyframe ``number`` as the oldest one, whose pose has a covariance (6, 6).

        Returns:
            The prior on it, and the covariance of the directions that are not held, (6, 6).
        """

    def pass_on(
        self, number: int, T_world_body: Array, covariance: Array, prior: Sequence[Term], values: gtsam.Values
    ) -> list[Term]:
        """Keyframe ``number`` becomes the oldest one after a marginalisation.

        Args:
            number: of the keyframe.
            T_world_body: its pose, (4, 4).
            covariance: of its pose in the world, (6, 6).
            prior: that the marginalisation left.
            values: where that is linear.

        Returns:
            Terms that are added to the prior.
        """

    def replace(self, number: int, T_world_body: Array, held: Array, covariance: Array) -> list[Term]:
        """Keyframe ``number`` becomes the oldest one, without any prior: the one that takes its place.

        Args:
            number: of the keyframe.
            T_world_body: its pose, (4, 4).
            held: covariance that it has from the keyframe held before, (6, 6).
            covariance: of its pose relative to that, (6, 6).
        """

    def covariance_at(self, T_world_body: Array, T_world_held: Array) -> Array:
        """Covariance (6, 6) that a pose (4, 4) has from the held keyframe, now at ``T_world_held``, right/local."""


class HeldGauge:
    """Holds the oldest keyframe's pose: nothing measures any of it.

    Attributes:
        term: holds the keyframe; None before the start.
        covariance: of the held directions, right/local, (6, 6).
    """

    def __init__(self) -> None:
        self.term: Term | None = None
        self.covariance = np.zeros((POSE.dimensions, POSE.dimensions))

    def directions(self, T_world_body: Array) -> Array:
        """Orthonormal columns of a pose's tangent space along which no measurement changes, (6, M)."""
        return np.eye(POSE.dimensions)

    def begin(self, number: int, T_world_body: Array, covariance: Array) -> tuple[list[Term], Array]:
        """Hold the keyframe; the prior is on what is not held."""
        self._hold(number, T_world_body, covariance)
        return self._prior(number, T_world_body, covariance), np.asarray(covariance - self.covariance)

    def pass_on(
        self, number: int, T_world_body: Array, covariance: Array, prior: Sequence[Term], values: gtsam.Values
    ) -> list[Term]:
        """Hold the keyframe; the terms remove what the prior spuriously holds on the held directions."""
        terms = removing_terms(prior, POSE.key(number), self.directions(T_world_body), values)
        self._hold(number, T_world_body, covariance)
        return terms

    def replace(self, number: int, T_world_body: Array, held: Array, covariance: Array) -> list[Term]:
        """Hold the keyframe; the prior is on what is not held."""
        self._hold(number, T_world_body, held + covariance)
        return self._prior(number, T_world_body, covariance)

    def covariance_at(self, T_world_body: Array, T_world_held: Array) -> Array:
        """That of the held directions, moved to the pose."""
        moved = se3.adjoint(se3.inverse(T_world_body) @ T_world_held)
        return np.asarray(moved @ self.covariance @ moved.T)

    def _hold(self, number: int, T_world_body: Array, covariance: Array) -> None:
        directions = self.directions(T_world_body)
        across = directions @ directions.T
        self.covariance = across @ covariance @ across
        noise = _HELD**2 * across + _OPEN**2 * (np.eye(POSE.dimensions) - across)
        self.term = factors.pose_prior(number, T_world_body, noise)

    def _prior(self, number: int, T_world_body: Array, covariance: Array) -> list[Term]:
        return []


class GravityGauge(HeldGauge):
    """Holds the oldest keyframe's place and heading; its tilt is measured by gravity."""

    def directions(self, T_world_body: Array) -> Array:
        """Heading and position, (6, 4)."""
        directions = np.zeros((POSE.dimensions, 4))
        directions[:3, 0] = T_world_body[2, :3]
        directions[3:, 1:] = np.eye(3)
        return directions

    def _prior(self, number: int, T_world_body: Array, covariance: Array) -> list[Term]:
        """On the tilt."""
        directions = self.directions(T_world_body)
        across = directions @ directions.T
        tilt = np.eye(POSE.dimensions) - across
        return [factors.pose_prior(number, T_world_body, tilt @ covariance @ tilt + _OPEN**2 * across)]


class GlobalGauge:
    """Holds nothing: the window keeps its information on the world, which begins with a given marginal."""

    def __init__(self) -> None:
        self.term: Term | None = None
        self.covariance = np.zeros((POSE.dimensions, POSE.dimensions))

    def begin(self, number: int, T_world_body: Array, covariance: Array) -> tuple[list[Term], Array]:
        """The prior is the given marginal."""
        return [factors.pose_prior(number, T_world_body, covariance)], covariance

    def pass_on(
        self, number: int, T_world_body: Array, covariance: Array, prior: Sequence[Term], values: gtsam.Values
    ) -> list[Term]:
        """The marginal prior stays as it is."""
        return []

    def replace(self, number: int, T_world_body: Array, held: Array, covariance: Array) -> list[Term]:
        """A prior on the pose."""
        return [factors.pose_prior(number, T_world_body, covariance)]

    def covariance_at(self, T_world_body: Array, T_world_held: Array) -> Array:
        """None: the window's own covariance is complete."""
        return self.covariance

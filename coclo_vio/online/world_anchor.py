# SPDX-License-Identifier: BSD-3-Clause
"""The world of the outputs: estimates moved to a world in which the body has a given pose at a given time.

No sensor measures where the origin is and where x points; with gravity these are all four. They can be chosen, with any
uncertainty, without a change of the estimator. With ``N`` the basis of these directions in the body frame at the anchor
(6, k), ``C`` the covariance given and ``P`` the estimator's at the anchor, an estimate later has

    covariance + G (N^T C N - N^T P N) G^T,   G = [Ad(T_now^-1 T_anchor) N; velocity],

its own covariance less what it knew of the anchor, plus what is known of it now. ``P`` is taken to have come before
everything since; where an estimator corrects its past (vision) that is approximate, and the result is kept positive.
"""

from dataclasses import dataclass, replace

import numpy as np

from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.estimates import StateEstimate

_ORTHONORMAL = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class _Term:
    """A covariance of the world: of directions ``basis`` (6, k) at a pose of the body in the world of the outputs."""

    T_world_body: Array
    basis: Array
    covariance: Array


class WorldAnchor:
    """Moves estimates to the world of the outputs; as they are until ``anchor`` or ``widen``."""

    def __init__(self, *, is_levelled: bool) -> None:
        """Take the estimator's kind of world.

        Args:
            is_levelled: whether gravity determines roll and pitch, so that only position and heading can be chosen.
        """
        self._is_levelled = is_levelled
        self._T_output_world: Array = np.eye(4)
        self._terms: list[_Term] = []

    def anchor(self, state: StateEstimate, T_world_body: Array, covariance: Array) -> None:
        """Choose the world in which a state of the estimator has this pose.

        Args:
            state: as the estimator gave it.
            T_world_body: the pose that it is to have, (4, 4); roll and pitch stay where gravity determines them.
            covariance: of its right/local error, (6, 6).
        """
        here = state.nav.T_world_body
        moved = np.asarray(T_world_body @ se3.inverse(here))
        basis = np.eye(6)
        if self._is_levelled:
            turn = float(so3.yaw(T_world_body[:3, :3]) - so3.yaw(here[:3, :3]))
            rotation = so3.about_z(turn)
            moved = se3.transform(rotation, T_world_body[:3, 3] - rotation @ here[:3, 3])
            basis = np.zeros((6, 4))
            basis[:3, 0] = here[2, :3]
            basis[3:, 1:] = np.eye(3)
        self._T_output_world = moved
        known = basis.T @ (covariance - state.covariance[:6, :6]) @ basis
        self._terms = [_Term(np.asarray(moved @ here), basis, known)]

    def widen(self, T_world_body: Array, covariance: Array) -> None:
        """From a pose of the body on, in the world of the outputs, everything is less certain by this, (6, 6)."""
        self._terms.append(_Term(T_world_body, np.eye(6), covariance))

    @property
    def is_moved(self) -> bool:
        """Whether estimates do not stay as they are."""
        return bool(self._terms)

    @property
    def T_output_world(self) -> Array:
        """The estimator's world in that of the outputs, (4, 4)."""
        return self._T_output_world

    def moved(self, state: StateEstimate) -> StateEstimate:
        """A state in the world of the outputs."""
        if not self._terms:
            return state
        T_output_world, nav = self._T_output_world, state.nav
        rotation = T_output_world[:3, :3]
        T_world_body = np.asarray(T_output_world @ nav.T_world_body)
        velocity = rotation @ nav.velocity_world
        turned = np.eye(9)
        turned[6:, 6:] = rotation
        covariance = turned @ state.covariance @ turned.T
        for term in self._terms:
            along = np.zeros((9, term.basis.shape[1]))
            along[:6] = se3.adjoint(se3.inverse(T_world_body) @ term.T_world_body) @ term.basis
            along[6:] = -so3.hat(velocity) @ term.T_world_body[:3, :3] @ term.basis[:3]
            covariance = covariance + along @ term.covariance @ along.T
        feet = state.feet
        if feet is not None:
            feet = replace(feet, position_world=feet.position_world @ rotation.T + T_output_world[:3, 3])
        moved = replace(nav, T_world_body=T_world_body, velocity_world=velocity)
        return replace(state, nav=moved, covariance=_positive(covariance), feet=feet)


def _positive(covariance: Array) -> Array:
    """The nearest covariance without negative eigenvalues."""
    symmetric = 0.5 * (covariance + covariance.T)
    values, vectors = np.linalg.eigh(symmetric)
    if values[0] >= 0.0:
        return np.asarray(symmetric)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def checked_pose(T_world_body: Array, covariance: Array | None) -> tuple[Array, Array]:
    """A pose and its covariance that were given, as arrays; a covariance of zero where none is given.

    Raises:
        ConfigError: it is no pose, or no covariance.
    """
    pose = np.array(T_world_body, dtype=np.float64)
    if pose.shape != (4, 4) or not np.isfinite(pose).all() or np.abs(pose[3] - [0.0, 0.0, 0.0, 1.0]).max() > 0.0:
        raise ConfigError(f"pose must be T_world_body, a finite (4, 4) with last row 0 0 0 1, got {pose.tolist()}")
    rotation = pose[:3, :3]
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > _ORTHONORMAL or np.linalg.det(rotation) < 0.0:
        raise ConfigError(
            f"the rotation of pose must be orthonormal and right-handed to {_ORTHONORMAL:g}, got {rotation.tolist()}; "
            "normalise the quaternion that it was made of"
        )
    given = np.zeros((6, 6)) if covariance is None else np.array(covariance, dtype=np.float64)
    if given.shape != (6, 6) or not np.isfinite(given).all() or np.linalg.eigvalsh(0.5 * (given + given.T))[0] < -1e-12:
        raise ConfigError(
            "covariance must be (6, 6) of [rotation rad, position m], finite and without negative eigenvalues, got "
            f"shape {given.shape}"
        )
    return pose, 0.5 * (given + given.T)

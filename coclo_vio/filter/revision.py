# SPDX-License-Identifier: BSD-3-Clause
"""Revisions of a filter's state that no measurement of its own gives: another prior, a step of the gyroscope's bias.

A prior ``N(c0, S0)`` on constants ``c`` that has proven wrong is replaced by ``N(c1, S1)``, after any number of
measurements. In information form that adds ``S1^-1 - S0^-1`` to the block of ``c``; with the covariance ``P`` of all
errors, ``C = P_cc`` and the columns ``P_c`` that is, with ``W = (S0^-1 - S1^-1)^-1``,

    P' = P + P_c (W - C)^-1 P_c^T,   x' = x + P'_c (S1^-1 (c1 - c) - S0^-1 (c0 - c)),

exact in a linear system: the state is as if the new prior had held from the start. ``C <= S0 < W`` holds as long as
only measurements have changed ``C``; rounding is bounded.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.state import POSITION, RATE, ROTATION, VELOCITY, State
from coclo_vio.filter.unscented_transform import lower_factor
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array

_LEAST_SIGMA = 1e-5  # of a prior that can be replaced; below, what it is on counts as known
_MOST_KEPT = 1.0 - 1e-6  # of the prior's variance, after measurements
_LEAST_WIDER = 1.001  # times the variance of the prior that is replaced
_VELOCITY_SIGMA_MPS, _RATE_SIGMA_RADPS, _FOOT_SIGMA_M = 0.05, 0.02, 0.005  # of a filter that resumes


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """A Gaussian prior on some constants of the state.

    Attributes:
        mean: (k,).
        covariance: (k, k).
    """

    mean: Array
    covariance: Array

    @property
    def is_known(self) -> bool:
        """Whether it says that the constants are known, and not to be estimated."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance)[0])) < _LEAST_SIGMA


def replaced_prior(covariance: Array, at: slice, value: Array, before: Prior, after: Prior) -> tuple[Array, Array]:
    """What replacing the prior of some constants adds: columns ``U`` (L, k) with ``P' = P + U U^T``, and a step (L,).

    Args:
        covariance: of all errors, (L, L).
        at: the errors of the constants.
        value: of the constants now, (k,).
        before: the prior that holds; not one that says they are known.
        after: a wider one that replaces it; along an axis on which it is not wider, only its mean does.
    """
    root = np.linalg.cholesky(before.covariance)
    whiten = np.linalg.inv(root)
    kept, axes = np.linalg.eigh(whiten @ covariance[at, at] @ whiten.T)
    explained = (axes * np.minimum(kept, _MOST_KEPT)) @ axes.T
    spread, directions = np.linalg.eigh(whiten @ after.covariance @ whiten.T)
    spread = np.maximum(spread, _LEAST_WIDER)
    new = whiten.T @ (directions / spread) @ directions.T @ whiten
    wider = (directions * (spread / (spread - 1.0))) @ directions.T
    gain = whiten.T @ np.linalg.inv(wider - explained) @ whiten
    columns = covariance[:, at] @ np.linalg.cholesky(0.5 * (gain + gain.T))
    of_constants = covariance[:, at] + columns @ columns[at].T
    old = whiten.T @ whiten
    return columns, of_constants @ (new @ (after.mean - value) - old @ (before.mean - value))


def replace_prior(core: SquareRootFilter, name: str, before: Prior, after: Prior) -> None:
    """Replace the prior of the first constants of a plain block of the state, in all states that depend on them."""
    start = core.mean.layout.at(name).start
    at = slice(start, start + len(before.mean))
    factor = core.factor
    columns, step = replaced_prior(factor @ factor.T, at, core.mean.vector[at], before, after)
    core.factor = lower_factor(np.concatenate((factor.T, columns.T)))
    core.mean = core.mean.corrected(step)


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """The state of a filter at one time.

    Attributes:
        mean: the mean.
        factor: lower factor of the covariance of all errors, (L, L).
    """

    mean: State
    factor: Array

    @classmethod
    def of(cls, core: SquareRootFilter) -> Self:
        """The present one."""
        return cls(core.mean, core.factor.copy())


def shift_gyroscope(core: SquareRootFilter, bias: Array, sigma: float) -> None:
    """Set the gyroscope's bias anew, rad/s, body frame, (3,), with a sigma beyond what the filter has.

    The body's rate changes with it.
    """
    bias_at = core.mean.layout.at("gyroscope_bias")
    step = np.zeros(core.mean.layout.dimension)
    step[bias_at] = bias - core.mean.vector[bias_at]
    step[RATE] = -step[bias_at]
    rows = np.zeros((3, len(step)))
    rows[:, bias_at], rows[:, RATE] = sigma * np.eye(3), -sigma * np.eye(3)
    core.factor = lower_factor(np.concatenate((core.factor.T, rows)))
    core.mean = core.mean.corrected(step)


def resume_from(
    core: SquareRootFilter, before: Snapshot, T_world_body: Array, pose_sigmas: tuple[float, float]
) -> None:
    """Go on from an earlier state, at a pose that something else measured: what came meanwhile led the filter astray.

    Biases, slip and scales are those before; velocity, rate and feet are as they are now in axes of the body, feet and
    velocity with large sigmas. Right-invariant errors of a pose stay as they are when the body moves on.

    Args:
        core: the filter; poses that it remembers are void.
        before: its earlier state.
        T_world_body: the pose now, (4, 4).
        pose_sigmas: of the motion since that state: rotation, rad, and position, m, each axis.
    """
    now, layout = core.mean, core.mean.layout
    rotation, position = T_world_body[:3, :3], T_world_body[:3, 3]
    turn, vector = rotation @ now.rotation.T, before.mean.vector.copy()
    vector[POSITION], vector[VELOCITY], vector[RATE] = position, turn @ now.vector[VELOCITY], now.vector[RATE]
    vector[layout.feet] = ((now.feet - now.vector[POSITION]) @ turn.T + position).ravel()
    factor = before.factor.copy()
    factor[VELOCITY] = factor[RATE] = 0.0
    factor[layout.feet] = np.tile(factor[POSITION], (layout.legs, 1))
    rows = np.zeros((12 + 3 * layout.legs, layout.dimension))
    rows[:3, ROTATION] = pose_sigmas[0] * np.eye(3)
    rows[:3, POSITION] = pose_sigmas[0] * so3.hat(position).T  # the body turns about its own position
    rows[3:6, POSITION] = pose_sigmas[1] * np.eye(3)
    rows[:6, layout.feet] = np.tile(rows[:6, POSITION], layout.legs)
    rows[6:9, VELOCITY], rows[9:12, RATE] = _VELOCITY_SIGMA_MPS * np.eye(3), _RATE_SIGMA_RADPS * np.eye(3)
    rows[12:, layout.feet] = _FOOT_SIGMA_M * np.eye(3 * layout.legs)
    core.mean = State(layout, rotation, vector, before.mean.remembered)
    core.factor = lower_factor(np.concatenate((factor.T, rows)))

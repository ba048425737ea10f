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

import numpy as np

from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.state import POSITION, RATE, ROTATION
from coclo_vio.filter.unscented_transform import lower_factor
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array

_LEAST_SIGMA = 1e-5  # of a prior that can be replaced; below, what it is on counts as known
_MOST_KEPT = 1.0 - 1e-6  # of the prior's variance, after measurements


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
        after: a wider one that replaces it.
    """
    root = np.linalg.cholesky(before.covariance)
    whiten = np.linalg.inv(root)
    kept, axes = np.linalg.eigh(whiten @ covariance[at, at] @ whiten.T)
    explained = (axes * np.minimum(kept, _MOST_KEPT)) @ axes.T
    new = np.linalg.inv(after.covariance)
    wider = np.linalg.inv(np.eye(len(root)) - root.T @ new @ root)
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


def step_gyroscope(
    core: SquareRootFilter, bias: Array, sigma: float, T_world_body: Array, pose_sigmas: tuple[float, float]
) -> None:
    """Set the gyroscope's bias anew, and the pose: the filter has moved on with the wrong bias.

    Velocity and feet relative to the body stay as they are in its axes, as do poses that are remembered in the world.

    Args:
        core: the filter.
        bias: rad/s, body frame, (3,); the rate changes with it.
        sigma: of each axis, rad/s, beyond what the filter has.
        T_world_body: the pose as it should be, (4, 4).
        pose_sigmas: of its rotation, rad, and position, m, each axis, beyond what the filter has.
    """
    mean = core.mean
    layout, vector = mean.layout, mean.vector
    bias_at, position = layout.at("gyroscope_bias"), vector[POSITION]
    turn = so3.log(T_world_body[:3, :3] @ mean.rotation.T)
    step = np.zeros(layout.dimension)
    step[bias_at] = bias - vector[bias_at]
    step[RATE] = -step[bias_at]
    step[ROTATION] = turn
    step[POSITION] = so3.exp(-turn) @ T_world_body[:3, 3] - position  # feet move along with the body
    step[layout.feet] = np.tile(step[POSITION], layout.legs)
    rotation_sigma, position_sigma = pose_sigmas
    rows = np.zeros((9, layout.dimension))
    rows[:3, bias_at], rows[:3, RATE] = sigma * np.eye(3), -sigma * np.eye(3)
    rows[3:6, ROTATION] = rotation_sigma * np.eye(3)
    rows[3:6, POSITION] = rotation_sigma * so3.hat(position).T
    rows[6:, POSITION] = position_sigma * np.eye(3)
    rows[:, layout.feet] = np.tile(rows[:, POSITION], layout.legs)
    core.factor = lower_factor(np.concatenate((core.factor.T, rows)))
    core.mean = mean.corrected(step)

# SPDX-License-Identifier: BSD-3-Clause
"""Leg odometry between two keyframes as a factor: the filter runs from one keyframe's state, whose prior is removed.

At a keyframe the filter takes over a state with its covariance ``P_0`` and remembers it beside the present one. At the
next keyframe the joint covariance of remembered state ``a`` and present state ``b`` gives what was measured meanwhile:

    b given a      b - Phi (a - m_a) ~ N(0, Q),  Phi = P_ba P_aa^-1,  Q = P_bb - Phi P_ab
    on a alone     information P_aa^-1 - P_0^-1, vector P_aa^-1 m_a

On a linear model both are exact and independent of ``P_0``, which only spreads the sigma points and opens the gates.
Since ``a`` and ``b`` are the filter's full states, footholds that stand across a keyframe and readings of its stamp are
in one factor only. A shift of the world or a rotation about the vertical is not measured. With feet relative to the
body the right-invariant errors carry it unchanged, so its columns are known and set: ``Phi`` the identity, the
information zero.
Source: Forster et al. 2017 (preintegration); derivatives by statistical linearisation.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from coclo_vio.filter.passive_states import PassiveStates
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.state import BODY_ERRORS, POSITION, RATE, ROTATION, VELOCITY, State
from coclo_vio.filter.state_blocks import KNOWN_SIGMA, ZERO_SIGMA, StateBlock
from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.leg_motion import LegMotion, LegState

START = "start"
_KNOWN = 1e-10  # sigma at the filter's start below which a state is known and no state of a keyframe
_FLOOR = 1e-6  # least sigma that is added to every state, in its own unit, so that the covariances have inverses
_FLOOR_SHARE = 5e-4  # the same as a share of the sigma at the start of what has a prior of its own: biases, slip
_LEAST_INFORMATION = 1e-7  # share of the prior's information below which a direction counts as not measured

Extrapolation = Callable[[int], tuple[float, tuple[float, float]]]


def start_block(legs: int) -> StateBlock:
    """The remembered state of a keyframe, as a block of the robust profile's state for a number of legs."""
    return StateBlock(START, BODY_ERRORS + 3 * legs, sigma=ZERO_SIGMA, is_passive=True)


class LegPreintegration:
    """A filter's states at keyframes, and what it measures between them.

    Args:
        core: the filter that has started, with the block of ``start_block``.
        extrapolation: from a frame's stamp to the time from the last sample on, s, and sigmas of what the body may
            do beyond constant velocity until then, rad and m.
    """

    def __init__(self, core: SquareRootFilter, extrapolation: Extrapolation) -> None:
        self._core, self._extrapolation = core, extrapolation
        layout = core.mean.layout
        sigmas = layout.sigmas(is_moving=False)[: layout.active]
        used = np.flatnonzero(sigmas > _KNOWN)
        pose = np.r_[ROTATION, POSITION]
        self._legs: IntArray = np.setdiff1d(used, pose)
        self._used: IntArray = np.concatenate((pose, self._legs))
        self._unmeasured = (2, 3, 4, 5)  # heading and position among the used errors
        relative = np.eye(layout.active)  # the filter's errors with feet relative to the body
        relative[layout.feet, POSITION] = np.tile(-np.eye(3), (layout.legs, 1))
        self._relative = relative[np.ix_(self._used, self._used)]
        self._floor = np.maximum(_FLOOR, _FLOOR_SHARE * sigmas[self._used])
        self._floor[:6] = _FLOOR
        self._start: LegState | None = None
        self._prior_factor = np.eye(len(self._used))
        self._to_start = np.eye(len(self._used))

    def state(self, stamp_ns: int) -> LegState:
        """The filter's state at a frame, from the last sample on with constant rate and velocity."""
        dt_s, noise = self._extrapolation(stamp_ns)
        mean = self._core.mean
        T_world_body = _frame_pose(mean, dt_s)
        to_local = self._to_local(mean, dt_s)
        rows = to_local @ self._relative @ self._core.active_factor[self._used]
        covariance = rows @ rows.T + self._noise(noise)
        return LegState(stamp_ns, T_world_body, self._legs_of(mean, T_world_body), covariance)

    def restart(self, state: LegState) -> None:
        """Take over the state at a frame; from now on motion is measured from there."""
        core, (dt_s, noise) = self._core, self._extrapolation(state.stamp_ns)
        mean = self._mean_of(state, dt_s)
        self._to_start = self._to_local(mean, dt_s)
        back = np.linalg.inv(self._to_start @ self._relative)
        beyond = np.diag(np.concatenate((np.repeat(np.square(noise), 3), np.zeros(len(self._legs)))))
        covariance = back @ (state.covariance + beyond) @ back.T
        order = np.argsort(self._used)  # the filter's factor is lower in its own order
        in_order = np.ix_(self._used[order], self._used[order])
        factor = np.diag(np.full(len(core.active_factor), KNOWN_SIGMA))
        factor[in_order] = _lower(covariance[np.ix_(order, order)])
        joint = factor @ factor.T
        self._prior_factor = _lower(self._relative @ joint[np.ix_(self._used, self._used)] @ self._relative.T)
        core.mean, core.passive = mean, PassiveStates(joint.copy(), joint)
        core.replace_active(factor)
        self._start = state

    def motion(self, stamp_ns: int) -> LegMotion:
        """What was measured from the last ``restart`` on to a frame."""
        assert self._start is not None, "restart() comes first"
        core, (dt_s, noise) = self._core, self._extrapolation(stamp_ns)
        used, relative, end = self._used, self._relative, self.state(stamp_ns)
        to_end = self._to_local(core.mean, dt_s)
        back, to_back = np.linalg.inv(self._to_start), np.linalg.inv(to_end)
        cross = relative @ core.passive.cross[np.ix_(used, used)] @ relative.T
        own = relative @ core.passive.own[np.ix_(used, used)] @ relative.T
        rows = relative @ core.active_factor[used]
        measured = between(
            self._prior_factor,
            own,
            cross,
            rows @ rows.T,
            relative @ core.mean.vector[core.mean.layout.at(START)][used],
            noise=to_back @ self._noise(noise) @ to_back.T,
            unmeasured=self._unmeasured,
        )
        size = len(used)
        in_local = np.concatenate((measured.rows[:, :size] @ back, measured.rows[:, size:] @ to_back), axis=1)
        return LegMotion(
            self._start,
            end,
            in_local,
            measured.values,
            core.mean.vector[VELOCITY],
            self._motion_covariance(end, own, cross, to_end),
        )

    def _motion_covariance(self, end: LegState, own: Array, cross: Array, to_end: Array) -> Array:
        """Of the motion between the poses, right/local, (6, 6)."""
        assert self._start is not None
        T_start_end = se3.inverse(self._start.T_world_body) @ end.T_world_body
        before, after = self._to_start[:6], to_end[:6]
        back = -se3.adjoint(se3.inverse(T_start_end))
        mixed = after @ cross @ before.T @ back.T
        return np.asarray(back @ before @ own @ before.T @ back.T + mixed + mixed.T + end.covariance[:6, :6])

    def _noise(self, beyond: tuple[float, float]) -> Array:
        """Covariance of what the body does beyond constant velocity until a frame, and a floor, (n, n)."""
        variances = np.square(self._floor)
        variances[:6] += np.repeat(np.square(beyond), 3)
        return np.diag(variances)

    def _legs_of(self, mean: State, T_world_body: Array) -> Array:
        """The states of a keyframe besides its pose: velocity and feet in body axes at the frame, the others as is."""
        to_body, vector = T_world_body[:3, :3].T, mean.vector.copy()
        vector[VELOCITY] = to_body @ vector[VELOCITY]
        feet = (mean.feet - T_world_body[:3, 3]) @ to_body.T
        vector[mean.layout.feet] = feet.ravel()
        return np.asarray(vector[self._legs])

    def _mean_of(self, state: LegState, dt_s: float) -> State:
        """The filter's state at its last sample; the inverse of ``state``."""
        layout, vector = self._core.mean.layout, self._core.mean.vector.copy()
        R, position = state.T_world_body[:3, :3], state.T_world_body[:3, 3]
        vector[self._legs] = state.legs
        vector[VELOCITY] = R @ vector[VELOCITY]
        vector[layout.feet] = (vector[layout.feet].reshape(-1, 3) @ R.T + position).ravel()
        vector[POSITION] = position - vector[VELOCITY] * dt_s
        vector[layout.at(START)] = 0.0
        return State(layout, R @ so3.exp(-vector[RATE] * dt_s), vector, self._core.mean.remembered)

    def _to_local(self, mean: State, dt_s: float) -> Array:
        """d(errors of a keyframe's state) / d(used errors of the filter, feet relative to the body), (n, n)."""
        layout = mean.layout
        T_world_body = _frame_pose(mean, dt_s)
        to_body = T_world_body[:3, :3].T
        turning = so3.right_jacobian(mean.vector[RATE] * dt_s) * dt_s
        full = np.eye(layout.active)
        full[ROTATION, ROTATION], full[ROTATION, RATE] = to_body, turning
        full[POSITION, ROTATION] = -to_body @ so3.hat(T_world_body[:3, 3])
        full[POSITION, POSITION], full[POSITION, VELOCITY] = to_body, to_body * dt_s
        full[VELOCITY, VELOCITY] = to_body
        full[VELOCITY, RATE] = so3.hat(to_body @ mean.vector[VELOCITY]) @ turning
        for leg, foot in enumerate(mean.feet):
            at = slice(layout.feet.start + 3 * leg, layout.feet.start + 3 * leg + 3)
            full[at, at] = to_body
            full[at, VELOCITY] = -to_body * dt_s
            full[at, RATE] = so3.hat(to_body @ (foot - T_world_body[:3, 3])) @ turning
        return full[np.ix_(self._used, self._used)]


@dataclass(frozen=True, slots=True, eq=False)
class Between:
    """``rows @ [a, b] = values + N(0, 1)`` of the errors of an earlier and a later state, (r, 2 n) and (r,)."""

    rows: Array
    values: Array


def between(
    prior_factor: Array,
    own: Array,
    cross: Array,
    present: Array,
    mean: Array,
    *,
    noise: Array,
    unmeasured: Sequence[int] = (),
) -> Between:
    """What a filter measured between two states, its prior on the earlier one removed.

    Args:
        prior_factor: lower factor of the prior of the earlier state, whose mean is zero, (n, n).
        own: covariance of the earlier state now, (n, n).
        cross: covariance of the present state with the earlier one, (n, n).
        present: covariance of the present state, about its mean, (n, n).
        mean: of the earlier state now, (n,).
        noise: covariance that is added to the present state given the earlier one, (n, n).
        unmeasured: directions of the state that nothing measures, and that the present state has unchanged.
    """
    size = len(own)
    whiten = solve_triangular(prior_factor, np.eye(size), lower=True)
    posterior = np.linalg.inv(_symmetric(whiten @ own @ whiten.T))
    transition = cross @ whiten.T @ posterior @ whiten
    remaining = _symmetric(present - transition @ cross.T + noise)
    information = whiten.T @ (posterior - np.eye(size)) @ whiten
    vector = whiten.T @ posterior @ whiten @ mean
    for each in unmeasured:
        transition[:, each] = np.eye(size)[each]
        information[each] = information[:, each] = vector[each] = 0.0
    conditional = np.linalg.inv(_lower(remaining))
    later = conditional @ np.concatenate((-transition, np.eye(size)), axis=1)
    scales = np.sqrt(np.sum(np.square(prior_factor), axis=1))
    values, axes = np.linalg.eigh(_symmetric(scales[:, None] * information * scales))
    kept = values > _LEAST_INFORMATION
    root, directions = np.sqrt(values[kept]), axes[:, kept].T
    earlier = np.concatenate((root[:, None] * directions / scales, np.zeros((len(root), size))), axis=1)
    measured = -conditional @ transition @ mean, directions @ (scales * vector) / root
    return Between(np.concatenate((later, earlier)), np.concatenate(measured))


def _frame_pose(mean: State, dt_s: float) -> Array:
    """``T_world_body`` at a frame, (4, 4)."""
    rotation = mean.rotation @ so3.exp(mean.vector[RATE] * dt_s)
    return se3.transform(rotation, mean.vector[POSITION] + mean.vector[VELOCITY] * dt_s)


def _symmetric(matrix: Array) -> Array:
    return np.asarray(0.5 * (matrix + matrix.T))


def _lower(covariance: Array) -> Array:
    """Lower factor of a covariance, whose correlations may by rounding not be positive definite."""
    scales = np.sqrt(covariance.diagonal())
    correlation = _symmetric(covariance / np.outer(scales, scales))
    values, axes = np.linalg.eigh(correlation)
    bounded = (axes * np.maximum(values, 1e-13)) @ axes.T
    return np.asarray(scales[:, None] * np.linalg.cholesky(_symmetric(bounded)))

# SPDX-License-Identifier: BSD-3-Clause
"""Low-passed angular velocity of a body, and its correlation with another's under a clock: used by ``clock``."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.signal import correlate
from scipy.spatial.transform import Rotation

from coclo_vio.evaluation.association import gaps_ns
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array, BoolArray, IntArray
from coclo_vio.values.trajectory import Trajectory
from coclo_vio.values.units import NS_PER_S

STEPS_PER_WINDOW = 10
_KNOTS_PER_WINDOW = 20
_TRACE_NEAR_PI = 1.0 + 2.0 * np.cos(3.0)


@dataclass(frozen=True, slots=True, eq=False)
class SteadyTurns:
    """Attitudes over time, from each knot to the next one at a steady angular velocity.

    Attributes:
        times: of the knots, increasing, (K,).
        rotations: at all knots but the last, ``R_world_body``, (K - 1, 3, 3).
        rotvecs: from each of these to the next one, rad, body axes, (K - 1, 3).
    """

    times: Array
    rotations: Array
    rotvecs: Array

    @classmethod
    def through(cls, times: Array, rotations: Array) -> Self:
        """Through attitudes (K, 3, 3) at increasing times (K,), at least two."""
        knots = Rotation.from_matrix(rotations)
        return cls(np.asarray(times), knots[:-1].as_matrix(), (knots[:-1].inv() * knots[1:]).as_rotvec())

    def at(self, times: Array) -> Array:
        """``R_world_body`` at times, the nearest end's outside, (N, 3, 3)."""
        inside = np.clip(times, self.times[0], self.times[-1])
        before = np.clip(np.searchsorted(self.times, inside) - 1, 0, None)
        share = (inside - self.times[before]) / (self.times[before + 1] - self.times[before])
        return np.asarray(self.rotations[before] @ so3.exp(self.rotvecs[before] * share[:, None]))


@dataclass(frozen=True, slots=True, eq=False)
class AngularMotion:
    """Attitude over time: ``rate`` knots per second, and the holes between which it is unknown.

    Attributes:
        at: attitude at a time in knots' units.
        rate: units of the knots per second; 1 where they are seconds.
        span_s: first and last time, s.
        gaps_s: (K, 2) holes, s.
    """

    at: SteadyTurns
    rate: float
    span_s: tuple[float, float]
    gaps_s: Array

    def grid(self, step_s: float) -> Array:
        """Times all over the span, ``step_s`` apart."""
        return np.arange(self.span_s[0], self.span_s[1], step_s)

    def attitudes(self, times_s: Array) -> Rotation:
        """``R_world_body`` at times inside the span."""
        return Rotation.from_matrix(self.at.at(times_s * self.rate))

    def rates(self, times_s: Array, window_s: float) -> tuple[Array, BoolArray]:
        """Mean angular velocity, rad/s, body frame, (N, 3), over windows centred at ``times_s``; zero where unknown."""
        before, after = times_s - 0.5 * window_s, times_s + 0.5 * window_s
        is_known = (before >= self.span_s[0]) & (after <= self.span_s[1])
        for start_s, end_s in self.gaps_s:
            is_known &= (after <= start_s) | (before >= end_s)
        rates = np.zeros((len(times_s), 3))
        if is_known.any():
            start, end = (self.at.at(times_s[is_known] * self.rate) for times_s in (before, after))
            rates[is_known] = _rotvecs(np.swapaxes(start, 1, 2) @ end) / window_s
        return rates, is_known


def stamped_motion(
    trajectory: Trajectory, stamps_ns: IntArray, start_ns: int, window_s: float, max_gap_s: float
) -> AngularMotion:
    """Attitudes over seconds since ``start_ns``, thinned to what a low-pass of ``window_s`` resolves."""
    times_s = (stamps_ns - start_ns) / NS_PER_S
    cell = np.floor((times_s - times_s[0]) * (_KNOTS_PER_WINDOW / window_s))
    keep = np.flatnonzero(np.append(True, np.diff(cell) > 0) | (np.arange(len(times_s)) == len(times_s) - 1))
    at = SteadyTurns.through(times_s[keep], trajectory.rotations[keep])
    gaps_s = (gaps_ns(stamps_ns, max_gap_s) - start_ns) / NS_PER_S
    return AngularMotion(at, 1.0, (float(times_s[0]), float(times_s[-1])), gaps_s)


def numbered_motion(at: SteadyTurns, rate_hz: float) -> AngularMotion:
    """Attitudes of rows at an even rate, the first at time zero."""
    return AngularMotion(at, rate_hz, (0.0, float(at.times[-1]) / rate_hz), np.zeros((0, 2)))


def _rotvecs(rotations: Array) -> Array:
    """Rotation vectors (N, 3) of rotations (N, 3, 3), most of them small."""
    rotvecs = so3.log_below_pi(rotations)
    is_near_pi = np.einsum("nii->n", rotations) < _TRACE_NEAR_PI
    if is_near_pi.any():
        rotvecs[is_near_pi] = so3.log(rotations[is_near_pi])
    return rotvecs


def turning_score(cross: Array) -> Array:
    """``max over R of trace(R^T cross)`` for stacks (..., 3, 3): the signed sum of the singular values."""
    values = np.linalg.svd(cross, compute_uv=False)
    total: Array = values[..., 0] + values[..., 1] + np.sign(np.linalg.det(cross)) * values[..., 2]
    return total


class RateCorrelator:
    """Scores clocks of a ground truth against the angular velocity of one estimate, computed once."""

    def __init__(self, estimated: AngularMotion, window_s: float) -> None:
        self._estimated = estimated
        self._window_s = window_s
        self._step_s = window_s / STEPS_PER_WINDOW
        self._estimated_rates, _ = estimated.rates(estimated.grid(self._step_s), window_s)
        self._estimated_norm = float(np.linalg.norm(self._estimated_rates))
        self._tracked: tuple[AngularMotion, int, tuple[Array, Array, BoolArray]] | None = None

    def best_shift(self, tracked: AngularMotion, limits_s: tuple[float, float]) -> tuple[float, float]:
        """The shift of ``tracked``'s clock, s, within limits, and its score, on a grid of a tenth of the window."""
        tracked_rates, _ = tracked.rates(tracked.grid(self._step_s), self._window_s)
        norm = self._estimated_norm * float(np.linalg.norm(tracked_rates))
        lags = np.arange(-(len(tracked_rates) - 1), len(self._estimated_rates))
        shifts_s = self._estimated.span_s[0] - tracked.span_s[0] + lags * self._step_s
        is_allowed = (shifts_s >= limits_s[0]) & (shifts_s <= limits_s[1])
        if norm == 0.0 or not is_allowed.any():
            return 0.0, 0.0
        pairs = [[correlate(row, column)[is_allowed] for column in tracked_rates.T] for row in self._estimated_rates.T]
        scores = turning_score(np.moveaxis(np.array(pairs), -1, 0)) / norm
        best_index = int(np.argmax(scores))
        return float(shifts_s[is_allowed][best_index]), float(scores[best_index])

    def samples_for(self, tracked: AngularMotion) -> int:
        """How many samples ``correlation`` takes of this ground truth: fixed in a search, so that it is smooth."""
        return max(2, int((tracked.span_s[1] - tracked.span_s[0]) / self._step_s) + 1)

    def correlation(self, tracked: AngularMotion, shift_s: float, samples: int) -> float:
        """Correlation over the overlap under one clock, the estimate's rates taken exactly at the shifted times.

        Unlike the score of ``best_shift`` it has no bias towards more overlap, so its peak is unbiased; it is
        meaningful near the right clock only.
        """
        grid, tracked_rates, is_tracked = self._rates_of(tracked, samples)
        estimated_rates, is_estimated = self._estimated.rates(grid + shift_s, self._window_s)
        return correlation(estimated_rates[is_estimated & is_tracked], tracked_rates[is_estimated & is_tracked]) or 0.0

    def _rates_of(self, tracked: AngularMotion, samples: int) -> tuple[Array, Array, BoolArray]:
        """Times and the rates then; those of the motion before are kept, as a search asks for them many times."""
        if self._tracked is None or self._tracked[0] is not tracked or self._tracked[1] != samples:
            grid = np.linspace(tracked.span_s[0], tracked.span_s[1], samples)
            self._tracked = tracked, samples, (grid, *tracked.rates(grid, self._window_s))
        return self._tracked[2]


def correlation(estimated: Array, tracked: Array) -> float | None:
    """Correlation, 0..1, of angular velocities (N, 3) under the best rotation; None where either is zero."""
    norm = float(np.linalg.norm(estimated) * np.linalg.norm(tracked))
    return float(turning_score(estimated.T @ tracked)) / norm if norm > 0.0 else None

# SPDX-License-Identifier: BSD-3-Clause
"""Stamps for a ground truth without stamps whose rows are not evenly spaced, from attitude alone.

A refinement of the even clock that ``clock`` finds, on request: the local rate of the rows may vary about the mean
rate, as slowly as its knots are spaced. It minimises

    sum over rows of |log(mean^-1 R_estimate(t_row) R R_reference^T) - drift|^2
    + stiffness^2 sum over knots of log(rate / mean rate)^2

robustly, over attitudes averaged over a second; where the body does not turn the rate is not observable and the
stiffness keeps the mean rate. Positions are not used.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from coclo_vio.evaluation.angular_motion import AngularMotion, SteadyTurns
from coclo_vio.values.arrays import Array, BoolArray, IntArray

_MOST_ROWS = 600
_OUTLIER_RAD = 0.05
_AVERAGING_S = 1.0
_AVERAGING_STEP_S = 0.05
_MOST_EVALUATIONS = 25


@dataclass(frozen=True, slots=True, eq=False)
class RowTimes:
    """Times of rows under a local rate: the first row and the logarithm of the intervals at knots, linear between.

    Attributes:
        frames: number of the frame of each row, increasing from 0, (N,); of rows that were all logged their own.
        knots: frames at which the intervals are given, (K,).
    """

    frames: IntArray
    knots: Array

    def times_s(self, values: Array) -> Array:
        """Times, s, (N,), of ``[first time, log interval of a frame at each knot]`` (1 + K,)."""
        log_interval = np.interp(0.5 * (self.frames[1:] + self.frames[:-1]), self.knots, values[1:])
        return np.asarray(values[0] + np.append(0.0, np.cumsum(np.exp(log_interval) * np.diff(self.frames))))


def refine_rows(
    estimated: AngularMotion,
    attitudes: Rotation,
    even_s: tuple[float, float],
    frames: IntArray,
    *,
    knot_s: float,
    stiffness: float,
) -> Array:
    """Times of the rows, s on the estimate's clock, (N,), increasing.

    Args:
        estimated: attitude of the estimate over time.
        attitudes: of the rows, N of them, turned to the estimate's body frame.
        even_s: time of the first row and interval of the frames, s, of the even clock.
        frames: number of the frame of each row, (N,).
        knot_s: the local rate may change over this long, s.
        stiffness: rad of attitude error that one e-fold of rate at one knot weighs as much as.
    """
    count = len(attitudes)
    knots = np.linspace(0.0, float(frames[-1]), max(2, round((frames[-1] + 1) * even_s[1] / knot_s) + 1))
    model = RowTimes(frames, knots)
    used = np.arange(0, count, max(1, count // _MOST_ROWS))
    start = np.append(even_s[0], np.full(len(knots), np.log(even_s[1])))

    # rocking is periodic, and the mounting of the tracker about the turning axis is poorly known: only turns count
    averaged = _averaged(estimated)
    inverse = _low_passed(_every_frame(frames, attitudes), max(1, round(_AVERAGING_S / even_s[1])))[frames[used]].inv()

    def residuals(values: Array) -> Array:
        times_s = model.times_s(values)[used]
        is_known = (times_s >= estimated.span_s[0]) & (times_s <= estimated.span_s[1])
        errors = attitude_errors(averaged.attitudes(np.clip(times_s, *estimated.span_s)) * inverse, times_s, is_known)
        return np.append(errors.ravel(), stiffness * (values[1:] - start[1:]))

    found = least_squares(residuals, start, loss="soft_l1", f_scale=_OUTLIER_RAD, max_nfev=_MOST_EVALUATIONS)
    return model.times_s(np.asarray(found.x))


def _every_frame(frames: IntArray, attitudes: Rotation) -> Rotation:
    """Attitudes of all frames, those without a row between their neighbours: means of rows would be of other times."""
    if frames[-1] == len(frames) - 1:
        return attitudes
    turns = SteadyTurns.through(frames.astype(np.float64), attitudes.as_matrix())
    return Rotation.from_matrix(turns.at(np.arange(float(frames[-1] + 1))))


def _averaged(estimated: AngularMotion) -> AngularMotion:
    times_s = np.linspace(
        estimated.span_s[0],
        estimated.span_s[1],
        max(2, round((estimated.span_s[1] - estimated.span_s[0]) / _AVERAGING_STEP_S)),
    )
    averaged = _low_passed(estimated.attitudes(times_s), round(_AVERAGING_S / _AVERAGING_STEP_S))
    return AngularMotion(SteadyTurns.through(times_s, averaged.as_matrix()), 1.0, estimated.span_s, estimated.gaps_s)


def _low_passed(attitudes: Rotation, width: int) -> Rotation:
    """Attitudes averaged (chordal mean) over about ``width`` neighbours: an even number would be of another time."""
    return Rotation.from_matrix(uniform_filter1d(attitudes.as_matrix(), width | 1, axis=0, mode="nearest"))


def attitude_errors(relative: Rotation, times_s: Array, is_known: BoolArray) -> Array:
    """Rotation vectors, rad, (N, 3), about the mean and a linear drift; zero where the estimate is unknown."""
    if is_known.sum() < 3:
        return np.zeros((len(times_s), 3))
    errors = (relative[is_known].mean().inv() * relative).as_rotvec()
    design = np.stack((np.ones(len(times_s)), times_s), axis=1)
    drift = np.linalg.lstsq(design[is_known], errors[is_known], rcond=None)[0]
    return np.where(is_known[:, None], errors - design @ drift, 0.0)

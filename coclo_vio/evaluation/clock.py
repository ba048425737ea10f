# SPDX-License-Identifier: BSD-3-Clause
"""The clock of the ground truth against the clock of the estimate: the first step of an evaluation.

Trackers run on a clock of their own, and some recordings hold no stamps at all. Both sides measure the same rotation of
the body: the low-passed angular velocity of the tracked body is a constant rotation of the estimate's, whatever the
worlds and however the tracker's body frame is turned. The clock is the one that maximises

    score = max over R of sum_t w_reference(t) . R w_estimate(t + offset) / (|w_reference| |w_estimate|),

whose inner maximum is the signed sum of the singular values of the 3x3 cross-covariance (Kabsch, 1976). In the search
both norms are taken over the whole signals, so turns that a clock would push out of the overlap count against it; the
last polish takes them over the overlap, which has no such bias.

Positions are never used: a clock fitted to positions would hide errors of position.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from coclo_vio.evaluation.alignment import nearest_rotation
from coclo_vio.evaluation.angular_motion import (
    STEPS_PER_WINDOW,
    AngularMotion,
    RateCorrelator,
    SteadyTurns,
    correlation,
    numbered_motion,
    stamped_motion,
)
from coclo_vio.evaluation.frame_counts import frame_numbers
from coclo_vio.evaluation.uneven_rows import attitude_errors, refine_rows
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.config import StageConfig
from coclo_vio.values.errors import EvaluationError
from coclo_vio.values.trajectory import GroundTruth, Trajectory
from coclo_vio.values.units import NS_PER_S

_RATE_STEP = 0.01
_LEAST_GAIN = 9.0  # three standard deviations


class ClockConfig(StageConfig):
    """How the clock of the ground truth is found, or what it is."""

    offset_s: Annotated[
        float | None,
        Field(description="estimate's clock minus ground truth's clock, s; estimated where null"),
    ] = None
    rate_hz: Annotated[
        float | None,
        Field(gt=0, le=1e5, description="rate of a ground truth without stamps, Hz; estimated where null"),
    ] = None
    max_offset_s: Annotated[float, Field(gt=0, le=1000, description="search within this offset either way, s")] = 10.0
    window_s: Annotated[float, Field(gt=0, le=10, description="low-pass of the angular velocity, s")] = 0.2
    rate_window_s: Annotated[
        float, Field(gt=0, le=10, description="the same where the rate is estimated too: rows are uneven then, s")
    ] = 1.5
    counts_frames: Annotated[
        bool,
        Field(
            description="count the frames between rows of a ground truth without stamps, where its motion shows them"
        ),
    ] = True
    has_uneven_rows: Annotated[
        bool | None,
        Field(
            description="let the rate of a ground truth without stamps vary, estimated from attitude alone; null: "
            "where its frames were counted, as those of a rest are unknown"
        ),
    ] = None
    knot_s: Annotated[float, Field(gt=0, le=60, description="the varying rate may change over this long, s")] = 1.5
    stiffness: Annotated[
        float, Field(gt=0, description="attitude error that weighs as much as an e-fold of rate at one knot, rad")
    ] = 1.0
    max_duration_ratio: Annotated[
        float,
        Field(
            gt=1, le=5, description="ground truth without stamps lasts this many times the estimate at most, or 1/it"
        ),
    ] = 2.0
    max_gap_s: Annotated[
        float,
        Field(gt=0, le=60, description="no interpolation across holes of a stamped ground truth longer than this, s"),
    ] = 0.25
    min_correlation: Annotated[
        float, Field(ge=0, le=1, description="below this correlation of angular velocity no clock is accepted")
    ] = 0.6
    min_rate_radps: Annotated[
        float, Field(gt=0, description="RMS of the low-passed angular velocity needed to estimate a clock, rad/s")
    ] = 0.02


@dataclass(frozen=True, slots=True)
class ClockFit:
    """The clock of the ground truth in terms of the estimate's.

    Attributes:
        offset_s: what is added to the ground truth's stamps; without stamps, to its first stamp.
        rate_hz: rate of the rows, or of the frames, of a ground truth without stamps; None where it has stamps.
        is_estimated: False where the clock was given or could not be estimated.
        correlation: of the low-passed angular velocities over the overlap, 0..1; None where nothing turns.
        residual_deg: RMS of the attitude difference that is left after a constant rotation on either side and a
            linear drift, degrees; None where the two overlap too little.
        row_stamps_ns: stamps of the rows where they were found to be uneven, ns, (N,); None elsewhere.
        counts_frames: whether the frames between rows were counted.
        problem: why the clock could not be estimated; None where it was, or was given.
    """

    offset_s: float
    rate_hz: float | None
    is_estimated: bool
    correlation: float | None
    residual_deg: float | None
    problem: str | None = None
    row_stamps_ns: IntArray | None = None
    counts_frames: bool = False

    def apply(self, reference: Trajectory) -> Trajectory:
        """The ground truth on the clock of the estimate."""
        if self.row_stamps_ns is not None:
            return reference.restamped(self.row_stamps_ns)
        return reference.restamped(_restamped_ns(reference, self.offset_s, self.rate_hz))


def fit_clock(estimate: Trajectory, truth: GroundTruth, config: ClockConfig) -> ClockFit:
    """Offset, and rate where the ground truth has no stamps, of the ground truth's clock.

    Args:
        estimate: on the clock of the evaluation.
        truth: the ground truth on its own clock; only its attitudes are used.
        config: given values, limits of the search, low-pass.

    Raises:
        EvaluationError: a ground truth without stamps whose clock cannot be found; or only one of its offset and rate
            given; or a rate given for a ground truth with stamps.
    """
    _check_given(truth, config)
    if config.offset_s is not None:
        return _fit_of(estimate, truth, config, (config.offset_s, config.rate_hz))
    problem = _why_not_observable(estimate, truth, config)
    if problem is None:
        if truth.has_stamps:
            fit = _fit_of(estimate, truth, config, _search_offset(estimate, truth.trajectory, config))
        else:
            frames = _frames_of(truth, config)
            found = _search_rate(estimate, truth.trajectory, config, frames)
            fit = _fit_of(estimate, truth, config, found, frames)
        if truth.has_stamps and (same := _if_no_better(estimate, truth, config, fit)) is not None:
            return same
        if fit.correlation is not None and fit.correlation >= config.min_correlation:
            return fit
        problem = (
            f"the angular velocities correlate by {fit.correlation or 0.0:.2f} at best, below clock.min_correlation = "
            f"{config.min_correlation:g}"
        )
    if not truth.has_stamps:
        raise EvaluationError(
            f"the clock of {truth.source}, which has no stamps, cannot be found: {problem}; "
            "set clock.offset_s and clock.rate_hz"
        )
    return ClockFit(0.0, None, False, None, None, f"clock offset taken as 0: {problem}")


def _if_no_better(estimate: Trajectory, truth: GroundTruth, config: ClockConfig, fit: ClockFit) -> ClockFit | None:
    """An offset of zero, where the estimated one is no better; None where it is better.

    A slow motion correlates over a wide range of offsets, and noise decides where its peak is. With N windows that
    share no sample and correlations ``r`` at the estimated offset and ``r_0`` at none, ``N (r^2 - r_0^2) / (1 - r^2)``
    is what the sum of squared residuals falls by, in units of its variance.
    """
    none = _fit_of(estimate, truth, config.model_copy(update={"offset_s": 0.0}), (0.0, None))
    if none.correlation is None or fit.correlation is None or none.correlation < config.min_correlation:
        return None
    span_s = min(estimate.times_s[-1], truth.trajectory.times_s[-1])
    gain = fit.correlation**2 - none.correlation**2
    if span_s / config.window_s * gain / max(1.0 - fit.correlation**2, 1e-12) > _LEAST_GAIN:
        return None
    return replace(none, is_estimated=True)


def _check_given(truth: GroundTruth, config: ClockConfig) -> None:
    if truth.has_stamps and config.rate_hz is not None:
        raise EvaluationError(
            f"clock.rate_hz = {config.rate_hz:g} is given but {truth.source} has stamps of its own; drop clock.rate_hz"
        )
    if not truth.has_stamps and (config.offset_s is None) != (config.rate_hz is None):
        raise EvaluationError(
            f"{truth.source} has no stamps: set both clock.offset_s and clock.rate_hz, or neither to estimate both"
        )


def _why_not_observable(estimate: Trajectory, truth: GroundTruth, config: ClockConfig) -> str | None:
    window_s = config.window_s if truth.has_stamps else config.rate_window_s
    for name, trajectory in (("estimate", estimate), ("ground truth", truth.trajectory)):
        is_timed = name == "estimate" or truth.has_stamps
        if len(trajectory) < 4 or (is_timed and trajectory.times_s[-1] < 2.0 * window_s):
            return f"the {name} is too short ({len(trajectory)} poses) for a window of {window_s:g} s"
    motion = stamped_motion(estimate, estimate.stamps_ns, int(estimate.stamps_ns[0]), window_s, np.inf)
    rates, is_known = motion.rates(motion.grid(window_s / STEPS_PER_WINDOW), window_s)
    rms = float(np.sqrt((rates[is_known] ** 2).sum(axis=1).mean())) if is_known.any() else 0.0
    if rms < config.min_rate_radps:
        return f"the estimate hardly turns ({rms:.3g} rad/s RMS, {config.min_rate_radps:g} needed)"
    return None


def _restamped_ns(
    reference: Trajectory, offset_s: float, rate_hz: float | None, frames: IntArray | None = None
) -> IntArray:
    shifted = reference.stamps_ns + round(offset_s * NS_PER_S)
    if rate_hz is None:
        return shifted
    frames = np.arange(len(reference)) if frames is None else frames
    return np.asarray(shifted[0] + np.rint(frames * (NS_PER_S / rate_hz)).astype(np.int64))


def _frames_of(truth: GroundTruth, config: ClockConfig) -> IntArray | None:
    """The number of the frame of each row (N,) where it is counted."""
    counts = config.counts_frames and not truth.has_stamps and config.offset_s is None
    return frame_numbers(truth.trajectory) if counts else None


def _search_offset(estimate: Trajectory, reference: Trajectory, config: ClockConfig) -> tuple[float, float | None]:
    start_ns, limit_s = int(reference.stamps_ns[0]), config.max_offset_s
    window_s = max(config.window_s, 2.0 * _spacing_s(estimate), 2.0 * _spacing_s(reference))
    estimated = stamped_motion(estimate, estimate.stamps_ns, start_ns, window_s, np.inf)
    tracked = stamped_motion(reference, reference.stamps_ns, start_ns, window_s, config.max_gap_s)
    apart_s = max(estimated.span_s[0] - tracked.span_s[1], tracked.span_s[0] - estimated.span_s[1])
    if apart_s > limit_s:
        raise EvaluationError(
            f"estimate and ground truth lie {apart_s:.3f} s apart, further than clock.max_offset_s = {limit_s:g} s; "
            "give clock.offset_s, or check that both belong to the same recording"
        )
    correlator = RateCorrelator(estimated, window_s)
    coarse_s, _ = correlator.best_shift(tracked, (-limit_s, limit_s))
    samples = correlator.samples_for(tracked)

    def loss(values: Array) -> float:
        return -correlator.correlation(tracked, float(values[0]), samples)

    best = _refined(loss, np.array([coarse_s]), np.array([window_s / STEPS_PER_WINDOW]))
    return float(np.clip(best[0], -limit_s, limit_s)), None


def _search_rate(
    estimate: Trajectory, reference: Trajectory, config: ClockConfig, frames: IntArray | None
) -> tuple[float, float | None]:
    start_ns, window_s = int(estimate.stamps_ns[0]), config.rate_window_s
    estimated = stamped_motion(estimate, estimate.stamps_ns, start_ns, window_s, np.inf)
    correlator = RateCorrelator(estimated, window_s)
    rows = np.arange(len(reference)) if frames is None else frames
    at = SteadyTurns.through(rows.astype(np.float64), reference.rotations)
    reach = np.log(config.max_duration_ratio)
    candidates_hz = rows[-1] / estimated.span_s[1] * np.exp(np.arange(-reach, reach, _RATE_STEP))
    coarse = [correlator.best_shift(numbered_motion(at, rate_hz), (-np.inf, np.inf)) for rate_hz in candidates_hz]
    best_index = int(np.argmax([score for _, score in coarse]))
    samples = correlator.samples_for(numbered_motion(at, float(candidates_hz[best_index])))

    def loss(values: Array) -> float:
        return -correlator.correlation(
            numbered_motion(at, float(candidates_hz[best_index] * values[1])), float(values[0]), samples
        )

    start = np.array([coarse[best_index][0], 1.0])
    best = _refined(loss, start, np.array([window_s / STEPS_PER_WINDOW, _RATE_STEP]))
    offset_s = best[0] + (start_ns - int(reference.stamps_ns[0])) / NS_PER_S
    return float(offset_s), float(candidates_hz[best_index] * best[1])


def _refined(loss: Callable[[Array], float], start: Array, step: Array) -> Array:
    """Nelder-Mead in units of ``step``: the correlation is smooth near its peak, yet has no handy gradient."""
    unit = np.vstack((np.zeros(len(start)), np.eye(len(start))))
    options = {"initial_simplex": unit, "xatol": 1e-4, "fatol": 1e-12, "maxiter": 200}
    found = minimize(lambda x: loss(start + step * x), np.zeros(len(start)), method="Nelder-Mead", options=options)
    return np.asarray(start + step * found.x)


def _spacing_s(trajectory: Trajectory) -> float:
    return float(np.median(np.diff(trajectory.times_s)))


def _fit_of(
    estimate: Trajectory,
    truth: GroundTruth,
    config: ClockConfig,
    clock: tuple[float, float | None],
    frames: IntArray | None = None,
) -> ClockFit:
    """A clock with its quality: correlation of the rates over the overlap and residual attitude."""
    offset_s, rate_hz = clock
    even = ClockFit(offset_s, rate_hz, config.offset_s is None, None, None)
    if len(estimate) < 2 or len(truth.trajectory) < 2:
        return even
    stamps_ns = _restamped_ns(truth.trajectory, offset_s, rate_hz, frames)
    if frames is not None:
        even = replace(even, row_stamps_ns=stamps_ns, counts_frames=True)
    correlated, residual_deg, R_estimated_tracked = _quality(estimate, truth, config, stamps_ns)
    fit = replace(even, correlation=correlated, residual_deg=residual_deg)
    is_uneven = frames is not None if config.has_uneven_rows is None else config.has_uneven_rows
    if truth.has_stamps or not is_uneven or residual_deg is None:
        return fit
    start_ns = int(estimate.stamps_ns[0])
    estimated = stamped_motion(estimate, estimate.stamps_ns, start_ns, config.rate_window_s, np.inf)
    attitudes = Rotation.from_matrix(truth.trajectory.rotations @ R_estimated_tracked.T)
    first_s, interval_s = (stamps_ns[0] - start_ns) / NS_PER_S, (stamps_ns[-1] - stamps_ns[0]) / NS_PER_S
    numbers = np.arange(len(stamps_ns)) if frames is None else frames
    even_s = (float(first_s), float(interval_s) / float(numbers[-1]))
    times_s = refine_rows(estimated, attitudes, even_s, numbers, knot_s=config.knot_s, stiffness=config.stiffness)
    row_stamps_ns = start_ns + np.rint(times_s * NS_PER_S).astype(np.int64)
    correlated, residual_deg, _ = _quality(estimate, truth, config, row_stamps_ns)
    return replace(fit, correlation=correlated, residual_deg=residual_deg, row_stamps_ns=row_stamps_ns)


def _quality(
    estimate: Trajectory, truth: GroundTruth, config: ClockConfig, stamps_ns: IntArray
) -> tuple[float | None, float | None, Array]:
    """Correlation of the rates, residual attitude, degrees, and ``R_estimated_tracked``, the truth at these stamps."""
    start_ns = int(estimate.stamps_ns[0])
    window_s = config.window_s if truth.has_stamps else config.rate_window_s
    estimated = stamped_motion(estimate, estimate.stamps_ns, start_ns, window_s, np.inf)
    tracked = stamped_motion(truth.trajectory, stamps_ns, start_ns, window_s, config.max_gap_s)
    grid = estimated.grid(window_s / STEPS_PER_WINDOW)
    estimated_rates, is_estimated = estimated.rates(grid, window_s)
    tracked_rates, is_tracked = tracked.rates(grid, window_s)
    both = is_estimated & is_tracked
    R_estimated_tracked = nearest_rotation(estimated_rates[both].T @ tracked_rates[both])
    residual_deg = _residual_deg(estimated, tracked, grid[both], R_estimated_tracked)
    return correlation(estimated_rates[both], tracked_rates[both]), residual_deg, R_estimated_tracked


def _residual_deg(
    estimated: AngularMotion, tracked: AngularMotion, times_s: Array, R_estimated_tracked: Array
) -> float | None:
    """RMS attitude difference, degrees, without a constant rotation on either side and a linear drift."""
    if len(times_s) < 3:
        return None
    relative = (
        estimated.attitudes(times_s) * Rotation.from_matrix(R_estimated_tracked) * tracked.attitudes(times_s).inv()
    )
    errors = attitude_errors(relative, times_s, np.ones(len(times_s), dtype=np.bool_))
    return float(np.degrees(np.sqrt((errors**2).sum(axis=1).mean())))

# SPDX-License-Identifier: BSD-3-Clause
"""An estimate against its ground truth: clock, association, alignment, numbers. The entry of this subpackage."""

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coclo_vio.evaluation import metrics
from coclo_vio.evaluation.alignment import Alignment, align, level_body, level_body_by_all, tie_attitude, tie_start
from coclo_vio.evaluation.association import MatchedPair, coverage, gaps_ns, match
from coclo_vio.evaluation.clock import ClockConfig, ClockFit, fit_clock
from coclo_vio.evaluation.consistency import anees_pose, twists
from coclo_vio.evaluation.evaluation import Evaluation, Gaps
from coclo_vio.evaluation.metrics import DriftInstant
from coclo_vio.values.arrays import Array
from coclo_vio.values.config import StageConfig
from coclo_vio.values.errors import EvaluationError
from coclo_vio.values.trajectory import GroundTruth, Trajectory
from coclo_vio.values.units import NS_PER_S

_TILT_WORTH_A_NOTE_DEG = 1.0
_NOT_GRAVITY_ALIGNED = "The estimate is not gravity-aligned (it uses no IMU): its attitude was tied at the start."


class EvaluationConfig(StageConfig):
    """How an estimate is compared with its ground truth."""

    clock: ClockConfig = ClockConfig()
    alignment: Annotated[Alignment, Field(description="alignment of ATE and velocity")] = "yaw_position"
    start_window_s: Annotated[
        float, Field(gt=0, le=60, description="drift is tied over this long at the start, at rest if possible, s")
    ] = 1.0
    body_rotation: Annotated[
        Literal["given", "start", "mean"],
        Field(
            description="start, mean: turn the tracked body frame to the tilt of the estimate at the start, or of all "
            "poses (RPE, NEES)"
        ),
    ] = "given"
    max_ground_truth_gap_s: Annotated[
        float, Field(gt=0, le=60, description="no interpolation across holes of the ground truth longer than this, s")
    ] = 0.25
    max_estimate_gap_s: Annotated[
        float, Field(gt=0, le=60, description="holes of the estimate longer than this are not covered, s")
    ] = 1.0
    path_spacing_s: Annotated[
        float, Field(gt=0, le=10, description="positions are averaged over this for path lengths, s")
    ] = 0.1
    segment_lengths_m: Annotated[
        tuple[Annotated[float, Field(gt=0)], ...],
        Field(description="mean drift over all segments of these lengths, where the path is as long, m"),
    ] = (100.0,)
    velocity_window_s: Annotated[
        float, Field(gt=0, le=5, description="window of the local parabola for reference velocities, s")
    ] = 0.25
    paper_drift_at: Annotated[
        Literal["auto", "end", "first_metre"],
        Field(description="when the paper's drift is taken; auto: at the end, after the first metre of closed loops"),
    ] = "auto"
    closed_loop_fraction: Annotated[
        float, Field(ge=0, le=1, description="auto: a loop is closed below this net displacement per path length")
    ] = 0.2
    ground_truth_rotation_noise_rad: Annotated[
        float, Field(ge=0, le=1, description="standard deviation per axis, for NEES, rad")
    ] = 0.002
    ground_truth_position_noise_m: Annotated[
        float, Field(ge=0, le=1, description="standard deviation per axis, for NEES, m")
    ] = 0.001


def evaluate(
    estimate: Trajectory,
    ground_truth: GroundTruth,
    config: EvaluationConfig | None = None,
    *,
    recording_ns: tuple[int, int] | None = None,
    realtime_factor: float | None = None,
    is_gravity_aligned: bool = True,
) -> Evaluation:
    """Measure an estimate against ground truth.

    Args:
        estimate: poses of the body; velocity and covariance where there are any.
        ground_truth: poses of the same body on the tracker's clock, in the tracker's world, z up.
        config: defaults where None.
        recording_ns: first and last stamp of the sensor data, ns: ground truth outside of it does not count in
            ``coverage``. The whole ground truth does, where None.
        realtime_factor: of the run; passed through.
        is_gravity_aligned: whether the estimate's world is level. Where it is not, the whole attitude is tied at the
            start, and an alignment by yaw becomes one by SE(3).

    Raises:
        EvaluationError: no overlap in time, too few common poses, or a clock that cannot be found.
    """
    config = config or EvaluationConfig()
    _check_lengths(estimate, ground_truth)
    clock = fit_clock(estimate, ground_truth, config.clock)
    reference = clock.apply(ground_truth.trajectory)
    compared = _Compared.of(estimate, reference, config, is_gravity_aligned=is_gravity_aligned)
    notes = (
        *_clock_notes(ground_truth, clock),
        *(() if is_gravity_aligned else (_NOT_GRAVITY_ALIGNED,)),
        *_notes(compared),
    )
    return _evaluation(estimate, reference, clock, compared, notes, recording_ns, realtime_factor)


@dataclass(frozen=True, slots=True, eq=False)
class _Paths:
    """Distances travelled, and where on the way the paper's drift is taken."""

    travelled_m: Array
    reference_m: float
    estimate_m: float
    paper_instant: DriftInstant
    paper_index: int | None

    @classmethod
    def of(cls, pair: MatchedPair, config: EvaluationConfig) -> "_Paths":
        travelled = metrics.travelled_m(pair.reference, config.path_spacing_s)
        estimate_m = float(metrics.travelled_m(pair.estimate, config.path_spacing_s)[-1])
        instant: DriftInstant = (
            metrics.paper_drift_instant(pair.reference, travelled, config.closed_loop_fraction)
            if config.paper_drift_at == "auto"
            else config.paper_drift_at
        )
        return cls(travelled, float(travelled[-1]), estimate_m, instant, metrics.index_at(instant, travelled))


@dataclass(frozen=True, slots=True, eq=False)
class _Compared:
    """Both trajectories on the same stamps, and the estimate moved into the ground truth's world in two ways.

    Attributes:
        pair: each in its own world; the estimate is tied in attitude where it is not gravity-aligned.
        tied: the estimate, tied at the start.
        aligned: the estimate after the alignment of ATE.
        paths: distances travelled.
        tilt_deg: between the two bodies at the start.
        config: as given, but for the alignment of an estimate that is not gravity-aligned.
    """

    pair: MatchedPair
    tied: Trajectory
    aligned: Trajectory
    paths: _Paths
    tilt_deg: float
    config: EvaluationConfig

    @classmethod
    def of(
        cls, estimate: Trajectory, reference: Trajectory, config: EvaluationConfig, *, is_gravity_aligned: bool
    ) -> "_Compared":
        pair, window_s = match(estimate, reference, config.max_ground_truth_gap_s), config.start_window_s
        if not is_gravity_aligned:
            pair = replace(pair, estimate=pair.estimate.moved(tie_attitude(pair.estimate, pair.reference, window_s)))
            config = config.model_copy(update={"alignment": "se3"}) if config.alignment == "yaw_position" else config
        tilt_deg = metrics.start_tilt_deg(pair.estimate, pair.reference, window_s)
        if config.body_rotation == "start":
            pair = replace(pair, reference=level_body(pair.estimate, pair.reference, window_s))
        elif config.body_rotation == "mean":
            pair = replace(pair, reference=level_body_by_all(pair.estimate, pair.reference))
        tied = pair.estimate.moved(tie_start(pair.estimate, pair.reference, window_s))
        aligned = pair.estimate.moved(align(config.alignment, pair.estimate, pair.reference, window_s))
        return cls(pair, tied, aligned, _Paths.of(pair, config), tilt_deg, config)


def _evaluation(
    estimate: Trajectory,
    reference: Trajectory,
    clock: ClockFit,
    compared: _Compared,
    notes: tuple[str, ...],
    recording_ns: tuple[int, int] | None,
    realtime_factor: float | None,
) -> Evaluation:
    """The numbers of trajectories that were compared, beside what is passed through."""
    pair, paths, config = compared.pair, compared.paths, compared.config
    tied, aligned = compared.tied, compared.aligned
    return Evaluation(
        ate_m=metrics.ate_m(aligned, pair.reference),
        ate_planar_m=metrics.ate_planar_m(aligned, pair.reference),
        rpe_1m_percent=metrics.rpe_percent(pair.estimate, pair.reference, paths.travelled_m, 1.0),
        segment_drift_percent=_segment_drift_percent(pair, paths.travelled_m, config),
        drift_percent=metrics.drift_percent(tied, pair.reference, paths.reference_m),
        paper_drift_percent=metrics.paper_drift_percent(tied, pair.reference, paths.paper_index),
        paper_drift_at=paths.paper_instant,
        velocity_rmse_mps=_velocity_rmse_mps(aligned, reference, config),
        velocity_source="positions" if estimate.velocity_world is None else "estimate",
        yaw_drift_deg=metrics.yaw_drift_deg(pair.estimate, pair.reference, config.start_window_s),
        path_length_m=paths.reference_m,
        path_length_estimate_m=paths.estimate_m,
        path_length_ratio=metrics.path_length_ratio(paths.estimate_m, paths.reference_m),
        coverage=_coverage(estimate, reference, recording_ns, config),
        anees_pose=_anees_pose(tied, pair.reference, config, clock),
        realtime_factor=realtime_factor,
        alignment=config.alignment,
        start_tilt_deg=compared.tilt_deg,
        clock=clock,
        duration_s=pair.estimate.duration_s,
        poses=len(pair.estimate),
        gaps=_gaps(estimate, reference, pair, config),
        notes=notes,
        estimate=tied,
        reference=reference,
    )


def _check_lengths(estimate: Trajectory, ground_truth: GroundTruth) -> None:
    if len(estimate) < 2 or len(ground_truth.trajectory) < 2:
        raise EvaluationError(
            f"an evaluation needs 2 poses or more on both sides, the estimate has {len(estimate)} and the ground "
            f"truth {ground_truth.source} has {len(ground_truth.trajectory)}; check whether the run was cut short"
        )


def _segment_drift_percent(pair: MatchedPair, travelled_m: Array, config: EvaluationConfig) -> dict[float, float]:
    """By length, m, of those that the ground truth travels."""
    drifts = {
        length_m: metrics.segment_drift_percent(pair.estimate, pair.reference, length_m, travelled_m)
        for length_m in config.segment_lengths_m
    }
    return {length_m: drift for length_m, drift in drifts.items() if drift is not None}


def _velocity_rmse_mps(aligned: Trajectory, reference: Trajectory, config: EvaluationConfig) -> float | None:
    """RMS velocity error at the compared poses; the reference velocity is derived at the ground truth's own rate."""
    velocity, is_trusted = metrics.velocities(reference, config.velocity_window_s, config.max_ground_truth_gap_s)
    at_s = (aligned.stamps_ns - reference.stamps_ns[0]) / NS_PER_S
    expected = np.stack([np.interp(at_s, reference.times_s, column) for column in velocity.T], axis=1)
    keep = np.interp(at_s, reference.times_s, is_trusted.astype(np.float64)) > 1.0 - 1e-9
    estimated = aligned.velocity_world
    if estimated is None:
        estimated, is_estimate_trusted = metrics.velocities(
            aligned, config.velocity_window_s, config.max_estimate_gap_s
        )
        keep &= is_estimate_trusted
    return metrics.velocity_rmse_mps(estimated, expected, keep)


def _anees_pose(tied: Trajectory, reference: Trajectory, config: EvaluationConfig, clock: ClockFit) -> float | None:
    rotation_rad, position_m = config.ground_truth_rotation_noise_rad, config.ground_truth_position_noise_m
    return anees_pose(tied, reference, rotation_rad, position_m, _time_noise_s(clock, reference))


def _time_noise_s(clock: ClockFit, reference: Trajectory) -> float:
    """One sigma of the times of a ground truth without stamps, s: by the attitude that its clock leaves unexplained.

    Rows that were dropped or delayed put poses at wrong times, by which a body that turns is turned wrongly. Positions
    take no part in it.
    """
    if clock.rate_hz is None or clock.residual_deg is None:
        return 0.0
    rates = twists(reference)[:, :3]
    rate_radps = float(np.sqrt(np.square(rates).sum(axis=1).mean()))
    return float(np.radians(clock.residual_deg)) / rate_radps if rate_radps > 0.0 else 0.0


def _coverage(
    estimate: Trajectory, reference: Trajectory, recording_ns: tuple[int, int] | None, config: EvaluationConfig
) -> float | None:
    start_ns, end_ns = int(reference.stamps_ns[0]), int(reference.stamps_ns[-1])
    if recording_ns is not None:
        start_ns, end_ns = max(start_ns, recording_ns[0]), min(end_ns, recording_ns[1])
    return coverage(estimate, start_ns, end_ns, config.max_estimate_gap_s)


def _gaps(estimate: Trajectory, reference: Trajectory, pair: MatchedPair, config: EvaluationConfig) -> Gaps:
    return Gaps(
        ground_truth_holes=len(gaps_ns(reference.stamps_ns, config.max_ground_truth_gap_s)),
        estimate_holes=len(gaps_ns(estimate.stamps_ns, config.max_estimate_gap_s)),
        poses_outside=pair.outside_count,
        poses_in_holes=pair.in_gap_count,
    )


def _clock_notes(truth: GroundTruth, clock: ClockFit) -> list[str]:
    """Sentences on how the ground truth got its stamps."""
    notes = []
    if not truth.has_stamps:
        how = "estimated from the angular velocity of the body" if clock.is_estimated else "given"
        what = "the rate of its frames" if clock.counts_frames else "its rate"
        notes.append(
            f"The ground truth has no time stamps: {what}, {clock.rate_hz:.3f} Hz, and its offset were {how}; "
            f"{_spacing(clock)}."
        )
    elif clock.is_estimated:
        notes.append(f"The clock offset of the ground truth, {clock.offset_s:.4f} s, was estimated from angular speed.")
    if clock.problem is not None:
        notes.append(f"The clock offset of the ground truth was not estimated: {clock.problem}.")
    return notes


def _spacing(clock: ClockFit) -> str:
    """How rows without stamps are spaced."""
    if clock.row_stamps_ns is None:
        return (
            "rows are taken as evenly spaced, so dropped ones show as errors of velocity and of position along the path"
        )
    fitted = "the spacing of its rows was fitted to the attitude of the body"
    counted = "the frames between its rows were counted from the smoothness of its own motion"
    return f"{counted}, and then {fitted}" if clock.counts_frames else fitted


def _notes(compared: _Compared) -> list[str]:
    """Sentences on what the numbers alone do not show."""
    notes, pair = [], compared.pair
    left_out = pair.outside_count + pair.in_gap_count
    if left_out:
        notes.append(f"{left_out} estimated poses have no ground truth beside them and were left out.")
    if compared.paths.reference_m < 1.0:
        notes.append(f"The ground truth travels only {compared.paths.reference_m:.3g} m: RPE over 1 m is not defined.")
    if compared.tilt_deg > _TILT_WORTH_A_NOTE_DEG:
        done = "part of RPE and NEES" if compared.config.body_rotation == "given" else "removed from RPE and NEES"
        notes.append(
            f"At the start the tracked body and the estimate tilt by {compared.tilt_deg:.1f} deg to each other, {done} "
            "(body_rotation: start or mean removes it)."
        )
    return notes

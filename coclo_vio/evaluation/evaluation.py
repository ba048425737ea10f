# SPDX-License-Identifier: BSD-3-Clause
"""The result of an evaluation, a frozen value; ``evaluation_record`` writes it as JSON."""

from collections.abc import Mapping
from dataclasses import dataclass

from coclo_vio.evaluation.alignment import Alignment
from coclo_vio.evaluation.clock import ClockFit
from coclo_vio.evaluation.metrics import DriftInstant
from coclo_vio.values.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class Gaps:
    """Holes and the poses left out for them.

    Attributes:
        ground_truth_holes: intervals of the ground truth longer than its limit.
        estimate_holes: intervals of the estimate longer than its limit.
        poses_outside: poses of the estimate before or after the ground truth, left out.
        poses_in_holes: poses of the estimate in holes of the ground truth, left out.
    """

    ground_truth_holes: int
    estimate_holes: int
    poses_outside: int
    poses_in_holes: int


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """One estimate measured against one ground truth; None where a number is not defined for these data.

    Attributes:
        ate_m: RMS position error after ``alignment``, m.
        ate_planar_m: the same of x and y only, after the same alignment, m.
        rpe_1m_percent: median translation error over all segments of 1 m of ground-truth travel, percent.
        segment_drift_percent: by length of segment, m, the mean translation error over all such segments, percent.
        drift_percent: final position error over path length, tied at the start only, percent.
        paper_drift_percent: position error over net displacement (paper, Table I), tied at the start only, percent.
        paper_drift_at: when that was taken.
        velocity_rmse_mps: against velocities from ground-truth positions, after the yaw of ``alignment``, m/s.
        velocity_source: the ``estimate``'s own velocity, or that derived from its ``positions``.
        yaw_drift_deg: heading error at the end less that at the start, degrees, left turn positive.
        path_length_m: travelled by the ground truth, m.
        path_length_estimate_m: travelled by the estimate, m.
        path_length_ratio: estimate over ground truth.
        coverage: share of the interval that the estimate covers, 0..1.
        anees_pose: average NEES of the 6-dof pose over 6, tied at the start; 1 is consistent, above 1
            overconfident, below 1 conservative.
        realtime_factor: recording time over computing time, where the run reported it.
        alignment: the alignment of ATE.
        start_tilt_deg: angle between the vertical of the body in both, once tied at the start, degrees.
        clock: offset, and rate where the ground truth has no stamps.
        duration_s: from the first compared pose to the last, s.
        poses: how many were compared.
        gaps: holes and poses left out.
        notes: sentences on how the numbers were made and where they are limited.
        estimate: all compared poses, tied at the start to the ground truth's world, for figures.
        reference: the ground truth on the estimate's clock, for figures.
    """

    ate_m: float
    ate_planar_m: float
    rpe_1m_percent: float | None
    segment_drift_percent: Mapping[float, float]
    drift_percent: float | None
    paper_drift_percent: float | None
    paper_drift_at: DriftInstant
    velocity_rmse_mps: float | None
    velocity_source: str
    yaw_drift_deg: float
    path_length_m: float
    path_length_estimate_m: float
    path_length_ratio: float | None
    coverage: float | None
    anees_pose: float | None
    realtime_factor: float | None
    alignment: Alignment
    start_tilt_deg: float
    clock: ClockFit
    duration_s: float
    poses: int
    gaps: Gaps
    notes: tuple[str, ...]
    estimate: Trajectory
    reference: Trajectory

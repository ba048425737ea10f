# SPDX-License-Identifier: BSD-3-Clause
"""One job, a recording through one mode: its figures, its processor time, or why it failed."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.read_report import STREAM_NAMES
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.experiments.legged.impact_strength import impact_strength
from coclo_vio.experiments.legged.legged_record import (
    ImpactStrength,
    LeggedFigures,
    LeggedJobRecord,
    LeggedTrajectory,
)
from coclo_vio.experiments.legged.legged_recording import LeggedRecording, LeggedRecordings
from coclo_vio.experiments.legged.relative_consistency import anees_per_metre
from coclo_vio.experiments.legged.smoother_mode import GTSAM_SMOOTHER, smoother_mode
from coclo_vio.experiments.results.provenance import Provenance
from coclo_vio.experiments.table.job import NO_ESTIMATE, against_truth, reason_of
from coclo_vio.runs.evaluating import evaluate_run
from coclo_vio.runs.modes.registry import mode_of
from coclo_vio.runs.run_config import resolve
from coclo_vio.runs.run_record import RunRecord
from coclo_vio.runs.running import run_modes
from coclo_vio.values.measurements import ImuSample, JointSample

_WITHOUT_COVARIANCE = (GTSAM_SMOOTHER, "naive", "naive_rolling")  # theirs is no estimate of their errors


@dataclass(frozen=True, slots=True)
class LeggedJob:
    """One recording through one mode."""

    recording: LeggedRecording
    estimator: str

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"{self.recording.name}-{self.estimator}"


@dataclass(frozen=True, slots=True)
class Recorded:
    """What came of a recording: how hard feet land in it, or why it is not there."""

    impacts: ImpactStrength | None = None
    reason: str | None = None


def recorded(recording: LeggedRecording, recordings: LeggedRecordings) -> Recorded:
    """Make a recording where it is missing; a failure is a result too."""
    try:
        recordings.make(recording)
        dataset = open_dataset(recordings.path(recording), resolve(recording.robot).robot)
        return Recorded(impact_strength(dataset.measurements(frozenset({ImuSample}))))
    except Exception as error:  # of whatever kind: a recording that fails must not end the others
        return Recorded(reason=reason_of(error, recordings.folder))


def run_legged_job(
    job: LeggedJob, found: Recorded, recordings: LeggedRecordings, origin: Provenance
) -> LeggedJobRecord:
    """Run a job; a failure is a result too.

    Args:
        job: to run.
        found: what came of its recording.
        recordings: with that of the job.
        origin: of the results.
    """
    cpu_ms: float | None = None
    trajectories: dict[str, LeggedTrajectory] = {}
    if found.reason is None:
        try:
            with smoother_mode(), TemporaryDirectory() as scratch:
                cpu_ms, trajectories = _run(job, recordings, Path(scratch) / "run")
        except Exception as error:  # of whatever kind: a job that fails must not end the others
            reason = reason_of(error, recordings.path(job.recording).parent)
            trajectories = {job.estimator: LeggedTrajectory(figures=None, failure=reason)}
    return LeggedJobRecord(
        kind=job.recording.kind,
        group=job.recording.group,
        seed=job.recording.seed,
        estimator=job.estimator,
        origin=origin,
        not_recorded=found.reason,
        impacts=found.impacts,
        cpu_ms_per_joint_sample=cpu_ms,
        trajectories=trajectories,
    )


def _run(
    job: LeggedJob, recordings: LeggedRecordings, folder: Path
) -> tuple[float | None, dict[str, LeggedTrajectory]]:
    """Processor time for each joint sample, ms, and the results by trajectory."""
    config, truth = resolve(job.recording.robot), recordings.truth(job.recording)
    began_s, began_cpu_s = time.perf_counter(), time.process_time()
    run = run_modes(recordings.path(job.recording), [job.estimator], config, folder)
    share = (time.process_time() - began_cpu_s) / (time.perf_counter() - began_s)
    evaluation = config.evaluation if truth is None else against_truth(config.evaluation)
    evaluations, reasons = evaluate_run(folder, evaluation, truth)
    noise_m = evaluation.ground_truth_position_noise_m
    trajectories = {
        name: LeggedTrajectory(
            figures=_figures(name, evaluations, noise_m),
            failure=run.estimators[name].failure or reasons.get(name) if name in run.estimators else NO_ESTIMATE,
        )
        for name in mode_of(job.estimator).trajectory_names
    }
    is_whole = all(trajectory.failure is None for trajectory in trajectories.values())
    return _cpu_ms(run, share) if is_whole else None, trajectories


def _cpu_ms(run: RunRecord, share: float) -> float | None:
    """Processor time of the estimator for each joint sample, ms.

    The estimator's time is of the wall clock; other jobs of the machine are taken out by the share of the processor
    that the whole run had.
    """
    streams = () if run.reader is None else run.reader.streams
    samples = sum(stream.samples for stream in streams if stream.name == STREAM_NAMES[JointSample])
    compute_s = max((trajectory.compute_s for trajectory in run.estimators.values()), default=0.0)
    return 1e3 * compute_s * min(1.0, share) / samples if samples and compute_s else None


def _figures(name: str, evaluations: Mapping[str, Evaluation], noise_m: float) -> LeggedFigures | None:
    evaluation = evaluations.get(name)
    if evaluation is None:
        return None
    estimate = evaluation.estimate
    reference = evaluation.reference.interpolated(estimate.stamps_ns)
    has_covariance = name not in _WITHOUT_COVARIANCE
    return LeggedFigures(
        drift_percent=evaluation.drift_percent,
        rpe_1m_percent=evaluation.rpe_1m_percent,
        ate_m=evaluation.ate_m,
        ate_planar_m=evaluation.ate_planar_m,
        path_ratio=evaluation.path_length_ratio,
        yaw_drift_deg=abs(evaluation.yaw_drift_deg),
        anees_pose=evaluation.anees_pose if has_covariance else None,
        anees_1m=anees_per_metre(estimate, reference, position_noise_m=noise_m) if has_covariance else None,
        coverage=evaluation.coverage,
    )

# SPDX-License-Identifier: BSD-3-Clause
"""One job, a recording with a fault through one mode: its figures against the exact truth, its events, its failure."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from coclo_vio.evaluation.evaluate import evaluate
from coclo_vio.experiments.faults.estimates_taken import EstimatesTaken
from coclo_vio.experiments.faults.fault_cases import NOMINAL, FaultCase
from coclo_vio.experiments.faults.fault_record import FaultFigures, FaultJobRecord, FaultTrajectory
from coclo_vio.experiments.faults.fault_recording import FaultRecording
from coclo_vio.experiments.results.provenance import Provenance
from coclo_vio.experiments.studies.robustness_study import error_history, recovery_s
from coclo_vio.experiments.table.job import NO_ESTIMATE, against_truth, reason_of
from coclo_vio.robot.description import load_robot
from coclo_vio.runs.evaluating import evaluate_run
from coclo_vio.runs.fault_kinds.truth_faults import with_gaps
from coclo_vio.runs.modes.registry import mode_of
from coclo_vio.runs.observers import Observers
from coclo_vio.runs.run_config import RunConfig, resolve
from coclo_vio.runs.run_folder import read_estimates
from coclo_vio.runs.run_record import TrajectoryRecord
from coclo_vio.runs.running import run_modes
from coclo_vio.values.errors import CocloError
from coclo_vio.values.trajectory import GroundTruth, Trajectory

_START_SHARE = 0.45  # of the recording: when faults begin
_PERCENTILE = 95.0  # of the errors without a fault: the limit of a recovery


@dataclass(frozen=True, slots=True)
class FaultJob:
    """One recording with one fault through one mode."""

    recording: FaultRecording
    case: FaultCase
    mode: str

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"{self.recording.name}-{self.case.file_name}-{self.mode}"

    @property
    def nominal_name(self) -> str:
        """Name of the file of the same without a fault."""
        return f"{self.recording.name}-{NOMINAL}-{self.mode}"


def run_fault_job(job: FaultJob, nominal: FaultJobRecord | None, origin: Provenance) -> FaultJobRecord:
    """Run a job; a failure is a result too.

    Args:
        job: to run.
        nominal: the same without a fault, None if this is that one.
        origin: of the results.
    """
    trajectories: dict[str, FaultTrajectory] = {}
    not_run, is_as_nominal = None, False
    if nominal is not None and nominal.not_run is None and not _is_touched(job, nominal):
        trajectories, is_as_nominal = dict(nominal.trajectories), True
    else:
        try:
            trajectories = _run(job, {} if nominal is None else nominal.trajectories)
        except Exception as error:  # of whatever kind: a job that fails must not end the others
            not_run = reason_of(error, job.recording.folder)
    return FaultJobRecord(
        robot=job.recording.robot,
        seed=job.recording.seed,
        case=job.case.name,
        mode=job.mode,
        origin=origin,
        not_run=not_run,
        is_as_nominal=is_as_nominal,
        trajectories=trajectories,
    )


def _is_touched(job: FaultJob, nominal: FaultJobRecord) -> bool:
    """Whether the mode reads a stream with the fault; faults of ground truth are seen in every mode."""
    read = {sensor for trajectory in nominal.trajectories.values() for sensor in trajectory.sensors}
    return not read or "truth" in job.case.streams or bool(read & set(job.case.streams))


def _run(job: FaultJob, nominal: Mapping[str, FaultTrajectory]) -> dict[str, FaultTrajectory]:
    """The results by trajectory."""
    truth = job.recording.truth()
    start_s = round(_START_SHARE * truth.duration_s, 1)
    settings = job.case.settings_on(load_robot(job.recording.robot), start_s, truth.duration_s)
    config = resolve(job.recording.robot, settings=settings)
    taken = EstimatesTaken(int(truth.stamps_ns[0]), int(truth.stamps_ns[-1]), job.case.step_s)
    with TemporaryDirectory() as scratch:
        folder = Path(scratch) / "run"
        observers = Observers(watch=lambda _, output: taken.take(output))
        runs = run_modes(job.recording.path, [job.mode], config, folder, observers=observers).estimators
        unreadable = {name: _unreadable(folder, name, runs) for name in runs}
        of_capture = evaluate_run(folder, config.evaluation)[1] if config.faults.truth_gaps else {}
    exact = GroundTruth(truth, True, "truth")
    reference = with_gaps(exact, config.faults.truth_gaps, int(truth.stamps_ns[0]))
    end_s = None if job.case.seconds is None else start_s + job.case.seconds
    results = {}
    for name in mode_of(job.mode).trajectory_names:
        run, before = runs.get(name), nominal.get(name)
        usual_m = None if before is None or before.figures is None else before.figures.usual_m
        figures, reason = _figures(taken.trajectory(name), reference, truth, config, (end_s, usual_m))
        results[name] = FaultTrajectory(
            figures=figures,
            failure=NO_ESTIMATE if run is None else run.failure or reason or of_capture.get(name),
            unreadable=unreadable.get(name),
            events={} if run is None else dict(Counter(event.kind for event in run.events)),
            sensors=() if run is None else run.sensors,
        )
    return results


def _unreadable(folder: Path, name: str, runs: Mapping[str, TrajectoryRecord]) -> str | None:
    """Why the files of a trajectory cannot be read; None where they can, or there are none."""
    if not runs[name].estimates:
        return None
    try:
        read_estimates(folder, name)
    except CocloError as error:
        return reason_of(error, folder)
    return None


def _figures(
    estimate: Trajectory | None,
    reference: GroundTruth,
    truth: Trajectory,
    config: RunConfig,
    limits: tuple[float | None, float | None],
) -> tuple[FaultFigures | None, str | None]:
    """The figures of a trajectory, or why there are none; ``limits`` are the fault's end, s, and the usual error, m."""
    if estimate is None:
        return None, NO_ESTIMATE
    try:
        evaluation = evaluate(
            estimate,
            reference,
            against_truth(config.evaluation),
            recording_ns=(int(truth.stamps_ns[0]), int(truth.stamps_ns[-1])),
        )
        times_s, errors_m = error_history(estimate, truth)
    except CocloError as error:
        return None, str(error)
    end_s, usual_m = limits
    recovery = None if end_s is None or usual_m is None else recovery_s(times_s, errors_m, end_s, usual_m)
    return FaultFigures(
        drift_percent=evaluation.drift_percent,
        rpe_1m_percent=evaluation.rpe_1m_percent,
        anees_pose=evaluation.anees_pose,
        coverage=evaluation.coverage,
        worst_second_m=float(errors_m.max(initial=0.0)),
        usual_m=float(np.percentile(errors_m, _PERCENTILE)) if len(errors_m) else 0.0,
        recovery_s=recovery,
        has_recovered=None if end_s is None or usual_m is None else recovery is not None,
    ), None

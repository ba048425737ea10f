# SPDX-License-Identifier: BSD-3-Clause
"""One job, from recording to figures: a run and its evaluation against both references."""

import shutil
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

from coclo_vio.evaluation.clock import ClockConfig
from coclo_vio.evaluation.evaluate import EvaluationConfig
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.evaluation.evaluation_record import EvaluationRecord
from coclo_vio.experiments.table.job_store import JobStore
from coclo_vio.experiments.table.plan import Job, TablePlan
from coclo_vio.experiments.table.recordings import Recordings
from coclo_vio.experiments.table.table_record import EventTime, JobRecord, JobTrajectory
from coclo_vio.runs import run_folder
from coclo_vio.runs.evaluating import evaluate_run
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.runs.run_record import TrajectoryRecord
from coclo_vio.runs.running import run_modes
from coclo_vio.values.errors import CocloError, interrupt_in

NO_ESTIMATE = "the estimator gave no estimate"
_Evaluated = tuple[Mapping[str, Evaluation], Mapping[str, str]]
"""Evaluations by trajectory, and the reasons where there is none."""


def run_job(job: Job, plan: TablePlan, recordings: Recordings, store: JobStore) -> JobRecord:
    """Run a job whose recording exists; a failure is a result too.

    Args:
        job: to run.
        plan: of the table.
        recordings: with that of the job, and its truth.
        store: keeps the trajectories.
    """
    began_s = time.process_time()
    try:
        with run_folder.writing(store.folder):
            ran = _run(job, recordings, job.variant.configured(plan.config), store.run_of(job))
    except Exception as error:  # of whatever kind: a job that fails must not end the others
        return failed(job, plan, reason_of(error, recordings.folder))
    trajectories = {**ran, **{name: _nothing(NO_ESTIMATE) for name in job.variant.trajectories if name not in ran}}
    failures = [trajectory.failure for trajectory in trajectories.values() if trajectory.failure is not None]
    return _record(job, plan, trajectories, next(iter(failures), None), time.process_time() - began_s)


def failed(job: Job, plan: TablePlan, reason: str) -> JobRecord:
    """The record of a job without any result."""
    return _record(job, plan, {name: _nothing(reason) for name in job.variant.trajectories}, reason, None)


def reason_of(error: Exception, folder: Path) -> str:
    """The message of an error in one line, without the folder of the recordings; with its class if unexpected.

    Raises:
        BaseException: the error came of an interrupt, which is no failure of a job.
    """
    interrupt = interrupt_in(error)
    if interrupt is not None:
        raise interrupt
    text = " ".join(str(error).replace(f"{folder}/", "").split())
    return text if isinstance(error, CocloError) else f"{type(error).__name__}: {text}"


def against_truth(config: EvaluationConfig) -> EvaluationConfig:
    """How to compare with the truth: it is exact and on the recording's clock, nothing of either is estimated."""
    exact = {"clock": ClockConfig(offset_s=0.0)}
    noiseless = {"ground_truth_rotation_noise_rad": 0.0, "ground_truth_position_noise_m": 0.0}
    return config.model_copy(update=exact | noiseless)


def keeps_state(job: Job) -> bool:
    """Whether a figure shows the velocities of this job: those of flat ground, as in the paper."""
    return job.trial == "flat" and job.variant.feedback is None


def _record(
    job: Job, plan: TablePlan, trajectories: dict[str, JobTrajectory], failure: str | None, cpu_s: float | None
) -> JobRecord:
    return JobRecord(
        fingerprint=plan.fingerprint(job),
        trial=job.trial,
        seed=job.seed,
        variant=job.variant.name,
        cpu_s=cpu_s,
        failure=failure,
        estimators=trajectories,
    )


def _run(job: Job, recordings: Recordings, config: RunConfig, folder: Path) -> dict[str, JobTrajectory]:
    """The results by trajectory; the run folder appears whole, without the states, which are large."""
    path = recordings.path(job.trial, job.seed)
    folder.parent.mkdir(parents=True, exist_ok=True)
    for left in folder.parent.glob(f".{folder.name}.*"):  # by a worker that was killed
        shutil.rmtree(left, ignore_errors=True)
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as scratch:
        run = Path(scratch) / folder.name
        record = run_modes(path, [job.variant.mode], config, run)
        truth, exact = recordings.truth(job.trial, job.seed), against_truth(config.evaluation)
        vicon_result = evaluate_run(run, config.evaluation)
        truth_result = evaluate_run(run, exact, truth)
        for state in run.glob("*_state.csv"):
            if not keeps_state(job):
                state.unlink()
        shutil.rmtree(folder, ignore_errors=True)
        run.rename(folder)
    return {
        name: _result(name, trajectory, vicon_result, truth_result) for name, trajectory in record.estimators.items()
    }


def _result(name: str, trajectory: TrajectoryRecord, vicon: _Evaluated, truth: _Evaluated) -> JobTrajectory:
    """Figures of one trajectory against each reference, beside its run."""
    reasons = (trajectory.failure, vicon[1].get(name), truth[1].get(name))
    return JobTrajectory(
        vicon=_evaluation(name, vicon),
        truth=_evaluation(name, truth),
        realtime_factor=trajectory.realtime_factor,
        estimates=trajectory.estimates,
        counts=dict(trajectory.counts),
        keyframes=trajectory.keyframes,
        events=tuple(EventTime(kind=event.kind, time_s=event.time_s) for event in trajectory.events),
        failure=next((reason for reason in reasons if reason is not None), None),
    )


def _evaluation(name: str, evaluated: _Evaluated) -> EvaluationRecord | None:
    evaluation = evaluated[0].get(name)
    return None if evaluation is None else EvaluationRecord.of(evaluation)


def _nothing(reason: str) -> JobTrajectory:
    return JobTrajectory(
        vicon=None,
        truth=None,
        realtime_factor=None,
        estimates=0,
        counts={},
        keyframes=None,
        events=(),
        failure=reason,
    )

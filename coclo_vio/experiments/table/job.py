# SPDX-License-Identifier: BSD-3-Clause
"""One job, from recording to figures: what ``coclo-vio run`` and ``coclo-vio evaluate`` do, twice measured."""

import shutil
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from coclo_vio.evaluation.clock import ClockConfig
from coclo_vio.evaluation.evaluate import EvaluationConfig
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.experiments.table.plan import Job
from coclo_vio.experiments.table.recordings import Recordings
from coclo_vio.experiments.table.job_store import JobStore, Row
from coclo_vio.runs import comparison, run_folder
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.errors import CocloError

REFERENCES = ("vicon", "truth")
NO_ESTIMATE = "no estimate came out"


def run_job(job: Job, recordings: Recordings, config: RunConfig, store: JobStore) -> Row:
    """Run a job whose recording is there; what goes wrong is a result too.

    Args:
        job: what to run.
        recordings: where its recording and the truth are.
        config: of the plan.
        store: keeps the trajectories.
    """
    began_s = time.process_time()
    try:
        with run_folder.writing(store.folder):
            told = _run(job, recordings, job.variant.configured(config), store.run_of(job))
    except Exception as error:  # of whatever kind: one job that fails is no reason to lose the others
        return failed(job, sentence(error, recordings))
    lacking = [name for name in job.variant.estimators if name not in told]
    told |= {name: _nothing(NO_ESTIMATE) for name in lacking}
    failures = [one["failure"] for one in told.values() if one["failure"] is not None]
    cpu_s = time.process_time() - began_s
    return {**_named(job), "cpu_s": cpu_s, "failure": next(iter(failures), None), "estimators": told}


def failed(job: Job, reason: str) -> Row:
    """The row of a job that came to nothing."""
    nothing = {name: _nothing(reason) for name in job.variant.estimators}
    return {**_named(job), "cpu_s": None, "failure": reason, "estimators": nothing}


def sentence(error: Exception, recordings: Recordings) -> str:
    """What an error says, in one line and wherever the recordings are; if nobody raised it on purpose, its kind too."""
    text = " ".join(str(error).replace(f"{recordings.folder}/", "").split())
    return text if isinstance(error, CocloError) else f"{type(error).__name__}: {text}"


def against_truth(config: EvaluationConfig) -> EvaluationConfig:
    """How to compare with the truth: it is exact and on the recording's clock, nothing of either is estimated."""
    exact = {"clock": ClockConfig(offset_s=0.0)}
    noiseless = {"ground_truth_rotation_noise_rad": 0.0, "ground_truth_position_noise_m": 0.0}
    return config.model_copy(update=exact | noiseless)


def _run(job: Job, recordings: Recordings, config: RunConfig, folder: Path) -> dict[str, Row]:
    """What is told of each estimator; the run folder appears whole, without the states, which are large."""
    path = recordings.path(job.trial, job.seed)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as scratch:
        run = Path(scratch) / folder.name
        estimators = comparison.run_all(path, [job.variant.mode], config, run)["estimators"]
        truth, exact = recordings.truth(job.trial, job.seed), against_truth(config.evaluation)
        evaluated = {
            "vicon": comparison.evaluate_run(run, config.evaluation),
            "truth": comparison.evaluate_run(run, exact, truth),
        }
        for state in run.glob("*_state.csv"):
            if not keeps_state(job):
                state.unlink()
        shutil.rmtree(folder, ignore_errors=True)
        run.rename(folder)
    return {
        name: _told(told, {reference: _of(name, *both) for reference, both in evaluated.items()})
        for name, told in estimators.items()
    }


def keeps_state(job: Job) -> bool:
    """Whether a figure shows the velocities of this job: those of flat ground, as in the paper."""
    return job.trial == "flat" and job.variant.feedback is None


def _of(
    name: str, evaluations: Mapping[str, Evaluation], failures: Mapping[str, str]
) -> tuple[Evaluation | None, str | None]:
    """One estimator's evaluation, or why there is none."""
    return evaluations.get(name), failures.get(name)


def _told(told: Mapping[str, Any], evaluated: Mapping[str, tuple[Evaluation | None, str | None]]) -> Row:
    """Figures of one estimator against each reference, and how it fared."""
    blocks = {key: None if evaluation is None else evaluation.to_json() for key, (evaluation, _) in evaluated.items()}
    reasons = [told["failure"], *(reason for _, reason in evaluated.values())]
    return {
        **blocks,
        "realtime_factor": told["realtime_factor"],
        "estimates": told["estimates"],
        "counts": dict(told["counts"]),
        "keyframes": told["keyframes"],
        "events": [{"kind": event["kind"], "time_s": event["time_s"]} for event in told["events"]],
        "failure": next((reason for reason in reasons if reason is not None), None),
    }


def _nothing(reason: str) -> Row:
    empty: Row = dict.fromkeys((*REFERENCES, "realtime_factor", "keyframes"))
    return {**empty, "estimates": 0, "counts": {}, "events": [], "failure": reason}


def _named(job: Job) -> Row:
    return {"trial": job.trial, "seed": job.seed, "variant": job.variant.name}

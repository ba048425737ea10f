# SPDX-License-Identifier: BSD-3-Clause
"""A unit of work: one recording with all its unfinished jobs. Runs in this process, in another, or on a cluster."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import Literal

from coclo_vio.experiments.table.job import failed, run_job, sentence
from coclo_vio.experiments.table.plan import Job, TablePlan
from coclo_vio.experiments.table.recordings import Recordings
from coclo_vio.experiments.table.job_store import JobStore, Row


@dataclass(frozen=True, slots=True)
class News:
    """What is going on.

    Attributes:
        kind: ``simulating`` and ``running`` begin something; ``done`` and ``failed`` end a job; ``left`` ends a unit.
        name: of the job, or of the recording for ``simulating`` and ``left``.
        reason: why it failed.
    """

    kind: Literal["simulating", "running", "done", "failed", "left"]
    name: str
    reason: str = ""


Listener = Callable[[News], None]


@dataclass(frozen=True, slots=True)
class WorkUnit:
    """One recording and its unfinished jobs; can be sent to another process."""

    jobs: tuple[Job, ...]
    plan: TablePlan
    recordings: Recordings
    store: JobStore

    @property
    def name(self) -> str:
        """That of the recording."""
        return self.jobs[0].recording


def units(plan: TablePlan, recordings: Recordings, store: JobStore, kept: Mapping[Job, Row]) -> list[WorkUnit]:
    """What is left to do: jobs that are not finished, and those that failed."""
    left = [job for job in plan.jobs() if job not in kept or kept[job].get("failure") is not None]
    return [WorkUnit(tuple(jobs), plan, recordings, store) for _, jobs in groupby(left, lambda job: job.recording)]


def run_unit(unit: WorkUnit, tell: Listener) -> None:
    """Do all jobs of a unit, each kept as soon as it is finished.

    Args:
        unit: what to do.
        tell: called with what is going on.

    Raises:
        DatasetError: a finished job cannot be kept.
    """
    first = unit.jobs[0]
    reason = None
    try:
        if not unit.recordings.is_there(first.trial, first.seed):
            tell(News("simulating", unit.name))
            unit.recordings.make(first.trial, first.seed)
    except Exception as error:  # a simulation that breaks down costs its own jobs and no other
        reason = sentence(error, unit.recordings)
    all_well = True
    for job in unit.jobs:
        tell(News("running", job.name))
        ran = run_job(job, unit.recordings, unit.plan.config, unit.store) if reason is None else failed(job, reason)
        unit.store.write(job, {"fingerprint": unit.plan.fingerprint(job), **ran})
        failure = ran["failure"]
        all_well = all_well and failure is None
        tell(News("done", job.name) if failure is None else News("failed", job.name, failure))
    if all_well:
        unit.recordings.discard(first.trial, first.seed)
    tell(News("left", unit.name))

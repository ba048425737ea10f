# SPDX-License-Identifier: BSD-3-Clause
"""A unit of work: one recording with all its unfinished jobs. Runs in this process, in another, or on a cluster."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import Literal

from coclo_vio.experiments.table.job import failed, reason_of, run_job
from coclo_vio.experiments.table.job_store import JobStore
from coclo_vio.experiments.table.plan import Job, TablePlan
from coclo_vio.experiments.table.recordings import Recordings
from coclo_vio.experiments.table.table_record import JobRecord


@dataclass(frozen=True, slots=True)
class WorkProgress:
    """A step of the work.

    Attributes:
        kind: ``simulating`` and ``running`` begin a step; ``done`` and ``failed`` end a job; ``ended`` ends a unit.
        name: of the job, or of the recording for ``simulating`` and ``ended``.
        reason: why it failed.
    """

    kind: Literal["simulating", "running", "done", "failed", "ended"]
    name: str
    reason: str = ""


ProgressCallback = Callable[[WorkProgress], None]


@dataclass(frozen=True, slots=True)
class WorkUnit:
    """One recording and its unfinished jobs; can be pickled for another process.

    Attributes:
        jobs: of one recording.
        plan: of the table.
        recordings: make the recording.
        store: keeps the results.
        prefix: of the names in progress reports, where several tables are worked on.
    """

    jobs: tuple[Job, ...]
    plan: TablePlan
    recordings: Recordings
    store: JobStore
    prefix: str = ""

    @property
    def name(self) -> str:
        """Name of the recording."""
        return f"{self.prefix}{self.jobs[0].recording}"


def units(plan: TablePlan, recordings: Recordings, store: JobStore, kept: Mapping[Job, JobRecord]) -> list[WorkUnit]:
    """The remaining work: jobs that are not finished, and those that failed."""
    remaining = [job for job in plan.jobs() if job not in kept or kept[job].failure is not None]
    return [WorkUnit(tuple(jobs), plan, recordings, store) for _, jobs in groupby(remaining, lambda job: job.recording)]


def run_unit(unit: WorkUnit, report: ProgressCallback) -> None:
    """Run the jobs of a unit that are not finished, each stored as soon as it is.

    Args:
        unit: the jobs.
        report: called at each step.

    Raises:
        DatasetError: a finished job cannot be stored.
    """
    first = unit.jobs[0]
    reason = None
    try:
        if not unit.recordings.is_there(first.trial, first.seed):
            report(WorkProgress("simulating", unit.name))
            unit.recordings.make(first.trial, first.seed)
    except Exception as error:  # a simulation that fails costs its own jobs only
        reason = reason_of(error, unit.recordings.folder)
    is_complete = True
    for job in unit.jobs:
        name = f"{unit.prefix}{job.name}"
        kept = unit.store.read(job)
        if kept is not None and kept.failure is None:  # finished by a worker that died afterwards
            continue
        report(WorkProgress("running", name))
        record = (
            run_job(job, unit.plan, unit.recordings, unit.store) if reason is None else failed(job, unit.plan, reason)
        )
        unit.store.write(job, record)
        failure = record.failure
        is_complete = is_complete and failure is None
        report(WorkProgress("done", name) if failure is None else WorkProgress("failed", name, failure))
    if is_complete:
        unit.recordings.discard(first.trial, first.seed)
    report(WorkProgress("ended", unit.name))

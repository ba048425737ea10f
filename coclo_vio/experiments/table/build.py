# SPDX-License-Identifier: BSD-3-Clause
"""A table from its plan: remaining jobs are run, all are summarised, and the pages are written."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from coclo_vio import __version__
from coclo_vio.evaluation.paper_table import paper_table
from coclo_vio.experiments.table.cluster import run_on_cluster
from coclo_vio.experiments.table.job_store import JobStore
from coclo_vio.experiments.table.plan import Job, TablePlan
from coclo_vio.experiments.table.recordings import Recordings
from coclo_vio.experiments.table.runner import run_here, run_in_processes
from coclo_vio.experiments.table.summary import summarise
from coclo_vio.experiments.table.table_figures import draw
from coclo_vio.experiments.table.table_page import html, markdown
from coclo_vio.experiments.table.table_record import JobRecord, TableJob, TableRecord, TableTrajectory
from coclo_vio.experiments.table.work_unit import ProgressCallback, WorkUnit, units
from coclo_vio.runs import run_folder
from coclo_vio.values.errors import EvaluationError
from coclo_vio.values.whole_files import write_whole


def unfinished(plan: TablePlan, recordings: Recordings, store: JobStore, *, fresh: bool = False) -> list[WorkUnit]:
    """The remaining work of a table; with ``fresh`` all of it, and finished jobs are removed.

    Raises:
        DatasetError: finished jobs or recordings were made with other settings, or a folder cannot be made.
    """
    recordings.check()
    if fresh:
        store.forget()
    store.prepare()
    kept = store.kept(plan)
    return units(plan, recordings, store, kept)


def run_work(work: Sequence[WorkUnit], workers: int, scheduler: str | None, report: ProgressCallback) -> None:
    """Run the work: on a cluster, in processes, or with one worker here.

    Args:
        work: that remains.
        workers: how many processes.
        scheduler: address of a Dask scheduler; None for this machine.
        report: called at each step.

    Raises:
        CocloError: a process or the cluster is lost, or finished jobs cannot be stored.
    """
    if not work:
        return
    if scheduler is not None:
        run_on_cluster(work, scheduler, report)
    elif workers == 1:
        run_here(work, report)
    else:
        run_in_processes(work, min(workers, len(work)), report)


def write_table(
    plan: TablePlan, store: JobStore, command: str, settings: Mapping[str, Any]
) -> tuple[TableRecord, list[str]]:
    """``table.json``, ``table.md``, ``table.html`` and the figures of a table whose jobs are finished.

    Args:
        plan: of the table.
        store: has its jobs.
        command: line that makes it.
        settings: those beyond the defaults, in plain types.

    Returns:
        The content of ``table.json``, and notes on the pages.

    Raises:
        DatasetError: a file cannot be written, or jobs were made with other settings.
    """
    records = store.kept(plan)
    table = table_record(plan, list(records.values()), command, settings)
    notes: list[str] = []
    with run_folder.writing(store.folder):
        table.write(store.folder / "table.json")
        write_whole(store.folder / "table.md", markdown(table))
        figures: list[Path] = []
        try:
            figures = draw(plan, store, records)
        except EvaluationError as error:
            notes.append(f"table.html is without figures: {error}")
        write_whole(store.folder / "table.html", html(table, figures))
    return table, notes


def table_record(
    plan: TablePlan, records: Sequence[JobRecord], command: str, settings: Mapping[str, Any]
) -> TableRecord:
    """The content of ``table.json`` of these jobs; see ``write_table``."""
    return TableRecord(
        command=command,
        version=__version__,
        settings=dict(settings),
        against="vicon: noisy motion capture, as printed; truth: exact poses of the simulation",
        paper=paper_table(),
        summary=summarise(plan, records),
        jobs=tuple(_short(record) for record in records),
    )


def missing(plan: TablePlan, store: JobStore) -> list[Job]:
    """Jobs without a result, not even a failure."""
    return [job for job in plan.jobs() if store.read(job) is None]


def _short(record: JobRecord) -> TableJob:
    """A job as ``table.json`` has it: its events counted by kind, their times are in the job's own file."""
    estimators = {
        name: TableTrajectory(
            **{key: getattr(trajectory, key) for key in TableTrajectory.model_fields if key != "events"},
            events=dict(Counter(event.kind for event in trajectory.events)),
        )
        for name, trajectory in record.estimators.items()
    }
    return TableJob(
        trial=record.trial,
        seed=record.seed,
        variant=record.variant,
        cpu_s=record.cpu_s,
        failure=record.failure,
        estimators=estimators,
    )

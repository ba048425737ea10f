# SPDX-License-Identifier: BSD-3-Clause
"""A table from its plan: what is left is done, what is there is summed up, and the pages are written."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from coclo_vio import __version__
from coclo_vio.evaluation.paper_table import PAPER_TABLE_I
from coclo_vio.experiments.table.cluster import run_on_cluster
from coclo_vio.experiments.table.table_figures import draw
from coclo_vio.experiments.table.plan import Job, TablePlan
from coclo_vio.experiments.table.recordings import Recordings
from coclo_vio.experiments.table.runner import run_here, run_in_processes
from coclo_vio.experiments.table.job_store import JobStore, Row
from coclo_vio.experiments.table.summary import summarise
from coclo_vio.experiments.table.table_page import html, markdown
from coclo_vio.experiments.table.work_unit import Listener, WorkUnit, units
from coclo_vio.runs import run_folder
from coclo_vio.values.errors import EvaluationError


def unfinished(plan: TablePlan, recordings: Recordings, store: JobStore, *, fresh: bool = False) -> list[WorkUnit]:
    """What is left to do of a table; with ``fresh`` all, and nothing is kept.

    Raises:
        DatasetError: finished jobs or recordings were made otherwise, or a folder cannot be made.
    """
    recordings.check()
    if fresh:
        store.forget()
    store.prepare()
    kept = store.kept(plan)
    return units(plan, recordings, store, kept)


def do(work: Sequence[WorkUnit], workers: int, scheduler: str | None, tell: Listener) -> None:
    """Do the work: on a cluster, in processes, or with one worker here.

    Args:
        work: what is left.
        workers: how many processes.
        scheduler: address of a Dask scheduler; None for this machine.
        tell: called with what is going on.

    Raises:
        CocloError: a process or the cluster is lost, or finished jobs cannot be kept.
    """
    if not work:
        return
    if scheduler is not None:
        run_on_cluster(work, scheduler, tell)
    elif workers == 1:
        run_here(work, tell)
    else:
        run_in_processes(work, min(workers, len(work)), tell)


def write_table(
    plan: TablePlan, store: JobStore, command: str, settings: Mapping[str, Any]
) -> tuple[dict[str, Any], list[str]]:
    """``table.json``, ``table.md``, ``table.html`` and the figures of a table whose jobs are finished.

    Args:
        plan: of the table.
        store: has its jobs.
        command: line that makes it.
        settings: what was set beyond the defaults, in plain types.

    Returns:
        What ``table.json`` holds, and what a reader has to know of the pages.

    Raises:
        DatasetError: a file cannot be written, or jobs were made with other settings.
    """
    rows = store.kept(plan)
    table = {
        "command": command,
        "version": __version__,
        "settings": dict(settings),
        "against": "vicon: noisy motion capture, as printed; truth: exact poses of the simulation",
        "paper": {trial: dict(told) for trial, told in PAPER_TABLE_I.items()},
        "summary": summarise(plan, list(rows.values())),
        "jobs": [_short(row) for row in rows.values()],
    }
    notes: list[str] = []
    with run_folder.writing(store.folder):
        run_folder.write_json(store.folder / "table.json", table)
        (store.folder / "table.md").write_text(markdown(table), encoding="utf-8")
        figures: list[Path] = []
        try:
            figures = draw(plan, store, rows)
        except EvaluationError as error:
            notes.append(f"table.html is without figures: {error}")
        (store.folder / "table.html").write_text(html(table, figures), encoding="utf-8")
    return table, notes


def missing(plan: TablePlan, store: JobStore) -> list[Job]:
    """Jobs that have no result, not even a failure."""
    return [job for job in plan.jobs() if store.read(job) is None]


def _short(row: Row) -> Row:
    """A job's row with its events counted by kind: when each was is in the job's own file."""
    estimators = {
        name: {**told, "events": dict(Counter(event["kind"] for event in told["events"]))}
        for name, told in row["estimators"].items()
    }
    return {key: value for key, value in row.items() if key != "fingerprint"} | {"estimators": estimators}

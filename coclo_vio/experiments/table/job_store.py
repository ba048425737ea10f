# SPDX-License-Identifier: BSD-3-Clause
"""Finished jobs on the disk: one JSON file a job in ``jobs/``, there only once it is whole.

Beside it ``runs/<recording>/<variant>/`` keeps the trajectories of each, for the figures.
"""

import json
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coclo_vio.experiments.table.plan import Job, TablePlan
from coclo_vio.runs import run_folder
from coclo_vio.values.errors import DatasetError

Row = dict[str, Any]


@dataclass(frozen=True, slots=True)
class JobStore:
    """The folder of a table; a job's file appears at once and whole."""

    folder: Path

    def prepare(self) -> None:
        """Make the folders.

        Raises:
            DatasetError: they cannot be made.
        """
        run_folder.prepare(self.folder / "jobs")
        run_folder.prepare(self.folder / "runs")

    def run_of(self, job: Job) -> Path:
        """The run folder of a job."""
        return self.folder / "runs" / job.recording / job.variant.file_name

    def write(self, job: Job, row: Mapping[str, Any]) -> None:
        """Keep what came of a job.

        Raises:
            DatasetError: the disk does not take it.
        """
        path = self._path(job)
        half = path.with_name(f".{path.name}.{os.getpid()}")
        with run_folder.writing(self.folder):
            try:
                run_folder.write_json(half, row)
                half.replace(path)
            finally:
                half.unlink(missing_ok=True)

    def read(self, job: Job) -> Row | None:
        """What came of a job, None where it is not finished."""
        try:
            row = json.loads(self._path(job).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return row if isinstance(row, dict) else None

    def kept(self, plan: TablePlan) -> dict[Job, Row]:
        """The finished jobs of a plan.

        Raises:
            DatasetError: some were made with other settings, so that one table of all would be of nothing.
        """
        rows = {job: row for job in plan.jobs() if (row := self.read(job)) is not None}
        differing: dict[Job, set[str]] = {}
        for job, row in rows.items():
            made, wanted = row.get("fingerprint") or {}, plan.fingerprint(job)
            if made != wanted:
                differing[job] = {key for key in wanted if made.get(key) != wanted[key]}
        if differing:
            what = ", ".join(sorted(set().union(*differing.values())))
            raise DatasetError(
                f"{len(differing)} of the {len(rows)} finished jobs in {self.folder} were made otherwise ({what}); "
                "give another folder with -o, or --fresh to forget them and begin anew"
            )
        return rows

    def forget(self) -> None:
        """Remove all finished jobs and their trajectories."""
        with run_folder.writing(self.folder):
            for name in ("jobs", "runs"):
                if (self.folder / name).is_dir():
                    shutil.rmtree(self.folder / name)

    def _path(self, job: Job) -> Path:
        return self.folder / "jobs" / f"{job.name}.json"

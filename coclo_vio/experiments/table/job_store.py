# SPDX-License-Identifier: BSD-3-Clause
"""Finished jobs on the disk: one JSON file a job in ``jobs/``, there only once it is whole.

Beside it ``runs/<recording>/<variant>/`` keeps the trajectories of each, for the figures.
"""

import json
import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from coclo_vio.experiments.table.plan import Job, TablePlan
from coclo_vio.experiments.table.table_record import Fingerprint, JobRecord
from coclo_vio.runs import run_folder
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.record import Record

JobResult = TypeVar("JobResult", bound=Record)


@dataclass(frozen=True, slots=True)
class JobFiles(Generic[JobResult]):
    """A folder with a file of each finished job, ``<name>.json``, which appears at once and whole.

    Attributes:
        folder: of the files.
        kind: what a file holds.
    """

    folder: Path
    kind: type[JobResult]

    def prepare(self) -> None:
        """Make the folder.

        Raises:
            DatasetError: it cannot be made.
        """
        run_folder.prepare(self.folder)

    def write(self, name: str, result: JobResult) -> None:
        """Keep the result of a job.

        Raises:
            DatasetError: it cannot be written.
        """
        path = self.folder / f"{name}.json"
        half = path.with_name(f".{path.name}.{os.getpid()}")
        with run_folder.writing(self.folder):
            try:
                result.write(half)
                half.replace(path)
            finally:
                half.unlink(missing_ok=True)

    def read(self, name: str) -> JobResult | None:
        """The result of a job, None where it is not finished: no file, or not the whole of one.

        Raises:
            DatasetError: it was written by another release.
        """
        path = self.folder / f"{name}.json"
        try:
            values = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return self.kind.parse(values, str(path))


@dataclass(frozen=True, slots=True)
class JobStore:
    """The folder of a table; a job's file appears at once and whole."""

    folder: Path

    def prepare(self) -> None:
        """Make the folders.

        Raises:
            DatasetError: they cannot be made.
        """
        self._files.prepare()
        run_folder.prepare(self.folder / "runs")

    def run_of(self, job: Job) -> Path:
        """The run folder of a job."""
        return self.folder / "runs" / job.recording / job.variant.file_name

    def write(self, job: Job, record: JobRecord) -> None:
        """Keep the result of a job.

        Raises:
            DatasetError: it cannot be written.
        """
        self._files.write(job.name, record)

    def read(self, job: Job) -> JobRecord | None:
        """The result of a job, None where it is not finished: no file, or not the whole of one.

        Raises:
            DatasetError: it was written by another release.
        """
        return self._files.read(job.name)

    def kept(self, plan: TablePlan) -> dict[Job, JobRecord]:
        """The finished jobs of a plan.

        Raises:
            DatasetError: some were made with other settings or by another release, so they make no table together.
        """
        records = {job: record for job in plan.jobs() if (record := self.read(job)) is not None}
        differing: dict[Job, set[str]] = {}
        for job, record in records.items():
            planned = plan.fingerprint(job)
            if record.fingerprint != planned:
                differing[job] = {
                    key for key in Fingerprint.model_fields if getattr(record.fingerprint, key) != getattr(planned, key)
                }
        if differing:
            settings = ", ".join(sorted(set().union(*differing.values())))
            raise DatasetError(
                f"{len(differing)} of the {len(records)} finished jobs in {self.folder} were made with other settings "
                f"({settings}); choose another folder with -o, or --fresh to remove them and begin anew"
            )
        return records

    def forget_run(self, job: Job) -> None:
        """Remove the trajectories of a job; its result stays."""
        shutil.rmtree(self.run_of(job), ignore_errors=True)

    def forget(self) -> None:
        """Remove all finished jobs and their trajectories."""
        with run_folder.writing(self.folder):
            for name in ("jobs", "runs"):
                if (self.folder / name).is_dir():
                    shutil.rmtree(self.folder / name)

    @property
    def _files(self) -> JobFiles[JobRecord]:
        return JobFiles(self.folder / "jobs", JobRecord)

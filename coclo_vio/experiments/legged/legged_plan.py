# SPDX-License-Identifier: BSD-3-Clause
"""What the benchmark consists of, and what of it is left to do."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from itertools import groupby
from pathlib import Path

from coclo_vio.experiments.legged.legged_job import LeggedJob, recorded, run_legged_job
from coclo_vio.experiments.legged.legged_record import LeggedJobRecord
from coclo_vio.experiments.legged.legged_recording import LeggedRecording, LeggedRecordings
from coclo_vio.experiments.legged.smoother_mode import GTSAM_SMOOTHER
from coclo_vio.experiments.results.provenance import Provenance
from coclo_vio.experiments.resumable_jobs import CODE_OF_RECORDINGS, commit_of_code
from coclo_vio.experiments.studies.study import Row
from coclo_vio.experiments.table.job_store import JobFiles

LEG_ESTIMATORS = ("coclo", "coclo_paper", "inekf", GTSAM_SMOOTHER, "naive", "naive_rolling")
IMAGE_ESTIMATORS = ("vins", "combined", "tight")
IMPACT_ESTIMATORS = ("coclo", "inekf")


@dataclass(frozen=True, slots=True)
class LeggedPlan:
    """Everything that decides the results of the benchmark.

    Attributes:
        folder: of results and recordings.
        recordings: all of them.
        commit: of the code; results of each are in a folder of its own.
        recorder_commit: of the code that makes recordings, likewise.
    """

    folder: Path
    recordings: tuple[LeggedRecording, ...]
    commit: str = field(default_factory=commit_of_code)
    recorder_commit: str = field(default_factory=lambda: commit_of_code(code=CODE_OF_RECORDINGS))

    @property
    def files(self) -> JobFiles[LeggedJobRecord]:
        """The finished jobs."""
        return JobFiles(self.folder / self.commit / "jobs", LeggedJobRecord)

    @property
    def places(self) -> LeggedRecordings:
        """The simulated recordings."""
        return LeggedRecordings(self.folder / "recordings" / self.recorder_commit)

    def jobs(self, only: str = "") -> Iterator[LeggedJob]:
        """The jobs in the order of work.

        Args:
            only: those whose name has this in it, or matches it as a pattern of file names.
        """
        for recording in self.recordings:
            estimators = IMPACT_ESTIMATORS if recording.kind == "impacts" else LEG_ESTIMATORS
            for estimator in (*estimators, *(IMAGE_ESTIMATORS if recording.images else ())):
                job = LeggedJob(recording, estimator)
                if fnmatchcase(job.name, f"*{only}*"):
                    yield job

    def work(self, only: str = "", estimators: Collection[str] = ()) -> list["LeggedUnit"]:
        """What is left to do, a recording each; failed jobs are finished ones, those without a recording are not.

        Args:
            only: as of ``jobs``.
            estimators: those whose jobs are run; all if none is named.

        Raises:
            DatasetError: a folder cannot be made, or a job was written by another release.
        """
        self.files.prepare()
        wanted = [job for job in self.jobs(only) if not estimators or job.estimator in estimators]
        left = [job for job in wanted if not self._is_finished(job)]
        return [
            LeggedUnit(tuple(jobs), self.places, self.files) for _, jobs in groupby(left, lambda job: job.recording)
        ]

    def finished(self) -> list[LeggedJobRecord]:
        """The results of the finished jobs, in the order of work.

        Raises:
            DatasetError: a job was written by another release.
        """
        records = (self.files.read(job.name) for job in self.jobs())
        return [record for record in records if record is not None]

    def _is_finished(self, job: LeggedJob) -> bool:
        record = self.files.read(job.name)
        return record is not None and record.not_recorded is None


@dataclass(frozen=True, slots=True)
class LeggedUnit:
    """A recording and its unfinished jobs; can be pickled for another process."""

    jobs: tuple[LeggedJob, ...]
    places: LeggedRecordings
    files: JobFiles[LeggedJobRecord]

    def run(self, origin: Provenance) -> Row:
        """Make the recording and run the jobs, each stored as soon as it is finished; lines of progress.

        Raises:
            DatasetError: a finished job cannot be stored.
        """
        found = recorded(self.jobs[0].recording, self.places)
        lines = []
        for job in self.jobs:
            record = run_legged_job(job, found, self.places, origin)
            self.files.write(job.name, record)
            lines.append(f"{job.name}: {_outcome(record)}")
        return {"lines": lines}


def _outcome(record: LeggedJobRecord) -> str:
    """A finished job in a line."""
    if record.not_recorded is not None:
        return f"not recorded: {record.not_recorded}"
    parts = []
    for name, trajectory in record.trajectories.items():
        figures = trajectory.figures
        if trajectory.failure is not None or figures is None:
            parts.append(f"{name} failed: {trajectory.failure}")
        else:
            values = (figures.drift_percent, figures.rpe_1m_percent, figures.anees_pose)
            parts.append(f"{name} drift {_short(values[0])} %, RPE {_short(values[1])} %, ANEES {_short(values[2])}")
    return "; ".join(parts)


def _short(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"

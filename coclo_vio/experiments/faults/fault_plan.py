# SPDX-License-Identifier: BSD-3-Clause
"""What the matrix consists of, and what of it is left to do."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from itertools import groupby
from pathlib import Path

from coclo_vio.experiments.faults.fault_cases import CASES, NOMINAL
from coclo_vio.experiments.faults.fault_job import FaultJob, run_fault_job
from coclo_vio.experiments.faults.fault_record import FaultJobRecord
from coclo_vio.experiments.faults.fault_recording import FaultRecording
from coclo_vio.experiments.results.provenance import Provenance
from coclo_vio.experiments.resumable_jobs import CODE_OF_RECORDINGS, commit_of_code
from coclo_vio.experiments.studies.study import Row
from coclo_vio.experiments.table.job import reason_of
from coclo_vio.experiments.table.job_store import JobFiles


@dataclass(frozen=True, slots=True)
class FaultPlan:
    """Everything that decides the results of the matrix.

    Attributes:
        folder: of results and recordings.
        robots: whose recordings.
        seeds: of the recordings.
        modes: by name.
        commit: of the code; results of each are in a folder of its own.
        recorder_commit: of the code that makes recordings, likewise.
    """

    folder: Path
    robots: tuple[str, ...]
    seeds: tuple[int, ...]
    modes: tuple[str, ...]
    commit: str = field(default_factory=commit_of_code)
    recorder_commit: str = field(default_factory=lambda: commit_of_code(code=CODE_OF_RECORDINGS))

    @property
    def files(self) -> JobFiles[FaultJobRecord]:
        """The finished jobs."""
        return JobFiles(self.folder / self.commit / "jobs", FaultJobRecord)

    def jobs(self, only: str = "") -> Iterator[FaultJob]:
        """The jobs in the order of work: each seed through all faults, those without a fault always.

        Args:
            only: those whose name has this in it, or matches it as a pattern of file names.
        """
        places = self.folder / "recordings" / self.recorder_commit
        for seed in self.seeds:
            for robot in self.robots:
                recording = FaultRecording(robot, seed, places)
                for case in CASES.values():
                    for job in (FaultJob(recording, case, mode) for mode in self.modes):
                        if case.name == NOMINAL or fnmatchcase(job.name, f"*{only}*"):
                            yield job

    def work(self, only: str = "") -> list["FaultUnit"]:
        """What is left to do, a fault of a recording each; a job without a run is not finished.

        Raises:
            DatasetError: a folder cannot be made, or a job was written by another release.
        """
        self.files.prepare()
        left = [job for job in self.jobs(only) if not self._is_finished(job)]
        groups = groupby(left, lambda job: (job.recording, job.case))
        return [FaultUnit(tuple(jobs), self.files) for _, jobs in groups]

    def finished(self) -> list[FaultJobRecord]:
        """The results of the finished jobs, in the order of work.

        Raises:
            DatasetError: a job was written by another release.
        """
        records = (self.files.read(job.name) for job in self.jobs())
        return [record for record in records if record is not None]

    def _is_finished(self, job: FaultJob) -> bool:
        record = self.files.read(job.name)
        return record is not None and record.not_run is None


@dataclass(frozen=True, slots=True)
class FaultUnit:
    """One fault of a recording and its unfinished jobs; can be pickled for another process."""

    jobs: tuple[FaultJob, ...]
    files: JobFiles[FaultJobRecord]

    @property
    def is_nominal(self) -> bool:
        """Whether it is the one without a fault, which the others are compared with."""
        return self.jobs[0].case.name == NOMINAL

    def run(self, origin: Provenance) -> Row:
        """Make the recording and run the jobs, each stored as soon as it is finished; lines of progress.

        Raises:
            DatasetError: a finished job cannot be stored.
        """
        recording, reason = self.jobs[0].recording, None
        try:
            recording.make()
        except Exception as error:  # of whatever kind: a recording that fails must not end the others
            reason = reason_of(error, recording.folder)
        lines = []
        for job in self.jobs:
            nominal = None if self.is_nominal else self.files.read(job.nominal_name)
            record = _not_recorded(job, reason, origin) if reason else run_fault_job(job, nominal, origin)
            self.files.write(job.name, record)
            lines.append(f"{job.name}: {_outcome(record)}")
        return {"lines": lines}


def _not_recorded(job: FaultJob, reason: str, origin: Provenance) -> FaultJobRecord:
    return FaultJobRecord(
        robot=job.recording.robot,
        seed=job.recording.seed,
        case=job.case.name,
        mode=job.mode,
        origin=origin,
        not_run=f"not recorded: {reason}",
        is_as_nominal=False,
        trajectories={},
    )


def _outcome(record: FaultJobRecord) -> str:
    """A finished job in a line."""
    if record.not_run is not None:
        return record.not_run
    if record.is_as_nominal:
        return "as without the fault"
    parts = []
    for name, trajectory in record.trajectories.items():
        figures, events = trajectory.figures, ", ".join(trajectory.events)
        values = "-" if figures is None else f"{_short(figures.drift_percent)} %, ANEES {_short(figures.anees_pose)}"
        failed = "" if trajectory.failure is None else f", {trajectory.failure}"
        parts.append(f"{name} {values}{failed} ({events})")
    return "; ".join(parts)


def _short(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"

# SPDX-License-Identifier: BSD-3-Clause
"""The files of a table: one for each finished job, and ``table.json`` with the summary of all."""

from typing import Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict

from coclo_vio.evaluation.evaluation_record import EvaluationRecord
from coclo_vio.runs.run_record import KeyframeSummary
from coclo_vio.values.record import Record

Reference = Literal["vicon", "truth"]
REFERENCES: tuple[Reference, Reference] = ("vicon", "truth")
"""What estimates are compared with: noisy motion capture, and the exact poses of the simulation."""


class _Part(BaseModel):
    """A part of a record."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Fingerprint(_Part):
    """What decides the result of a job: another fingerprint is another result.

    Attributes:
        version: of the package.
        configuration: digest of the estimators' configuration.
        simulation: digest of the settings of the trial.
        ideal: whether the robot is exactly as described.
        trial: name of the terrain.
        seed: of the trial.
        variant: name of the variant.
        commit: of the code; empty where it does not decide which results belong together.
    """

    version: str
    configuration: str
    simulation: str
    ideal: bool
    trial: str
    seed: int
    variant: str
    commit: str = ""


class EventTime(_Part):
    """When something happened in an estimator, s since the recording began."""

    kind: str
    time_s: float


class _Trajectory(_Part):
    """One trajectory of a job.

    Attributes:
        vicon: against noisy motion capture; None where it could not be evaluated.
        truth: against the exact poses; None where it could not be evaluated.
        realtime_factor: seconds of recording per second of computing.
        estimates: number of poses.
        counts: of the estimator.
        keyframes: of a visual estimator.
        failure: why there is no result, or not all of it; None otherwise.
    """

    vicon: EvaluationRecord | None
    truth: EvaluationRecord | None
    realtime_factor: float | None
    estimates: int
    counts: dict[str, int]
    keyframes: KeyframeSummary | None
    failure: str | None

    def against(self, reference: Reference) -> EvaluationRecord | None:
        """The evaluation against a reference."""
        return self.vicon if reference == "vicon" else self.truth


class JobTrajectory(_Trajectory):
    """One trajectory of a job, with its events in order."""

    events: tuple[EventTime, ...]


class TableTrajectory(_Trajectory):
    """One trajectory of a job as ``table.json`` has it: events are counted by kind."""

    events: dict[str, int]


class JobRecord(Record):
    """``jobs/<job>.json``: what came of a job.

    Attributes:
        fingerprint: of the job.
        trial: name of the terrain.
        seed: of the trial.
        variant: name of the variant.
        cpu_s: processor time, s; None where it did not run.
        failure: of the first trajectory that failed, None where all is well.
        estimators: by trajectory.
    """

    next_step: ClassVar[str] = "make the table again with --fresh"

    schema_version: Literal[1] = 1
    fingerprint: Fingerprint
    trial: str
    seed: int
    variant: str
    cpu_s: float | None
    failure: str | None
    estimators: dict[str, JobTrajectory]


class TableJob(_Part):
    """A job as ``table.json`` has it, without its fingerprint; see ``JobRecord``."""

    trial: str
    seed: int
    variant: str
    cpu_s: float | None
    failure: str | None
    estimators: dict[str, TableTrajectory]


class Spread(_Part):
    """Median, 10 and 90 % over seeds, and the worst seed."""

    median: float
    p10: float
    p90: float
    worst: float


class FigureSpreads(_Part):
    """Spreads of the figures against one reference, None without any; yaw by its size."""

    drift_percent: Spread | None
    rpe_1m_percent: Spread | None
    paper_drift_percent: Spread | None
    ate_m: Spread | None
    anees_pose: Spread | None
    velocity_rmse_mps: Spread | None
    yaw_drift_deg: Spread | None


class TrajectorySummary(_Part):
    """One trajectory over all seeds: how many seeds, how many failures, and the spreads of the others."""

    n: int
    failures: int
    vicon: FigureSpreads
    truth: FigureSpreads
    realtime_factor: Spread | None


class WinCount(_Part):
    """How many of so many pairs are won; the share is None without a pair."""

    wins: int
    of: int
    share: float | None


class Wins(_Part):
    """Wins by drift and by RPE."""

    drift: WinCount
    rpe: WinCount


class ErrorRatio(_Part):
    """Median over seeds of one error over another, None without any, and whether it is within the tolerance."""

    median_ratio: float | None
    holds: bool


class ErrorRatios(_Part):
    """Ratios of drift and of RPE."""

    drift: ErrorRatio
    rpe: ErrorRatio


class BetterBy(_Part):
    """Whether the first of two trajectories is better by drift and by RPE; None where it is not known."""

    drift: bool | None
    rpe: bool | None


class PaperComparison(_Part):
    """Two trajectories of which the first is to be better, on one terrain, beside what the paper found.

    Attributes:
        trial: name of the terrain.
        first: name of the trajectory.
        second: name of the other.
        drift: medians of both, percent.
        rpe: medians of both, percent.
        better: whether the first is better.
        paper: whether the paper found it better; None where the paper has no figure.
        sentence: all this in a sentence.
    """

    trial: str
    first: str
    second: str
    drift: tuple[float | None, float | None]
    rpe: tuple[float | None, float | None]
    better: BetterBy
    paper: bool | None
    sentence: str


class TableSummary(_Part):
    """What all jobs come to.

    Attributes:
        trials: by terrain and trajectory.
        wins: of fused trajectories over their standalone counterparts, by fused trajectory, reference, and terrain or
            ``all``.
        against_the_better: errors of fused trajectories over those of the better standalone one, by fused trajectory,
            terrain and reference.
        policies: by terrain, feedback policy and trajectory.
        against_the_paper: for each pair and terrain.
    """

    trials: dict[str, dict[str, TrajectorySummary]]
    wins: dict[str, dict[Reference, dict[str, Wins]]]
    against_the_better: dict[str, dict[str, dict[Reference, ErrorRatios]]]
    policies: dict[str, dict[str, dict[str, TrajectorySummary]]]
    against_the_paper: tuple[PaperComparison, ...]


class TableRecord(Record):
    """``table.json``.

    Attributes:
        command: line that makes the table.
        version: of the package.
        settings: those beyond the defaults.
        against: what the two references are.
        paper: the paper's drift, percent of net displacement, by terrain and trajectory.
        summary: of all jobs.
        jobs: all of them.
    """

    next_step: ClassVar[str] = "make the table again"

    schema_version: Literal[1] = 1
    command: str
    version: str
    settings: dict[str, Any]
    against: str
    paper: dict[str, dict[str, float]]
    summary: TableSummary
    jobs: tuple[TableJob, ...]

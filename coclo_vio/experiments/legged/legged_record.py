# SPDX-License-Identifier: BSD-3-Clause
"""The files of the benchmark: one for each finished job, and ``legged.json``, the committed record of all."""

from typing import ClassVar, Literal

from pydantic import BaseModel, ConfigDict

from coclo_vio.experiments.results.provenance import Provenance
from coclo_vio.values.record import Record

RecordingKind = Literal["trot", "impacts", "walk", "log"]
"""A trot, a trot of which impacts are varied, a walk of the Daisy, or a real log."""


class _Part(BaseModel):
    """A part of a record."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class ImpactStrength(_Part):
    """How far the size of the specific force is from gravity in motion, m/s^2: standard deviation, 99th percentile."""

    std_mps2: float
    peak_mps2: float


class LeggedFigures(_Part):
    """One trajectory against the truth of a simulation or the motion capture of a log; None where not defined.

    Attributes:
        drift_percent: error at the end over the path.
        rpe_1m_percent: median error over pieces of one metre.
        ate_m: RMS position error, aligned in yaw and position.
        ate_planar_m: the same of x and y.
        path_ratio: estimated over true length of the path.
        yaw_drift_deg: by its size.
        anees_pose: of the pose; 1 is consistent.
        anees_1m: of the position over pieces of one metre.
        coverage: share of the recording with an estimate.
    """

    drift_percent: float | None
    rpe_1m_percent: float | None
    ate_m: float | None
    ate_planar_m: float | None
    path_ratio: float | None
    yaw_drift_deg: float | None
    anees_pose: float | None
    anees_1m: float | None
    coverage: float | None


ERRORS = ("drift_percent", "rpe_1m_percent", "ate_m", "ate_planar_m", "yaw_drift_deg")
"""The figures that are infinite where a run failed."""


class LeggedTrajectory(_Part):
    """One trajectory of a job: its figures, and why there are none or not of all of it."""

    figures: LeggedFigures | None
    failure: str | None


class LeggedJobRecord(Record):
    """``jobs/<recording>-<estimator>.json``: what came of a job.

    Attributes:
        kind: of the recording.
        group: of the recording.
        seed: of the recording; None of a real log.
        estimator: name of the mode.
        origin: commit of the code, date, machine, versions and command.
        not_recorded: why there is no recording; None where there is one.
        impacts: how hard feet land in it.
        cpu_ms_per_joint_sample: processor time of the estimator; None where it did not run.
        trajectories: by name.
    """

    next_step: ClassVar[str] = "remove the file and run the benchmark again"

    schema_version: Literal[1] = 1
    kind: RecordingKind
    group: str
    seed: int | None
    estimator: str
    origin: Provenance
    not_recorded: str | None
    impacts: ImpactStrength | None
    cpu_ms_per_joint_sample: float | None
    trajectories: dict[str, LeggedTrajectory]


class LeggedRow(_Part):
    """One trajectory over all seeds of a recording: medians, a failed run with infinite errors.

    Attributes:
        kind: of the recording.
        group: of the recording.
        trajectory: its name.
        runs: how many.
        failures: of them.
        reasons: of the failures, each once.
        figures: medians; an error is None where most runs failed.
        cpu_ms_per_joint_sample: of the mode that gives the trajectory.
        impacts: of the recordings.
    """

    kind: RecordingKind
    group: str
    trajectory: str
    runs: int
    failures: int
    reasons: tuple[str, ...]
    figures: LeggedFigures
    cpu_ms_per_joint_sample: float | None
    impacts: ImpactStrength | None


class LeggedRecord(Record):
    """``legged.json``.

    Attributes:
        command: line that runs the benchmark.
        commit: of the code that decides results.
        seeds: of the simulated recordings.
        rows: by recording and trajectory.
        not_recorded: why there is no recording, by its name.
        finished: how many of the jobs.
        planned: how many there are.
    """

    next_step: ClassVar[str] = "publish again with `python -m coclo_vio.experiments.legged --publish`"

    schema_version: Literal[1] = 1
    command: str
    commit: str
    seeds: tuple[int, ...]
    rows: tuple[LeggedRow, ...]
    not_recorded: dict[str, str]
    finished: int
    planned: int

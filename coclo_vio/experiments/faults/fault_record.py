# SPDX-License-Identifier: BSD-3-Clause
"""The files of the matrix: one for each finished job, and ``faults.json``, the committed record of all."""

from typing import ClassVar, Literal

from pydantic import BaseModel, ConfigDict

from coclo_vio.experiments.results.provenance import Provenance
from coclo_vio.values.record import Record


class _Part(BaseModel):
    """A part of a record."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class FaultFigures(_Part):
    """One trajectory against the exact truth; None where not defined.

    Attributes:
        drift_percent: error at the end over the path.
        rpe_1m_percent: median error over pieces of one metre.
        anees_pose: of the pose; 1 is consistent.
        coverage: share of the recording with an estimate.
        worst_second_m: largest error of the motion within a second.
        usual_m: 95th percentile of these errors.
        recovery_s: time after the fault from which these errors stay for a second within the 95th percentile of the
            same estimator without a fault; None where it has no end, or never.
        has_recovered: whether they do; None where the fault has no end.
    """

    drift_percent: float | None
    rpe_1m_percent: float | None
    anees_pose: float | None
    coverage: float | None
    worst_second_m: float
    usual_m: float
    recovery_s: float | None = None
    has_recovered: bool | None = None


class FaultTrajectory(_Part):
    """One trajectory of a job.

    Attributes:
        figures: against the truth; None without an estimate.
        failure: why the run stopped early or could not be evaluated; None where neither.
        unreadable: why ``evaluate`` does not read the files of the run; None where it does.
        events: how many of each kind.
        sensors: streams that the mode read.
    """

    figures: FaultFigures | None
    failure: str | None
    unreadable: str | None
    events: dict[str, int]
    sensors: tuple[str, ...]


class FaultJobRecord(Record):
    """``jobs/<robot>_<seed>-<case>-<mode>.json``: what came of a job.

    Attributes:
        robot: of the recording.
        seed: of the recording.
        case: name of the fault.
        mode: that was run.
        origin: commit of the code, date, machine, versions and command.
        not_run: why there was no run; None where there was one.
        is_as_nominal: whether the mode reads nothing that the fault is on, so that figures are those without it.
        trajectories: by name.
    """

    next_step: ClassVar[str] = "remove the file and run the matrix again"

    schema_version: Literal[1] = 1
    robot: str
    seed: int
    case: str
    mode: str
    origin: Provenance
    not_run: str | None
    is_as_nominal: bool
    trajectories: dict[str, FaultTrajectory]


class FaultRow(_Part):
    """One trajectory of a robot with a fault, the worst over seeds.

    Attributes:
        robot: which.
        kind: of the fault.
        case: the fault.
        mode: that gives the trajectory.
        trajectory: its name.
        seeds: how many.
        failures: reasons of runs that stopped early, each once.
        unreadable: reasons why ``evaluate`` does not read a run, each once.
        is_as_nominal: whether the fault is on nothing that the mode reads.
        drift_percent: the largest; None where a run has none.
        worst_second_m: the largest.
        recovery_s: the longest; None where there is none, or never.
        never_recovered: of the seeds.
        anees_pose: the largest.
        coverage: the smallest.
        events: kinds that the run without a fault does not have as often, with the largest number of each.
        has_healthy_half: whether legs or cameras have all their streams without the fault.
        is_silent: wrong by more than 5 % of the way, or without an estimate, and no event names anything.
        is_worse: ``combined`` with a healthy half drifts by more than 3 % and three times as far as without the fault.
        is_unexplained: with a healthy half an ANEES above 4 without an event.
    """

    robot: str
    kind: str
    case: str
    mode: str
    trajectory: str
    seeds: int
    failures: tuple[str, ...]
    unreadable: tuple[str, ...]
    is_as_nominal: bool
    drift_percent: float | None
    worst_second_m: float | None
    recovery_s: float | None
    never_recovered: int
    anees_pose: float | None
    coverage: float | None
    events: dict[str, int]
    has_healthy_half: bool
    is_silent: bool
    is_worse: bool
    is_unexplained: bool


class FaultsRecord(Record):
    """``faults.json``.

    Attributes:
        command: line that runs the matrix.
        commit: of the code that decides results.
        seeds: of the recordings, by robot.
        rows: by robot, fault and trajectory.
        not_run: why there was no run, by job.
        finished: how many of the jobs.
        planned: how many there are.
    """

    next_step: ClassVar[str] = "publish again with `python -m coclo_vio.experiments.faults --publish`"

    schema_version: Literal[1] = 1
    command: str
    commit: str
    seeds: dict[str, tuple[int, ...]]
    rows: tuple[FaultRow, ...]
    not_run: dict[str, str]
    finished: int
    planned: int

# SPDX-License-Identifier: BSD-3-Clause
"""From finished jobs to the committed record: the worst over seeds, and what is wrong, silent or unexplained."""

from collections import defaultdict
from collections.abc import Iterable, Sequence

from coclo_vio.experiments.faults.fault_cases import CASES, KINDS, NOMINAL
from coclo_vio.experiments.faults.fault_plan import FaultPlan
from coclo_vio.experiments.faults.fault_record import (
    FaultJobRecord,
    FaultRow,
    FaultsRecord,
    FaultTrajectory,
)
from coclo_vio.values.errors import DatasetError

WRONG_PERCENT = 5.0
"""Drift above which a run without an event is silent."""
WORSE_PERCENT, WORSE_TIMES = 3.0, 3.0
"""Drift, and how many times that without a fault, above which ``combined`` is worse than it may be."""
MOST_ANEES = 4.0
"""ANEES above which an event has to say why."""
LEAST_COVERAGE = 0.9
_COMBINED = "combined"
_HALVES = ("coclo", "vins")

_Pair = tuple[FaultTrajectory, FaultTrajectory | None]  # with the fault, and without it
_Key = tuple[str, str, str, str]  # robot, case, mode, trajectory


def summarise(plan: FaultPlan, command: str) -> FaultsRecord:
    """The record of all finished jobs of a plan.

    Args:
        plan: of the matrix.
        command: line that runs it.

    Raises:
        DatasetError: no job is finished, or one was written by another release.
    """
    records = plan.finished()
    if not records:
        raise DatasetError(f"no job of commit {plan.commit} is finished in {plan.folder}; run the matrix first")
    run = [record for record in records if record.not_run is None]
    seeds = {robot: tuple(sorted({each.seed for each in run if each.robot == robot})) for robot in plan.robots}
    return FaultsRecord(
        command=command,
        commit=plan.commit,
        seeds={robot: found for robot, found in seeds.items() if found},
        rows=tuple(rows_of(run)),
        not_run={_title(each): each.not_run for each in records if each.not_run is not None},
        finished=len(run),
        planned=sum(1 for _ in plan.jobs()),
    )


def rows_of(records: Sequence[FaultJobRecord]) -> list[FaultRow]:
    """A row for each robot, fault and trajectory, in the order of the jobs."""
    nominal = {
        (each.robot, each.seed, name): trajectory
        for each in records
        if each.case == NOMINAL
        for name, trajectory in each.trajectories.items()
    }
    pairs: dict[_Key, list[_Pair]] = defaultdict(list)
    as_nominal: dict[_Key, bool] = {}
    for each in records:
        for name, trajectory in each.trajectories.items():
            key = (each.robot, each.case, each.mode, name)
            before = None if each.case == NOMINAL else nominal.get((each.robot, each.seed, name))
            pairs[key].append((trajectory, before))
            as_nominal[key] = as_nominal.get(key, True) and each.is_as_nominal
    streams = {robot: _streams_of_halves(records, robot) for robot in {each.robot for each in records}}
    return [
        _row(key, of_row, is_as_nominal=as_nominal[key], has_healthy_half=_has_healthy_half(key[1], streams[key[0]]))
        for key, of_row in pairs.items()
    ]


def _streams_of_halves(records: Iterable[FaultJobRecord], robot: str) -> list[set[str]]:
    """The streams that legs alone and cameras alone read of a robot's recording."""
    found = {half: set[str]() for half in _HALVES}
    for each in records:
        if each.robot == robot and each.case == NOMINAL and each.mode in found:
            found[each.mode] |= {sensor for one in each.trajectories.values() for sensor in one.sensors}
    return [streams for streams in found.values() if streams]


def _has_healthy_half(case: str, halves: Sequence[set[str]]) -> bool:
    return any(not streams & set(CASES[case].streams) for streams in halves)


def _row(key: _Key, pairs: Sequence[_Pair], *, is_as_nominal: bool, has_healthy_half: bool) -> FaultRow:
    robot, case, mode, name = key
    figures = [trajectory.figures for trajectory, _ in pairs if trajectory.figures is not None]
    failures = [trajectory.failure for trajectory, _ in pairs if trajectory.failure is not None]
    unreadable = [trajectory.unreadable for trajectory, _ in pairs if trajectory.unreadable is not None]
    more: dict[str, int] = {}
    for trajectory, before in pairs:
        for kind, count in new_events(trajectory, before).items():
            more[kind] = max(more.get(kind, 0), count)
    recovered = [each for each in figures if each.has_recovered is not None]
    is_fault = case != NOMINAL and not is_as_nominal
    is_of_both = is_fault and has_healthy_half and mode == _COMBINED
    return FaultRow(
        robot=robot,
        kind=next((kind for kind, cases in KINDS.items() if any(each.name == case for each in cases)), ""),
        case=case,
        mode=mode,
        trajectory=name,
        seeds=len(pairs),
        failures=tuple(dict.fromkeys(failures)),
        unreadable=tuple(dict.fromkeys(unreadable)),
        is_as_nominal=is_as_nominal,
        drift_percent=_largest(each.drift_percent for each in figures),
        worst_second_m=_largest(each.worst_second_m for each in figures),
        recovery_s=_largest(each.recovery_s for each in recovered),
        never_recovered=sum(not each.has_recovered for each in recovered),
        anees_pose=_largest(each.anees_pose for each in figures),
        coverage=min((each.coverage for each in figures if each.coverage is not None), default=None),
        events=more,
        has_healthy_half=has_healthy_half and case != NOMINAL,
        is_silent=is_fault and any(is_silent(*pair) for pair in pairs),
        is_worse=is_of_both and any(is_worse(*pair) for pair in pairs),
        is_unexplained=is_of_both and any(is_unexplained(*pair) for pair in pairs),
    )


def new_events(trajectory: FaultTrajectory, nominal: FaultTrajectory | None) -> dict[str, int]:
    """The kinds of events that are more frequent than without a fault, with their number."""
    before = {} if nominal is None else nominal.events
    return {kind: count for kind, count in trajectory.events.items() if count > before.get(kind, 0)}


def is_silent(trajectory: FaultTrajectory, nominal: FaultTrajectory | None) -> bool:
    """Whether a run is wrong by more than 5 % of the way, or ends early, and neither event nor failure says so."""
    if trajectory.failure is not None or new_events(trajectory, nominal):
        return False
    figures = trajectory.figures
    if figures is None or figures.drift_percent is None:
        return True
    was_wrong = _drift(nominal) is not None and (_drift(nominal) or 0.0) > WRONG_PERCENT
    is_wrong = figures.drift_percent > WRONG_PERCENT and not was_wrong
    return is_wrong or (figures.coverage is not None and figures.coverage < LEAST_COVERAGE)


def is_worse(trajectory: FaultTrajectory, nominal: FaultTrajectory | None) -> bool:
    """Whether the drift is above 3 % and above three times that without a fault, or there is none."""
    drift = _drift(trajectory)
    return drift is None or drift > max(WORSE_PERCENT, WORSE_TIMES * (_drift(nominal) or 0.0))


def is_unexplained(trajectory: FaultTrajectory, nominal: FaultTrajectory | None) -> bool:
    """Whether the covariance is too small by far and no event says why."""
    anees = None if trajectory.figures is None else trajectory.figures.anees_pose
    return anees is not None and anees > MOST_ANEES and not new_events(trajectory, nominal)


def _drift(trajectory: FaultTrajectory | None) -> float | None:
    return None if trajectory is None or trajectory.figures is None else trajectory.figures.drift_percent


def _largest(values: Iterable[float | None]) -> float | None:
    return max((round(value, 4) for value in values if value is not None), default=None)


def _title(record: FaultJobRecord) -> str:
    return f"{record.robot} {record.seed}, {record.case}, {record.mode}"


def by_fault(record: FaultsRecord, robot: str) -> dict[str, dict[str, FaultRow]]:
    """The rows of a robot by fault and trajectory."""
    found: dict[str, dict[str, FaultRow]] = {}
    for row in record.rows:
        if row.robot == robot:
            found.setdefault(row.case, {})[row.trajectory] = row
    return {name: found[name] for name in CASES if name in found}

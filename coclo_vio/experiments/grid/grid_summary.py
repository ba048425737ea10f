# SPDX-License-Identifier: BSD-3-Clause
"""Summary of a grid: each fused trajectory against the better half, cell by cell.

A run that failed has an infinite error, so it worsens the median that it is in.
"""

from collections.abc import Iterable, Mapping, Sequence
from math import inf, isfinite

import numpy as np

from coclo_vio.evaluation.trajectory_roles import fused_pairs, is_fused
from coclo_vio.experiments.grid.grid_plan import GridPlan
from coclo_vio.experiments.grid.grid_record import CellSummary, GridRecord, Medians, Ratios, Shares
from coclo_vio.experiments.table.table_record import JobRecord, JobTrajectory
from coclo_vio.values.errors import DatasetError

CONSISTENT = (0.5, 2.0)  # ANEES of a pose
_ERRORS = ("drift_percent", "rpe_1m_percent")
_FIGURES = (*_ERRORS, "anees_pose", "yaw_drift_deg", "coverage")
_Runs = Mapping[str, Sequence[JobTrajectory]]
"""Runs of one trajectory by trial."""


def summarise(plan: GridPlan, command: str) -> GridRecord:
    """The summary of all cells with finished jobs.

    Args:
        plan: of the grid.
        command: line that runs it.

    Raises:
        DatasetError: no job is finished, or jobs were made with other settings.
    """
    finished = {cell: records for cell in plan.cells if (records := plan.records(cell))}
    if not finished:
        raise DatasetError(f"no job of commit {plan.commit} is finished in {plan.folder}; run the grid first")
    cells = [cell_summary(cell.group, cell.name, cell.conditions, records) for cell, records in finished.items()]
    cpu_s = sum(record.cpu_s or 0.0 for records in finished.values() for record in records)
    return GridRecord(
        command=command,
        commit=plan.commit,
        trials=plan.trials,
        seeds=tuple(range(plan.first_seed, plan.first_seed + plan.seeds)),
        until_s=plan.until_s,
        cpu_min_per_cell=round(cpu_s / 60.0 / len(finished), 2),
        cells=tuple(cells),
        shares=shares(cells),
    )


def cell_summary(group: str, name: str, conditions: tuple[str, ...], records: Sequence[JobRecord]) -> CellSummary:
    """The summary of one cell.

    Args:
        group: of the cell.
        name: of the cell.
        conditions: that hold in it.
        records: its finished jobs.
    """
    runs = _by_trajectory(records)
    halves = [each for each in dict.fromkeys(alone for _, alone in fused_pairs()) if each in runs]
    fused = [each for each in runs if is_fused(each.partition(":")[0])]
    return CellSummary(
        group=group,
        name=name,
        conditions=conditions,
        trajectories={each: _medians(by_trial) for each, by_trial in runs.items()},
        ratios={each: _ratios(runs[each], [runs[half] for half in halves]) for each in fused if halves},
    )


def shares(cells: Iterable[CellSummary]) -> dict[str, Shares]:
    """By fused trajectory, the shares of cells that keep each bound."""
    every = list(cells)
    result = {}
    for name in dict.fromkeys(name for cell in every for name in cell.ratios):
        among = [cell for cell in every if name in cell.ratios]
        ratios = [_largest(cell.ratios[name]) for cell in among]
        anees = [cell.trajectories[name].anees_pose for cell in among]
        result[name] = Shares(
            cells=len(among),
            within_1_1=_share(ratio <= 1.1 for ratio in ratios),
            within_1_3=_share(ratio <= 1.3 for ratio in ratios),
            better=_share(ratio < 1.0 for ratio in ratios),
            consistent=_share(value is not None and CONSISTENT[0] <= value <= CONSISTENT[1] for value in anees),
        )
    return result


def _by_trajectory(records: Sequence[JobRecord]) -> dict[str, dict[str, list[JobTrajectory]]]:
    """Runs by trajectory, with its policy where it is not the configured one, and by trial."""
    runs: dict[str, dict[str, list[JobTrajectory]]] = {}
    for record in records:
        _, colon, policy = record.variant.partition(":")
        for name, trajectory in record.estimators.items():
            runs.setdefault(f"{name}{colon}{policy}", {}).setdefault(record.trial, []).append(trajectory)
    return runs


def _medians(runs: _Runs) -> Medians:
    every = [run for among in runs.values() for run in among]
    figures = {key: _finite(np.median([_median(among, key) for among in runs.values()])) for key in _FIGURES}
    return Medians(runs=len(every), failures=sum(run.failure is not None for run in every), **figures)


def _ratios(fused: _Runs, halves: Sequence[_Runs]) -> Ratios:
    by_key: dict[str, dict[str, float]] = {}
    for key in _ERRORS:
        by_key[key] = {}
        for trial, among in fused.items():
            better = min((_median(half[trial], key) for half in halves if trial in half), default=inf)
            error = _median(among, key)
            by_key[key][trial] = error / better if isfinite(better) and better > 0.0 else float(not isfinite(error))
    worst, trial = max((max(by_key[key][trial] for key in _ERRORS), trial) for trial in fused)
    drift, rpe = (_finite(np.median(list(by_key[key].values()))) for key in _ERRORS)
    return Ratios(drift=drift, rpe=rpe, worst_trial=trial, worst=_finite(worst))


def _median(runs: Sequence[JobTrajectory], key: str) -> float:
    """Median over seeds of a figure against the truth; infinite where a run failed."""
    return float(np.median([_figure(run, key) for run in runs]))


def _figure(run: JobTrajectory, key: str) -> float:
    value = None if run.failure is not None or run.truth is None else getattr(run.truth, key)
    return inf if value is None else abs(float(value))


def _largest(ratios: Ratios) -> float:
    return max(inf if value is None else value for value in (ratios.drift, ratios.rpe))


def _finite(value: float | np.floating) -> float | None:
    return round(float(value), 4) if isfinite(value) else None


def _share(holds: Iterable[bool]) -> float:
    return round(float(np.mean(list(holds))), 4)

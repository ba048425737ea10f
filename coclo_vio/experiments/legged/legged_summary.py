# SPDX-License-Identifier: BSD-3-Clause
"""From finished jobs to the committed record: medians over seeds; and what changed since an earlier record."""

from collections.abc import Iterable, Sequence
from math import inf, isfinite

import numpy as np

from coclo_vio.experiments.legged.legged_plan import LeggedPlan
from coclo_vio.experiments.legged.legged_record import (
    ERRORS,
    ImpactStrength,
    LeggedFigures,
    LeggedJobRecord,
    LeggedRecord,
    LeggedRow,
    LeggedTrajectory,
)
from coclo_vio.values.errors import DatasetError

_Runs = list[tuple[LeggedJobRecord, LeggedTrajectory]]


def summarise(plan: LeggedPlan, command: str) -> LeggedRecord:
    """The record of all finished jobs of a plan.

    Args:
        plan: of the benchmark.
        command: line that runs it.

    Raises:
        DatasetError: no job is finished, or one was written by another release.
    """
    records = plan.finished()
    if not records:
        raise DatasetError(f"no job of commit {plan.commit} is finished in {plan.folder}; run the benchmark first")
    return LeggedRecord(
        command=command,
        commit=plan.commit,
        seeds=tuple(sorted({record.seed for record in records if record.seed is not None})),
        rows=tuple(rows_of(records)),
        not_recorded={_title(record): record.not_recorded for record in records if record.not_recorded is not None},
        finished=len(records),
        planned=sum(1 for _ in plan.jobs()),
    )


def rows_of(records: Sequence[LeggedJobRecord]) -> list[LeggedRow]:
    """A row for each recording and trajectory, in the order of the jobs; jobs without a recording are left out."""
    runs: dict[tuple[str, str], _Runs] = {}
    for record in records:
        for name, trajectory in record.trajectories.items():
            runs.setdefault((record.group, name), []).append((record, trajectory))
    order = {group: index for index, group in enumerate(dict.fromkeys(record.group for record in records))}
    return [_row(name, of_row) for (group, name), of_row in sorted(runs.items(), key=lambda each: order[each[0][0]])]


def differences(before: LeggedRecord, after: LeggedRecord) -> list[str]:
    """Drift and ANEES before and after, a line for each recording and trajectory that changed, came or went."""
    old = {(row.group, row.trajectory): row for row in before.rows}
    new = {(row.group, row.trajectory): row for row in after.rows}
    lines = []
    for key in [*new, *(key for key in old if key not in new)]:
        name = f"{key[0]}, {key[1]}"
        if key not in old or key not in new:
            lines.append(f"{name}: {'new' if key in new else 'not in this record'}")
            continue
        was, now = old[key].figures, new[key].figures
        drift, anees = (was.drift_percent, now.drift_percent), (was.anees_pose, now.anees_pose)
        if drift[0] != drift[1] or anees[0] != anees[1] or old[key].failures != new[key].failures:
            failed = f", {old[key].failures} -> {new[key].failures} failed" if new[key].failures else ""
            lines.append(f"{name}: drift {_change(*drift)} %, ANEES {_change(*anees)}{failed}")
    return lines


def _title(record: LeggedJobRecord) -> str:
    return record.group if record.seed is None else f"{record.group}, seed {record.seed}"


def _change(before: float | None, after: float | None) -> str:
    return " -> ".join("-" if value is None else f"{value:.2f}" for value in (before, after))


def _row(name: str, runs: _Runs) -> LeggedRow:
    first = runs[0][0]
    figures = {key: _median_of(key, [trajectory for _, trajectory in runs]) for key in LeggedFigures.model_fields}
    reasons = [trajectory.failure for _, trajectory in runs if trajectory.failure is not None]
    impacts = [record.impacts for record, _ in runs if record.impacts is not None]
    return LeggedRow(
        kind=first.kind,
        group=first.group,
        trajectory=name,
        runs=len(runs),
        failures=len(reasons),
        reasons=tuple(dict.fromkeys(reasons)),
        figures=LeggedFigures(**figures),
        cpu_ms_per_joint_sample=_median(record.cpu_ms_per_joint_sample for record, _ in runs),
        impacts=_median_strength(impacts),
    )


def _median_of(key: str, trajectories: Sequence[LeggedTrajectory]) -> float | None:
    """Median of a figure; a run that failed has an infinite error, and no other figure."""
    values: list[float | None] = []
    for trajectory in trajectories:
        if trajectory.failure is not None or trajectory.figures is None:
            values.append(inf if key in ERRORS else None)
        else:
            values.append(getattr(trajectory.figures, key))
    return _median(values)


def _median_strength(impacts: Sequence[ImpactStrength]) -> ImpactStrength | None:
    std, peak = _median(each.std_mps2 for each in impacts), _median(each.peak_mps2 for each in impacts)
    return None if std is None or peak is None else ImpactStrength(std_mps2=std, peak_mps2=peak)


def _median(values: Iterable[float | None]) -> float | None:
    """Of those that there are; None without any, or where most are infinite."""
    known = [value for value in values if value is not None]
    if not known:
        return None
    middle = float(np.sort(known)[len(known) // 2]) if inf in known else float(np.median(known))
    return round(middle, 4) if isfinite(middle) else None

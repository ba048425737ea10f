# SPDX-License-Identifier: BSD-3-Clause
"""The matrix in rows of text: figures and events of each fault by trajectory, and sentences on what is amiss."""

from collections.abc import Iterator

from coclo_vio.experiments.faults.fault_cases import NOMINAL
from coclo_vio.experiments.faults.fault_record import FaultRow, FaultsRecord
from coclo_vio.experiments.faults.fault_summary import by_fault


def figure_head(record: FaultsRecord, robot: str) -> tuple[str, ...]:
    """Titles of ``figure_rows``."""
    return ("fault", *(f"`{name}`" for name in _names(record, robot)))


def figure_rows(record: FaultsRecord, robot: str) -> Iterator[tuple[str, ...]]:
    """A row a fault: drift %, worst second m, recovery s, ANEES of each trajectory; "=" where nothing of it is read."""
    names, modes = _names(record, robot), {row.trajectory: row.mode for row in record.rows}
    for case, rows in by_fault(record, robot).items():
        broken = _broken(record, robot, case)
        yield (case, *("**exception**" if modes[name] in broken else _cell(rows.get(name)) for name in names))


def event_head(record: FaultsRecord, robot: str) -> tuple[str, ...]:
    """Titles of ``event_rows``."""
    return ("fault", *(f"`{mode}`" for mode in _modes(record, robot)))


def event_rows(record: FaultsRecord, robot: str) -> Iterator[tuple[str, ...]]:
    """A row a fault: kinds of events that are new or more frequent in each mode."""
    modes = _modes(record, robot)
    for case, rows in by_fault(record, robot).items():
        if case == NOMINAL:
            continue
        cells, broken = [], _broken(record, robot, case)
        for mode in modes:
            row = next((row for row in rows.values() if row.mode == mode), None)
            if row is None:
                cells.append("exception" if mode in broken else "")
            elif row.is_as_nominal:
                cells.append("=")
            else:
                cells.append(", ".join(f"`{kind}` {count}" for kind, count in row.events.items()) or "-")
        yield (case, *cells)


def amiss_lines(record: FaultsRecord) -> list[str]:
    """Sentences on what is silent, worse than it may be, unexplained, failed or unreadable; empty without any."""
    lines = []
    for row in record.rows:
        where = f"* {row.robot}, {row.case}, `{row.trajectory}`"
        values = f"drift {_number(row.drift_percent, '.2f')} %, ANEES {_number(row.anees_pose, '.2f')}"
        if row.is_as_nominal:
            continue
        if row.is_silent:
            lines.append(f"{where}: wrong and silent: {values}, coverage {_number(row.coverage, '.2f')}.")
        if row.is_worse:
            lines.append(f"{where}: worse than 3 % and three times nominal with a healthy half: {values}.")
        if row.is_unexplained:
            lines.append(f"{where}: ANEES above 4 without an event: {values}.")
        lines += [f"{where}: stopped early: {reason}" for reason in row.failures]
        lines += [f"{where}: its files are not read: {reason}" for reason in row.unreadable]
    return [*lines, *(f"* {name}: {reason}" for name, reason in record.not_run.items())]


def counts_sentence(record: FaultsRecord) -> str:
    """How much was run, and how much of it is amiss."""
    rows = [row for row in record.rows if row.case != NOMINAL and not row.is_as_nominal]
    faults = len({(row.robot, row.case) for row in rows})
    seeds = ", ".join(f"{robot} seed {' and '.join(map(str, found))}" for robot, found in record.seeds.items())
    halves = [row for row in rows if row.mode == "combined" and row.has_healthy_half]
    of_halves = (
        f"Of {len(halves)} trajectories of `combined` with a healthy half {sum(row.is_worse for row in halves)} are "
        f"worse than they may be, and {sum(row.is_unexplained for row in halves)} have an ANEES above 4 without an "
        "event."
    )
    if not halves:
        of_halves = (
            "Which half is healthy, and whether `combined` is worse than it may be, is not known without `coclo` and "
            "`vins` on the same recording without a fault: run --only nominal --modes coclo,vins."
        )
    return (
        f"{record.finished} of {record.planned} jobs are finished ({seeds}): {len(rows)} trajectories with "
        f"{faults} faults, of which {sum(row.is_silent for row in rows)} are wrong and silent and "
        f"{sum(bool(row.failures) for row in rows)} stopped early; {len(record.not_run)} jobs ended in an exception. "
        + of_halves
    )


def _cell(row: FaultRow | None) -> str:
    if row is None:
        return ""
    if row.is_as_nominal:
        return "="
    if row.drift_percent is None and row.worst_second_m is None:
        return "no estimate"
    text = f"{_number(row.drift_percent, '.2f')} / {_number(row.worst_second_m, '.3f')}"
    if row.recovery_s is not None:
        text += f" / {row.recovery_s:.1f} s"
    if row.never_recovered:
        text += " / never"
    text += f", {_number(row.anees_pose, '.1f')}"
    marks = [
        name
        for name, is_on in (
            ("silent", row.is_silent),
            ("worse", row.is_worse),
            ("unexplained", row.is_unexplained),
            ("stopped", bool(row.failures)),
        )
        if is_on
    ]
    return f"{text} **{', '.join(marks)}**" if marks else text


def _broken(record: FaultsRecord, robot: str, case: str) -> set[str]:
    """The modes that a fault broke off, or that had no recording."""
    titles = (title.split(", ") for title in record.not_run)
    return {parts[-1] for parts in titles if parts[0].split()[0] == robot and ", ".join(parts[1:-1]) == case}


def _names(record: FaultsRecord, robot: str) -> list[str]:
    return list(dict.fromkeys(row.trajectory for row in record.rows if row.robot == robot))


def _modes(record: FaultsRecord, robot: str) -> list[str]:
    return list(dict.fromkeys(row.mode for row in record.rows if row.robot == robot))


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)

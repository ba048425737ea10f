# SPDX-License-Identifier: BSD-3-Clause
"""Kills as the rows of a table, and those that are not as they should be as lines."""

from collections.abc import Iterator

from coclo_vio.experiments.kills.kill_record import Kill, KillsRecord, KillsSummary

HEAD = (
    "command, modes",
    "kills",
    "right status",
    "evaluated",
    "too short",
    "no estimate yet",
    "failed",
    "lost at most [s]",
    "resumed",
    "equal",
    "largest difference",
)


def rows(record: KillsRecord) -> Iterator[tuple[str, ...]]:
    """A row for each command, and one for all."""
    for (command, modes), summary in record.by_command().items():
        yield _row(f"`{command}` {modes.replace(',', ', ')}", summary)
    yield _row("all", record.summary)


def _row(name: str, summary: KillsSummary) -> tuple[str, ...]:
    lost, difference = summary.worst_lost_s, summary.worst_difference
    numbers = (summary.kills, summary.right_status, *summary.left.values())
    return (
        name,
        *map(str, numbers),
        "-" if lost is None else f"{lost:.2f}",
        str(summary.resumed),
        str(summary.equal),
        "-" if difference is None else f"{difference:.2g}",
    )


def summary_sentence(record: KillsRecord) -> str:
    """How many there were by signal, and how many are as they should be."""
    by_signal = ", ".join(f"{count} by {name}" for name, count in record.summary.by_signal.items())
    return f"{record.summary.kills} kills ({by_signal}), {record.summary.passed} of them without fault."


def amiss_lines(record: KillsRecord) -> Iterator[str]:
    """A line for each kill that is not as it should be."""
    for kill in record.kills:
        if not kill.is_passed:
            yield f"* `{kill.command}` {kill.modes}, {kill.signal} at {100 * kill.at_share:.0f} %: {_why(kill)}"


def _why(kill: Kill) -> str:
    parts = []
    if not kill.is_status_right:
        parts.append(f"status {kill.status}")
    if not kill.is_whole:
        lost = "" if kill.lost_s is None else f", {kill.lost_s:.2f} s are missing"
        parts.append(f"{kill.left}{lost}{f' ({kill.reason})' if kill.reason else ''}")
    if kill.resumed_status != 0:
        parts.append(f"resuming ended with status {kill.resumed_status}")
    if not kill.is_equal:
        how = "other lengths or words" if kill.difference is None else f"differs by {kill.difference:.3g}"
        parts.append(how if kill.has_same_events else f"{how}, other events or counts")
    return "; ".join(parts)

# SPDX-License-Identifier: BSD-3-Clause
"""What an ended table left, and whether the one that went on is the same."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from coclo_vio.experiments.kills.what_is_left import Comparison, WhatIsLeft, largest_difference
from coclo_vio.experiments.table.table_record import JobRecord
from coclo_vio.values.errors import CocloError
from coclo_vio.values.record import read_json

_OF_TIME = ("cpu_s", "realtime_factor", "compute_ms_median", "compute_ms_p95")
_NEXT = "make the table again"
Jobs = Mapping[str, bytes]
"""The files of finished jobs, by name."""


def jobs_of(folder: Path) -> Jobs:
    """The finished jobs of a table."""
    return {path.name: path.read_bytes() for path in (folder / "jobs").glob("*.json")}


def left_of_table(folder: Path) -> WhatIsLeft:
    """Whether every finished job is read."""
    jobs = jobs_of(folder)
    if not jobs:
        return WhatIsLeft("no estimate yet", "no job had finished", None)
    try:
        failures = [JobRecord.read(folder / "jobs" / name).failure for name in jobs]
    except CocloError as error:
        return WhatIsLeft("failed", str(error), None)
    reason = next(filter(None, failures), "")
    return WhatIsLeft("failed" if reason else "evaluated", reason, None)


def compared_tables(whole: Path, resumed: Path, before: Jobs) -> Comparison:
    """Compare ``table.json`` and the trajectories of two tables, but for times of computing.

    Args:
        whole: folder of the table that was not ended.
        resumed: of the one that went on.
        before: the jobs that it had finished when it was ended: they have to be there as they were.

    Raises:
        DatasetError: a ``table.json`` is missing.
    """
    numbers: list[float] = []
    one, other = (read_json(folder / "table.json", _NEXT) for folder in (whole, resumed))
    same = _compare(one, other, numbers)
    now = jobs_of(resumed)
    same = same and all(now.get(name) == text for name, text in before.items())
    for path in sorted(whole.glob("runs/*/*")):
        found = largest_difference(path, resumed / path.relative_to(whole))
        same = same and found is not None
        numbers.append(found or 0.0)
    return Comparison(max(numbers, default=0.0), same, {"jobs kept": (float(len(before)),)})


def _compare(one: Any, other: Any, numbers: list[float]) -> bool:
    """Whether two JSON values have the same shape and words; the differences of their numbers are added."""
    if isinstance(one, dict) and isinstance(other, dict):
        keys = [key for key in one if key not in _OF_TIME]
        return one.keys() == other.keys() and all(_compare(one[key], other[key], numbers) for key in keys)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(_compare(*pair, numbers) for pair in zip(one, other, strict=True))
    if _is_number(one) and _is_number(other):
        numbers.append(abs(one - other))
        return True
    return bool(one == other)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)

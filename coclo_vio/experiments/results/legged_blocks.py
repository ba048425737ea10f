# SPDX-License-Identifier: BSD-3-Clause
"""The benchmark of legged odometry as Markdown, with its origin."""

from collections.abc import Callable, Mapping

from coclo_vio.experiments.legged.legged_record import LeggedRecord
from coclo_vio.experiments.legged.legged_text import (
    DETAIL_HEAD,
    IMPACT_HEAD,
    detail_rows,
    failure_lines,
    impact_rows,
    overview_head,
    overview_rows,
)
from coclo_vio.experiments.results.result_files import ResultFiles, markdown_table

_FILE = "legged.json"


def _legged(files: ResultFiles) -> str:
    """Recordings by estimators, and what failed."""
    record = LeggedRecord.read(files.folder / _FILE)
    table = markdown_table(overview_head(record), overview_rows(record))
    if record.finished < record.planned:
        table += f"\n\nOf {record.planned} jobs {record.finished} are finished."
    return "\n\n".join([table, *(["\n".join(failures)] if (failures := failure_lines(record)) else []), _origin(files)])


def _legged_details(files: ResultFiles) -> str:
    """Every figure."""
    return markdown_table(DETAIL_HEAD, detail_rows(LeggedRecord.read(files.folder / _FILE)))


def _legged_impacts(files: ResultFiles) -> str:
    """``coclo`` and ``inekf`` by the strength of impacts."""
    rows = list(impact_rows(LeggedRecord.read(files.folder / _FILE)))
    return markdown_table(IMPACT_HEAD, rows) if rows else "Not measured yet."


def _origin(files: ResultFiles) -> str:
    return files.origin(_FILE)


LEGGED_BLOCKS: Mapping[str, Callable[[ResultFiles], str]] = {
    "legged": _legged,
    "legged_details": _legged_details,
    "legged_impacts": _legged_impacts,
}
"""What the page on legged odometry can show, by name."""

# SPDX-License-Identifier: BSD-3-Clause
"""The matrix of faults as Markdown, with its origin."""

from collections.abc import Callable, Mapping

from coclo_vio.experiments.faults.fault_record import FaultsRecord
from coclo_vio.experiments.faults.fault_text import (
    amiss_lines,
    counts_sentence,
    event_head,
    event_rows,
    figure_head,
    figure_rows,
)
from coclo_vio.experiments.results.result_files import ResultFiles, markdown_table

_FILE = "faults.json"


def _faults(files: ResultFiles) -> str:
    """Figures by fault and trajectory, a table for each robot."""
    record = FaultsRecord.read(files.folder / _FILE)
    tables = [
        f"### {robot}\n\n{markdown_table(figure_head(record, robot), figure_rows(record, robot))}"
        for robot in record.seeds
    ]
    return "\n\n".join([counts_sentence(record), *tables, files.origin(_FILE)])


def _fault_events(files: ResultFiles) -> str:
    """Events by fault and mode, a table for each robot."""
    record = FaultsRecord.read(files.folder / _FILE)
    tables = [
        f"### Events, {robot}\n\n{markdown_table(event_head(record, robot), event_rows(record, robot))}"
        for robot in record.seeds
    ]
    return "\n\n".join(tables)


def _faults_amiss(files: ResultFiles) -> str:
    """What is silent, worse than it may be, unexplained, stopped or unreadable."""
    return "\n".join(amiss_lines(FaultsRecord.read(files.folder / _FILE))) or "Nothing."


FAULT_BLOCKS: Mapping[str, Callable[[ResultFiles], str]] = {
    "faults": _faults,
    "fault_events": _fault_events,
    "faults_amiss": _faults_amiss,
}
"""What the page on faults can show, by name."""

# SPDX-License-Identifier: BSD-3-Clause
"""The folder of measured results, and tables of them in Markdown."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coclo_vio.experiments.results.provenance import Provenances
from coclo_vio.experiments.table.table_record import TableRecord, TableSummary
from coclo_vio.values.record import read_json

_NEXT = "measure again with `make results`"


@dataclass(frozen=True, slots=True)
class ResultFiles:
    """The folder of measured results."""

    folder: Path

    def read(self, name: str) -> Any:
        """The values of a file of results.

        Raises:
            DatasetError: it is missing or no JSON.
        """
        return read_json(self.folder / name, _NEXT)

    def table(self) -> TableSummary:
        """The summary of Table I.

        Raises:
            DatasetError: the table is missing or of another version.
        """
        return TableRecord.read(self.folder / "table.json").summary

    def origin(self, name: str) -> str:
        """A line on where a file comes from.

        Raises:
            DatasetError: that is not noted.
        """
        return f"*{Provenances.read(self.folder / 'provenance.json').of(name).sentence}*"


def markdown_table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table of Markdown: one title a column, then the rows."""
    titles = list(head)
    lines = [f"| {' | '.join(titles)} |", "|" + "---|" * len(titles)]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])

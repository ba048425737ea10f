# SPDX-License-Identifier: BSD-3-Clause
"""A table that is being written: CSV with a header, or a JSON object a line, read as its lines become complete."""

import csv
import json
from collections.abc import Callable, Iterator
from pathlib import Path

from coclo_vio.datasets.csv_table import CsvRow, CsvTable
from coclo_vio.values.errors import DatasetError, shortened

_MOST_LINE = 1_000_000  # characters
Wait = Callable[[], bool]
"""Called where nothing new is in the file; returns whether to look again."""


class GrowingTable(CsvTable):
    """Rows of a file to which somebody appends; a line that is malformed is reported and left out."""

    def __init__(self, path: Path, wait: Wait, refuse: Callable[[str], None]) -> None:
        """Wait for the header.

        Args:
            path: ends in ``.csv`` or ``.jsonl``.
            wait: called where nothing new is in the file.
            refuse: called with the reason why a line is left out.

        Raises:
            DatasetError: the file cannot be read, or has no header when waiting ends.
        """
        self._lines = _lines(path, wait)
        self._is_json = path.suffix.lower() in (".jsonl", ".ndjson")
        self._refuse = refuse
        self._first: list[str] | None = None
        line = next(self._lines, None)
        if line is None:
            raise DatasetError(f"{path} has no complete line; its first line must name the columns")
        header = self._header(line, path)
        super().__init__(path, header)

    def rows(self) -> Iterator[CsvRow]:
        """The rows as they come, until waiting ends."""
        number = 1
        if self._first is not None:
            yield CsvRow(self, number, self._first)
        for line in self._lines:
            number += 1
            cells = self._cells(line)
            if cells is not None:
                yield CsvRow(self, number, cells)

    def _header(self, line: str, path: Path) -> tuple[str, ...]:
        if not self._is_json:
            cells = next(csv.reader([line]), [])
            return tuple(name.strip().lstrip("#").partition("[")[0].strip() for name in cells)
        values = _object(line)
        if values is None:
            raise DatasetError(f"{path}: its first line must be a JSON object of numbers by column")
        self._first = [str(value) for value in values.values()]
        return tuple(values)

    def _cells(self, line: str) -> list[str] | None:
        """The cells of a line; None for a blank one, and for one that is left out."""
        if not line.strip():
            return None
        if self._is_json:
            values = _object(line)
            cells = None if values is None else [str(values.get(name, "")) for name in self.header]
        else:
            cells = next(csv.reader([line]), [])
        if cells is None or len(cells) != len(self.header):
            self._refuse("a line has not one value for each column")
            return None
        wrong = next((cell for cell in cells if cell.strip() and not _is_number(cell)), None)
        if wrong is not None:
            self._refuse(f"a line holds {shortened(repr(wrong), 40)}, which is no number")
            return None
        return cells


def _object(line: str) -> dict[str, float] | None:
    try:
        values = json.loads(line)
    except (ValueError, RecursionError):
        return None
    is_plain = isinstance(values, dict) and all(
        isinstance(value, int | float) and not isinstance(value, bool) for value in values.values()
    )
    return values if is_plain else None


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _lines(path: Path, wait: Wait) -> Iterator[str]:
    """The complete lines of a file, those that are yet to be written among them."""
    try:
        with path.open(encoding="utf-8", errors="replace", newline="") as file:
            begun = ""
            while True:
                begun += file.readline(_MOST_LINE)
                if begun.endswith("\n") or len(begun) >= _MOST_LINE:
                    yield begun.rstrip("\r\n")
                    begun = ""
                elif not wait():
                    return
    except OSError as error:
        raise DatasetError(f"cannot read {shortened(path)}: {error.strerror}") from error

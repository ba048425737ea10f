# SPDX-License-Identifier: BSD-3-Clause
"""A CSV file as a stream of rows, read once from top to bottom: the basis of all text formats.

A file that was cut off in the middle of a line is read up to that line; any other malformed row is an error that
names the file, the line and the column.
"""

import csv
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import TextIO

from coclo_vio.values.errors import DatasetError, TimestampError, shortened
from coclo_vio.values.trajectory import seconds_to_ns

_STAMP_LIMIT_NS = 2**63
_MOST_DIGITS = 30  # of a stamp; 1e999999999 would exhaust the memory


@dataclass(slots=True)
class CsvTable:
    """A header and its rows; the rows are streamed, so that a file may be larger than memory.

    Attributes:
        path: the file.
        header: column names, without surrounding blanks, a leading ``#`` and a unit in square brackets.
        ends_in_text: whether the last column holds text, so that a last cell that is not a number is no sign of a cut.
        has_cut_line: whether the last line was cut off and left out; set when all rows have been read.
        lacks_newline: whether the last line is complete but has no newline; set when all rows have been read.
    """

    path: Path
    header: tuple[str, ...]
    ends_in_text: bool = False
    has_cut_line: bool = field(default=False, init=False)
    lacks_newline: bool = field(default=False, init=False)

    @classmethod
    def open(cls, path: Path, *, ends_in_text: bool = False) -> "CsvTable":
        """The table in ``path``.

        Raises:
            DatasetError: the file cannot be read or has no header.
        """
        with _opened(path) as file, _explained(path):
            header = next(csv.reader(file), None)
        if not header:
            raise DatasetError(f"{path} is empty: its first line must name the columns")
        return cls(path, tuple(_plain_name(name) for name in header), ends_in_text)

    def rows(self) -> Iterator["CsvRow"]:
        """The rows under the header, in file order; blank lines are skipped.

        Raises:
            DatasetError: a row before the last one with another number of cells than the header.
        """
        width = len(self.header)
        held: CsvRow | None = None
        ends_with_newline = [True]
        with _opened(self.path) as file, _explained(self.path):
            reader = csv.reader(_watched(file, ends_with_newline))
            next(reader, None)
            for cells in reader:
                if held is not None:
                    yield held.of_width(width)
                    held = None
                if cells:
                    held = CsvRow(self, reader.line_num, cells)
        if held is None:
            return
        self.has_cut_line = held.is_cut(width, ends_with_newline[0])
        self.lacks_newline = not self.has_cut_line and not ends_with_newline[0]
        if not self.has_cut_line:
            yield held.of_width(width)


@dataclass(slots=True)
class CsvRow:
    """One row: its cells as text, and its line number for error messages."""

    table: CsvTable
    line: int
    cells: list[str]

    def of_width(self, width: int) -> "CsvRow":
        """This row, after a check that it has ``width`` cells.

        Raises:
            DatasetError: it has more or fewer.
        """
        if len(self.cells) != width:
            raise DatasetError(
                f"{self.table.path}, line {self.line}: {len(self.cells)} cells under a header of {width} columns; "
                "correct or delete the line"
            )
        return self

    def is_cut(self, width: int, ends_with_newline: bool) -> bool:
        """Whether this row, the last of its file, was cut off: too short, or no newline and no number at its end."""
        if len(self.cells) < width:
            return True
        if ends_with_newline or self.table.ends_in_text:
            return False
        return len(self.cells) == width and _number(self.cells[-1]) is None

    def numbers(self, columns: Sequence[int]) -> list[float]:
        """The numbers in ``columns``, NaN where a cell is empty or not finite.

        Raises:
            DatasetError: a cell that is neither empty nor a number.
        """
        cells = self.cells
        try:
            values = [float(cells[column]) for column in columns]
        except ValueError:
            return self._numbers_or_nan(columns)
        return values if math.isfinite(sum(values)) else self._numbers_or_nan(columns)

    def _numbers_or_nan(self, columns: Sequence[int]) -> list[float]:
        cells = self.cells
        values = []
        for column in columns:
            value = _number(cells[column])
            if value is None:
                if cells[column].strip():
                    raise self._not_a_number(column)
                value = math.nan
            values.append(value if math.isfinite(value) else math.nan)
        return values

    def text(self, column: int) -> str:
        """The cell as text, without surrounding blanks."""
        return self.cells[column].strip()

    def is_blank(self, columns: Sequence[int]) -> bool:
        """Whether all cells in ``columns`` are empty: the sensor has no sample in this row."""
        cells = self.cells
        return not any(cells[column].strip() for column in columns)

    def stamp_ns(self, column: int, *, in_seconds: bool) -> int | None:
        """The stamp in ``column`` in nanoseconds; None where the cell is empty or NaN.

        Args:
            column: index of the column.
            in_seconds: whether it holds decimal seconds; otherwise integer nanoseconds.

        Raises:
            DatasetError: the cell is not a number.
            TimestampError: it is too large for 64-bit nanoseconds.
        """
        text = self.cells[column].strip()
        if not text or text.lower().lstrip("+-") == "nan":
            return None
        try:
            stamp_ns = seconds_to_ns(text) if in_seconds else _whole_number(text)
        except (ValueError, InvalidOperation, OverflowError) as error:
            raise self._not_a_number(column) from error
        if abs(stamp_ns) >= _STAMP_LIMIT_NS:
            raise TimestampError(
                f"{self.table.path}, line {self.line}: the stamp {shortened(text)} in column "
                f"{self.table.header[column]} is beyond 64-bit nanoseconds; check whether the column is in "
                f"{'' if in_seconds else 'nano'}seconds"
            )
        return stamp_ns

    def _not_a_number(self, column: int) -> DatasetError:
        name, cell = shortened(self.table.header[column]), shortened(self.cells[column])
        return DatasetError(
            f"{self.table.path}, line {self.line}, column {name}: {cell!r} is not a number; correct the cell, or leave "
            "it empty where the sensor has no reading"
        )


def _whole_number(text: str) -> int:
    """The integer part of a decimal number; ValueError where it is none, or of more digits than a stamp can have."""
    if text.isdecimal():
        return int(text)
    value = Decimal(text)
    if value.is_finite() and value.adjusted() > _MOST_DIGITS:
        raise ValueError(text)
    return int(value)


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _plain_name(name: str) -> str:
    return name.strip().lstrip("#").partition("[")[0].strip()


def _watched(file: TextIO, ends_with_newline: list[bool]) -> Iterator[str]:
    for line in file:
        ends_with_newline[0] = line.endswith("\n")
        yield line


def _opened(path: Path) -> TextIO:
    try:
        return path.open(encoding="utf-8-sig", newline="")
    except OSError as error:
        raise DatasetError(f"cannot read {shortened(path)}: {error.strerror}") from error


@contextmanager
def _explained(path: Path) -> Iterator[None]:
    """Turn errors of the csv module and the decoder into a DatasetError that names the file."""
    try:
        yield
    except (csv.Error, UnicodeDecodeError, OSError) as error:
        raise DatasetError(f"{path} is not a CSV text file: {error}") from error

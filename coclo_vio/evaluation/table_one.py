# SPDX-License-Identifier: BSD-3-Clause
"""Several recordings in the form of the paper's Table I: a row each, drift and RPE per metre of each trajectory.

The paper's own figures stand in rows of their own that are marked: another robot's data, and drift of net displacement.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.evaluation.paper_table import is_in_paper, paper_table
from coclo_vio.evaluation.trajectory_roles import featured
from coclo_vio.values.trajectory_kind import trajectory_kind


@dataclass(frozen=True, slots=True)
class Cell:
    """Drift and RPE per metre, percent, of one trajectory on one recording; None where there is none.

    Attributes:
        drift_percent: of the path, or in a row of the paper of the net displacement.
        rpe_1m_percent: median over all segments of 1 m.
    """

    drift_percent: float | None = None
    rpe_1m_percent: float | None = None

    def __str__(self) -> str:
        if self.drift_percent is None and self.rpe_1m_percent is None:
            return "-"
        drift = "-" if self.drift_percent is None else f"{self.drift_percent:.2f}"
        return drift if self.rpe_1m_percent is None else f"{drift} / {self.rpe_1m_percent:.2f}"


@dataclass(frozen=True, slots=True)
class Row:
    """One recording, or one trial of the paper.

    Attributes:
        name: of the recording or trial.
        is_paper: whether these are the paper's figures.
        cells: one a column.
    """

    name: str
    is_paper: bool
    cells: tuple[Cell, ...]


@dataclass(frozen=True, slots=True)
class TableOne:
    """A table in the form of the paper's Table I.

    Attributes:
        columns: names of the trajectories.
        rows: ours in order, then the paper's.
    """

    columns: tuple[str, ...]
    rows: tuple[Row, ...]

    @classmethod
    def of(cls, evaluations: Mapping[str, Mapping[str, Evaluation]]) -> "TableOne":
        """The table of evaluations by recording and trajectory, baselines left out where there are featured ones."""
        columns = tuple(featured(dict.fromkeys(name for by_name in evaluations.values() for name in by_name)))
        ours = [
            Row(recording, False, tuple(_cell(by_name.get(column)) for column in columns))
            for recording, by_name in evaluations.items()
        ]
        return cls(columns, (*ours, *(_paper_rows(columns) if is_in_paper(columns) else ())))

    @property
    def headers(self) -> tuple[str, ...]:
        """The labels of the columns."""
        return tuple(trajectory_kind(column).label for column in self.columns)


def _cell(evaluation: Evaluation | None) -> Cell:
    return Cell() if evaluation is None else Cell(evaluation.drift_percent, evaluation.rpe_1m_percent)


def _paper_rows(columns: Sequence[str]) -> tuple[Row, ...]:
    return tuple(
        Row(trial, True, tuple(Cell(drifts.get(column)) for column in columns))
        for trial, drifts in paper_table().items()
    )

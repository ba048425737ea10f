# SPDX-License-Identifier: BSD-3-Clause
"""``grid.json``: every cell of the grid, and how often a fused trajectory is no worse than the better half."""

from typing import ClassVar, Literal

from pydantic import BaseModel, ConfigDict

from coclo_vio.values.record import Record


class _Part(BaseModel):
    """A part of the record."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Medians(_Part):
    """One trajectory in a cell, against the exact truth: medians over trials of medians over seeds.

    Attributes:
        runs: how many.
        failures: of them.
        drift_percent: None where most runs failed; the others too.
        rpe_1m_percent: median of the errors over pieces of one metre.
        anees_pose: 1 where the covariance is right.
        yaw_drift_deg: by its size.
        coverage: share of the trial with an estimate.
    """

    runs: int
    failures: int
    drift_percent: float | None
    rpe_1m_percent: float | None
    anees_pose: float | None
    yaw_drift_deg: float | None
    coverage: float | None


class Ratios(_Part):
    """A fused trajectory over the better half: for each trial the quotient of medians over seeds, of these the median.

    Attributes:
        drift: None where it failed and a half did not.
        rpe: the same.
        worst_trial: terrain of the larger of all quotients.
        worst: that quotient.
    """

    drift: float | None
    rpe: float | None
    worst_trial: str
    worst: float | None


class CellSummary(_Part):
    """One cell.

    Attributes:
        group: of cells.
        name: of the cell.
        conditions: that hold in it.
        trajectories: by name, ``combined_coclo:ci`` for another feedback policy than the configured one.
        ratios: of the fused ones.
    """

    group: str
    name: str
    conditions: tuple[str, ...]
    trajectories: dict[str, Medians]
    ratios: dict[str, Ratios]


class Shares(_Part):
    """A fused trajectory over all cells; a share counts cells in which both drift and RPE keep the bound.

    Attributes:
        cells: how many.
        within_1_1: share of cells at most 1.1 times the better half.
        within_1_3: at most 1.3 times.
        better: better than both halves.
        consistent: with ANEES of 0.5 to 2.
    """

    cells: int
    within_1_1: float
    within_1_3: float
    better: float
    consistent: float


class GridRecord(Record):
    """``grid.json``.

    Attributes:
        command: line that runs the grid.
        commit: of the code.
        trials: names of the terrains.
        seeds: of the trials.
        until_s: end of each trial, s; None for whole trials.
        cpu_min_per_cell: processor time of the estimators, minutes a cell, without simulation.
        cells: with a finished job.
        shares: by fused trajectory.
    """

    next_step: ClassVar[str] = "sum up again with `python -m coclo_vio.experiments.grid summary`"

    schema_version: Literal[1] = 1
    command: str
    commit: str
    trials: tuple[str, ...]
    seeds: tuple[int, ...]
    until_s: float | None
    cpu_min_per_cell: float
    cells: tuple[CellSummary, ...]
    shares: dict[str, Shares]

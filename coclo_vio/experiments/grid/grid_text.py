# SPDX-License-Identifier: BSD-3-Clause
"""A grid in rows of text: a cell a line, and the shares of cells that keep each bound."""

from collections.abc import Iterator

from coclo_vio.evaluation.trajectory_roles import is_fused
from coclo_vio.experiments.grid.grid_record import GridRecord, Medians, Ratios

WORSE = 1.1  # a ratio above it is marked


def cell_head(record: GridRecord) -> tuple[str, ...]:
    """Titles of ``cell_rows``."""
    names = _names(record)
    figures = [f"{name}: drift / RPE %, ANEES" for name in names]
    return ("cell", *figures, *(f"{name} over the better half" for name in names if is_fused(name)), "worst")


def cell_rows(record: GridRecord) -> Iterator[tuple[str, ...]]:
    """A row a cell: errors of the configured modes, and each fused trajectory over the better half."""
    names = _names(record)
    for cell in record.cells:
        fused = [name for name in names if name in cell.ratios]
        worst = max((cell.ratios[name] for name in fused), key=_largest, default=None)
        yield (
            cell.name,
            *(_medians(cell.trajectories.get(name)) for name in names),
            *(_ratios(cell.ratios.get(name)) for name in names if is_fused(name)),
            "" if worst is None else f"{worst.worst_trial} {_ratio(worst.worst)}",
        )


SHARE_HEAD = ("", "cells", "within 1.1 [%]", "within 1.3 [%]", "better than both [%]", "ANEES 0.5 to 2 [%]")
"""Titles of ``share_rows``."""


def share_rows(record: GridRecord) -> Iterator[tuple[str, ...]]:
    """A row a fused trajectory and feedback policy."""
    for name, share in record.shares.items():
        shares = (share.within_1_1, share.within_1_3, share.better, share.consistent)
        yield (name, str(share.cells), *(f"{100.0 * each:.0f}" for each in shares))


def _names(record: GridRecord) -> list[str]:
    """The trajectories with the configured policy, standalone ones before fused ones."""
    names = dict.fromkeys(name for cell in record.cells for name in cell.trajectories if ":" not in name)
    return sorted(names, key=is_fused)


def _medians(medians: Medians | None) -> str:
    if medians is None or medians.drift_percent is None or medians.rpe_1m_percent is None:
        return "-"
    anees = "-" if medians.anees_pose is None else f"{medians.anees_pose:.2f}"
    return f"{medians.drift_percent:.2f} / {medians.rpe_1m_percent:.2f}, {anees}"


def _ratios(ratios: Ratios | None) -> str:
    return "-" if ratios is None else f"{_ratio(ratios.drift)} / {_ratio(ratios.rpe)}"


def _ratio(value: float | None) -> str:
    if value is None:
        return "**failed**"
    return f"**{value:.2f}**" if value > WORSE else f"{value:.2f}"


def _largest(ratios: Ratios) -> float:
    return float("inf") if ratios.worst is None else ratios.worst

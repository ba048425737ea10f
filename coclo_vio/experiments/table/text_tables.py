# SPDX-License-Identifier: BSD-3-Clause
"""The summary as tables of text, in the order of the page: Markdown, HTML and terminal show the same."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from coclo_vio.evaluation.paper_table import PAPER_MARK, paper_table
from coclo_vio.evaluation.trajectory_roles import standalone_names
from coclo_vio.experiments.table.summary import TOLERANCE
from coclo_vio.experiments.table.table_record import (
    ErrorRatio,
    Reference,
    Spread,
    TableSummary,
    TrajectorySummary,
    WinCount,
)
from coclo_vio.values.trajectory_kind import trajectory_kind

_MAIN: Reference = "vicon"  # against which the printed tables are, as the paper's
_CONSISTENCY = "1 is consistent, above 1 overconfident, below 1 conservative"
_DETAILS = (
    ("drift_percent", "drift %", ".2f"),
    ("rpe_1m_percent", "RPE %/m", ".2f"),
    ("paper_drift_percent", "paper's drift %", ".2f"),
    ("ate_m", "ATE m", ".3f"),
    ("velocity_rmse_mps", "velocity m/s", ".3f"),
    ("yaw_drift_deg", "yaw deg", ".2f"),
)


@dataclass(frozen=True, slots=True)
class TextTable:
    """A table of text; the first column labels the rows.

    Attributes:
        title: above it.
        head: names of the columns.
        rows: cells, as many a row as ``head`` has.
        caption: below it: how to read it.
        is_wide: whether it is too wide for a terminal.
    """

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    is_wide: bool = False


def text_tables(summary: TableSummary) -> list[TextTable]:
    """All tables that have a row."""
    made = [_table_one(summary), _wins(summary), _against_better(summary), _policies(summary), _details(summary)]
    return [table for table in made if table.rows]


def _table_one(summary: TableSummary) -> TextTable:
    """The paper's Table I: trials by trajectories, our figures above the paper's."""
    names = list(next(iter(summary.trials.values()), {}))
    rows: list[tuple[str, ...]] = []
    for trial, of_trial in summary.trials.items():
        seeds = max(trajectory.n for trajectory in of_trial.values())
        rows.append((f"{trial}, {seeds} {_plural(seeds, 'seed')}", *(_both(of_trial[name]) for name in names)))
        ours = (_median(of_trial[name].vicon.paper_drift_percent, ".2f") for name in names)
        rows.append((f"{trial}, drift as the paper's", *ours))
        paper = paper_table().get(trial, {})
        theirs = (format(paper[name], ".2f") if name in paper else "-" for name in names)
        rows.append((f"{trial}, {PAPER_MARK}", *theirs))
    return TextTable(
        "Table I: drift / RPE per metre, %",
        ("", *(_label(name) for name in names)),
        tuple(rows),
        "Medians over seeds against noisy Vicon, trajectories tied at the start only. Drift: error at the end over the "
        "length of the path; RPE: median error over all segments of 1 m. Drift as the paper's: error over distance "
        "from the start, on flat ground after the first metre.",
    )


def _wins(summary: TableSummary) -> TextTable:
    rows: list[tuple[str, ...]] = []
    for name, by_reference in summary.wins.items():
        wins, pair = by_reference[_MAIN].values(), f"{_label(name)} over {_standalone_label(name)}"
        rows.append((f"{pair}, drift", *(_won(of_trial.drift) for of_trial in wins)))
        rows.append((f"{pair}, RPE", *(_won(of_trial.rpe) for of_trial in wins)))
    trials = next(iter(summary.wins.values()))[_MAIN] if summary.wins else ()
    return TextTable(
        "How often combined is better than the same estimator alone",
        ("", *trials),
        tuple(rows),
        "Of all pairs of one trial and seed, against Vicon; an estimator that failed loses.",
    )


def _against_better(summary: TableSummary) -> TextTable:
    rows: list[tuple[str, ...]] = []
    for name, by_trial in summary.against_the_better.items():
        ratios = [by_reference[_MAIN] for by_reference in by_trial.values()]
        rows.append((f"{_label(name)}, drift", *(_ratio(of_trial.drift) for of_trial in ratios)))
        rows.append((f"{_label(name)}, RPE", *(_ratio(of_trial.rpe) for of_trial in ratios)))
    return TextTable(
        f"Combined over the better of {' and '.join(_label(name) for name in standalone_names())} alone",
        ("", *next(iter(summary.against_the_better.values()), {})),
        tuple(rows),
        f"Median over seeds of the quotient, against Vicon; above {TOLERANCE:g} combined is worse by more than 10 %.",
    )


def _policies(summary: TableSummary) -> TextTable:
    rows: list[tuple[str, ...]] = []
    names: dict[str, None] = {}
    for trial, policies in summary.policies.items():
        for policy, by_name in policies.items():
            names |= dict.fromkeys(by_name)
            seeds = max(trajectory.n for trajectory in by_name.values())
            rows.append((f"{trial}, {policy}", str(seeds), *_policy_cells(by_name)))
    heads = (f"{_label(name)}, {figure}" for name in names for figure in ("drift / RPE %", "ANEES"))
    return TextTable(
        "Feedback from vision to the filter",
        ("", "seeds", *heads),
        tuple(rows),
        "Medians over the seeds that every policy has. Drift and RPE against Vicon, ANEES against the truth: "
        f"{_CONSISTENCY}. paper: the smoothed pose as if it were independent.",
    )


def _policy_cells(by_name: Mapping[str, TrajectorySummary]) -> Iterator[str]:
    for trajectory in by_name.values():
        yield _both(trajectory)
        yield _median(trajectory.truth.anees_pose, ".2f")


def _details(summary: TableSummary) -> TextTable:
    rows: list[tuple[str, ...]] = []
    for trial, of_trial in summary.trials.items():
        for name, trajectory in of_trial.items():
            cells = (_spread(getattr(trajectory.vicon, key), form) for key, _, form in _DETAILS)
            anees = _spread(trajectory.truth.anees_pose, ".2f")
            speed = _spread(trajectory.realtime_factor, ".1f")
            rows.append((f"{trial}, {_label(name)}", *cells, anees, speed, f"{trajectory.failures} of {trajectory.n}"))
    heads = (*(label for _, label, _ in _DETAILS), "ANEES", "times real time", "failed")
    return TextTable(
        "Median (10 to 90 % of the seeds; worst)",
        ("", *heads),
        tuple(rows),
        f"Against Vicon; ANEES of the pose against the truth: {_CONSISTENCY}. Yaw by its size.",
        is_wide=True,
    )


def _label(name: str) -> str:
    return trajectory_kind(name).label


def _standalone_label(name: str) -> str:
    return _label(str(trajectory_kind(name).standalone))


def _both(trajectory: TrajectorySummary) -> str:
    """Drift and RPE, and how many failed."""
    figures = trajectory.vicon
    text = f"{_median(figures.drift_percent, '.2f')} / {_median(figures.rpe_1m_percent, '.2f')}"
    return f"{text} ({trajectory.failures} failed)" if trajectory.failures else text


def _median(spread: Spread | None, form: str) -> str:
    return "-" if spread is None else format(spread.median, form)


def _spread(spread: Spread | None, form: str) -> str:
    if spread is None:
        return "-"
    median, low, high, worst = (format(value, form) for value in (spread.median, spread.p10, spread.p90, spread.worst))
    return f"{median} ({low} to {high}; {worst})"


def _won(count: WinCount) -> str:
    return "-" if count.share is None else f"{count.wins}/{count.of}, {100 * count.share:.0f} %"


def _ratio(ratio: ErrorRatio) -> str:
    return "-" if ratio.median_ratio is None else format(ratio.median_ratio, ".2f")


def _plural(number: int, noun: str) -> str:
    return noun if number == 1 else f"{noun}s"

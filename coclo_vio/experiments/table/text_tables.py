# SPDX-License-Identifier: BSD-3-Clause
"""The summary as tables of text, in the order of the page: however they are shown, they say the same."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from coclo_vio.evaluation.paper_table import PAPER_MARK, PAPER_TABLE_I
from coclo_vio.experiments.table.paper_comparison import name_of
from coclo_vio.experiments.table.summary import PAIRS, TOLERANCE

_MAIN = "vicon"  # what the printed tables are measured against, as the paper's
_EXACT = "truth"  # what consistency is measured against: Vicon's own noise is not the estimator's
_DETAILS = (
    ("drift_percent", "drift %", ".2f"),
    ("rpe_1m_percent", "RPE %/m", ".2f"),
    ("paper_drift_percent", "paper's drift %", ".2f"),
    ("ate_m", "ATE m", ".3f"),
    ("velocity_rmse_mps", "velocity m/s", ".3f"),
    ("yaw_drift_deg", "yaw deg", ".2f"),
)


@dataclass(frozen=True, slots=True)
class Grid:
    """A table of text; the first column says what a row is about.

    Attributes:
        title: above it.
        head: names of the columns.
        rows: cells, as many a row as ``head`` has.
        caption: below it: how to read it.
        is_wide: whether a terminal has no room for it.
    """

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    is_wide: bool = False


def grids(summary: Mapping[str, Any]) -> list[Grid]:
    """All tables that there is something to say in."""
    made = [_table_one(summary), _wins(summary), _against_better(summary), _policies(summary), _details(summary)]
    return [grid for grid in made if grid.rows]


def _table_one(summary: Mapping[str, Any]) -> Grid:
    """The paper's Table I: grounds by estimators, our figures above the paper's."""
    trials = summary["trials"]
    names = list(next(iter(trials.values()), {}))
    rows: list[tuple[str, ...]] = []
    for trial, told in trials.items():
        seeds = max(one["n"] for one in told.values())
        rows.append((f"{trial}, {seeds} {_plural(seeds, 'seed')}", *(_both(told[name]) for name in names)))
        ours = (_median(told[name][_MAIN]["paper_drift_percent"], ".2f") for name in names)
        rows.append((f"{trial}, drift as the paper's", *ours))
        paper = PAPER_TABLE_I[trial]
        theirs = (format(paper[name], ".2f") if name in paper else "-" for name in names)
        rows.append((f"{trial}, {PAPER_MARK}", *theirs))
    return Grid(
        "Table I: drift / RPE per metre, %",
        ("", *(name_of(name) for name in names)),
        tuple(rows),
        "Medians over seeds against noisy Vicon, trajectories tied at the start only. Drift: error at the end over the "
        "length of the path; RPE: median error over all pieces of 1 m. Drift as the paper's: error over distance from "
        "the start, on flat ground after the first metre.",
    )


def _wins(summary: Mapping[str, Any]) -> Grid:
    wins = summary["wins"]
    rows = [
        (
            f"{name_of(name)} over {name_of(PAIRS[name])}, {error}",
            *(_won(by_trial[error]) for by_trial in told.values()),
        )
        for name, against in wins.items()
        for told in (against[_MAIN],)
        for error in ("drift", "rpe")
    ]
    trials = tuple(next(iter(wins.values()))[_MAIN]) if wins else ()
    return Grid(
        "How often combined is better than the same estimator alone",
        ("", *trials),
        tuple((row[0].replace("rpe", "RPE"), *row[1:]) for row in rows),
        "Of all pairs of one trial and seed, against Vicon; an estimator that failed loses.",
    )


def _against_better(summary: Mapping[str, Any]) -> Grid:
    told = summary["against_the_better"]
    trials = tuple(next(iter(told.values()))) if told else ()
    rows = tuple(
        (f"{name_of(name)}, {label}", *(_ratio(by_trial[trial][_MAIN][error]) for trial in trials))
        for name, by_trial in told.items()
        for error, label in (("drift", "drift"), ("rpe", "RPE"))
    )
    return Grid(
        "Combined over the better of COCLO and VINS alone",
        ("", *trials),
        rows,
        f"Median over seeds of the quotient, against Vicon; above {TOLERANCE:g} combined is worse by more than 10 %.",
    )


def _policies(summary: Mapping[str, Any]) -> Grid:
    rows = [
        (f"{trial}, {policy}", str(max(one["n"] for one in told.values())), *_policy_cells(told))
        for trial, policies in summary["policies"].items()
        for policy, told in policies.items()
    ]
    heads = (f"{name_of(name)}, {what}" for name in PAIRS for what in ("drift / RPE %", "ANEES"))
    return Grid(
        "What is fed back from eyes to legs",
        ("", "seeds", *heads),
        tuple(rows),
        "Medians over the seeds that every policy has. Drift and RPE against Vicon, ANEES against the truth: 1 is "
        "honest, above it too sure. paper: the smoothed pose as if it were independent.",
    )


def _policy_cells(told: Mapping[str, Any]) -> Iterator[str]:
    for name in PAIRS:
        yield _both(told[name])
        yield _median(told[name][_EXACT]["anees_pose"], ".2f")


def _details(summary: Mapping[str, Any]) -> Grid:
    rows: list[tuple[str, ...]] = []
    for trial, estimators in summary["trials"].items():
        for name, told in estimators.items():
            cells = (_spread(told[_MAIN][key], form) for key, _, form in _DETAILS)
            anees = _spread(told[_EXACT]["anees_pose"], ".2f")
            speed = _spread(told["realtime_factor"], ".1f")
            failed = f"{told['failures']} of {told['n']}"
            rows.append((f"{trial}, {name_of(name)}", *cells, anees, speed, failed))
    heads = (*(label for _, label, _ in _DETAILS), "ANEES", "times real time", "failed")
    return Grid(
        "Median (10 to 90 % of the seeds; worst)",
        ("", *heads),
        tuple(rows),
        "Against Vicon; ANEES of the pose against the truth: 1 is honest, above it too sure. Yaw by its size.",
        is_wide=True,
    )


def _both(told: Mapping[str, Any]) -> str:
    """Drift and RPE, and how many failed."""
    figures = told[_MAIN]
    text = f"{_median(figures['drift_percent'], '.2f')} / {_median(figures['rpe_1m_percent'], '.2f')}"
    return f"{text} ({told['failures']} failed)" if told["failures"] else text


def _median(spread: Mapping[str, float] | None, form: str) -> str:
    return "-" if spread is None else format(spread["median"], form)


def _spread(spread: Mapping[str, float] | None, form: str) -> str:
    if spread is None:
        return "-"
    median, low, high, worst = (format(spread[key], form) for key in ("median", "p10", "p90", "worst"))
    return f"{median} ({low} to {high}; {worst})"


def _won(share: Mapping[str, Any]) -> str:
    return "-" if share["share"] is None else f"{share['wins']}/{share['of']}, {100 * share['share']:.0f} %"


def _ratio(told: Mapping[str, Any]) -> str:
    return "-" if told["median_ratio"] is None else format(told["median_ratio"], ".2f")


def _plural(number: int, noun: str) -> str:
    return noun if number == 1 else f"{noun}s"


def sentences(claims: Sequence[Mapping[str, Any]]) -> list[str]:
    """The claims as they are read."""
    return [str(claim["sentence"]) for claim in claims]

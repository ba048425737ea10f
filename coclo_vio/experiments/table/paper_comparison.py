# SPDX-License-Identifier: BSD-3-Clause
"""The paper's comparisons, computed from the medians: which trajectory drifts less on which terrain, by how much."""

from collections.abc import Mapping
from itertools import combinations

from coclo_vio.evaluation.paper_table import paper_table
from coclo_vio.evaluation.trajectory_roles import fused_pairs, standalone_names
from coclo_vio.experiments.table.table_record import BetterBy, PaperComparison, Spread, TrajectorySummary
from coclo_vio.values.trajectory_kind import trajectory_kind

_Pair = tuple[float | None, float | None]


def paper_comparisons(medians: Mapping[str, Mapping[str, TrajectorySummary]]) -> tuple[PaperComparison, ...]:
    """Standalone trajectories against each other, then fused ones against their standalone counterparts.

    Args:
        medians: by trial and trajectory, as the summary has them.

    Returns:
        One for every pair and trial that has both.
    """
    pairs = [*combinations(standalone_names(), 2), *fused_pairs()]
    return tuple(
        _comparison(trial, of_trial, first, second)
        for first, second in pairs
        for trial, of_trial in medians.items()
        if first in of_trial and second in of_trial
    )


def _comparison(trial: str, of_trial: Mapping[str, TrajectorySummary], first: str, second: str) -> PaperComparison:
    ours = [of_trial[name].vicon for name in (first, second)]
    drift: _Pair = (_median(ours[0].drift_percent), _median(ours[1].drift_percent))
    rpe: _Pair = (_median(ours[0].rpe_1m_percent), _median(ours[1].rpe_1m_percent))
    better = BetterBy(drift=_is_less(drift), rpe=_is_less(rpe))
    paper = paper_table().get(trial, {})
    is_paper_better = paper[first] < paper[second] if first in paper and second in paper else None
    results = [
        _result(better.drift, "drifts less", "does not drift less"),
        _result(better.rpe, "is better over a metre", "is not better over a metre"),
    ]
    found = {None: "the paper has no figure", True: "the paper: better", False: "the paper: worse"}[is_paper_better]
    if is_paper_better is not None:
        found += f", {paper[first]:.2f} against {paper[second]:.2f} %"
    return PaperComparison(
        trial=trial,
        first=first,
        second=second,
        drift=drift,
        rpe=rpe,
        better=better,
        paper=is_paper_better,
        sentence=(
            f"{trial}: {trajectory_kind(first).label} against {trajectory_kind(second).label}: drift {_text(drift)}, "
            f"RPE {_text(rpe)}: {', '.join(results)} ({found})"
        ),
    )


def _median(spread: Spread | None) -> float | None:
    return None if spread is None else spread.median


def _is_less(pair: _Pair) -> bool | None:
    first, second = pair
    return None if first is None or second is None else first < second


def _text(pair: _Pair) -> str:
    first, second = ("-" if value is None else f"{value:.2f}" for value in pair)
    return f"{first} against {second} %"


def _result(is_better: bool | None, better: str, not_better: str) -> str:
    return {None: f"whether it {better} is not known", True: better, False: not_better}[is_better]

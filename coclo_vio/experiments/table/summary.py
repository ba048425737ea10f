# SPDX-License-Identifier: BSD-3-Clause
"""Summary of all jobs: medians and spreads, wins over the standalone counterpart, and each feedback policy.

A trajectory that failed, or stopped early, has no figures: it counts as a failure, and loses where it is compared.
"""

from collections.abc import Iterable, Mapping, Sequence
from math import inf

import numpy as np

from coclo_vio.evaluation.trajectory_roles import fused_pairs, is_fused
from coclo_vio.experiments.table.paper_comparison import paper_comparisons
from coclo_vio.experiments.table.plan import TablePlan
from coclo_vio.experiments.table.table_record import (
    REFERENCES,
    ErrorRatio,
    ErrorRatios,
    FigureSpreads,
    JobRecord,
    Reference,
    Spread,
    TableSummary,
    TrajectorySummary,
    WinCount,
    Wins,
)
from coclo_vio.experiments.table.trial_results import DRIFT, FIGURES, RPE, Result, Results
from coclo_vio.values.trajectory_kind import trajectory_kind

TOLERANCE = 1.1  # a fused trajectory is to be no worse than the better standalone one by more than 10 %
_SPREAD_PERCENT = (10.0, 50.0, 90.0)


def summarise(plan: TablePlan, jobs: Sequence[JobRecord]) -> TableSummary:
    """The summary of a table.

    Args:
        plan: of the jobs.
        jobs: all of them.
    """
    results = Results.of(jobs)
    medians = {
        trial: {name: _of_trajectory(results.by_seed(trial, name).values()) for name in results.names}
        for trial in results.trials
    }
    fused = [name for name in results.names if is_fused(name)]
    standalone = list(dict.fromkeys(str(trajectory_kind(name).standalone) for name in fused))
    has_all = set(standalone) <= set(results.names)
    return TableSummary(
        trials=medians,
        wins={name: _wins(results, name, alone) for name, alone in fused_pairs(results.names)},
        against_the_better={
            name: {trial: _against_better(results, trial, name, standalone) for trial in results.trials}
            for name in (fused if has_all else ())
        },
        policies=_policies(plan, results),
        against_the_paper=paper_comparisons(medians),
    )


def spread(values: Iterable[float | None], *, more_is_better: bool = False) -> Spread | None:
    """Median, 10 and 90 % over seeds, and the worst; None without any."""
    known = [value for value in values if value is not None]
    if not known:
        return None
    low, median, high = (float(value) for value in np.percentile(known, _SPREAD_PERCENT))
    return Spread(median=median, p10=low, p90=high, worst=min(known) if more_is_better else max(known))


def _of_trajectory(results: Iterable[Result]) -> TrajectorySummary:
    every = list(results)

    def spreads(reference: Reference) -> FigureSpreads:
        return FigureSpreads(**{key: spread(result.figure(reference, key) for result in every) for key in FIGURES})

    return TrajectorySummary(
        n=len(every),
        failures=sum(result.failure is not None for result in every),
        vicon=spreads("vicon"),
        truth=spreads("truth"),
        realtime_factor=spread((result.realtime_factor for result in every), more_is_better=True),
    )


def _wins(results: Results, name: str, alone: str) -> dict[Reference, dict[str, Wins]]:
    """How often a fused trajectory is better than its standalone counterpart, by trial and over all."""
    by_reference: dict[Reference, dict[str, Wins]] = {}
    for reference in REFERENCES:
        by_trial: dict[str, Wins] = {}
        for trial in results.trials:
            pairs = _pairs(results.by_seed(trial, name), results.by_seed(trial, alone))
            by_trial[trial] = Wins(
                drift=_win_count([_error(a, reference, DRIFT) < _error(b, reference, DRIFT) for a, b in pairs]),
                rpe=_win_count([_error(a, reference, RPE) < _error(b, reference, RPE) for a, b in pairs]),
            )
        every = list(by_trial.values())
        by_trial["all"] = Wins(
            drift=_total([wins.drift for wins in every]),
            rpe=_total([wins.rpe for wins in every]),
        )
        by_reference[reference] = by_trial
    return by_reference


def _against_better(results: Results, trial: str, name: str, standalone: Sequence[str]) -> dict[Reference, ErrorRatios]:
    """Over seeds, the median of this error over that of the better standalone trajectory."""
    fused, others = results.by_seed(trial, name), [results.by_seed(trial, other) for other in standalone]
    return {
        reference: ErrorRatios(drift=_ratio(fused, others, reference, DRIFT), rpe=_ratio(fused, others, reference, RPE))
        for reference in REFERENCES
    }


def _ratio(
    fused: Mapping[int, Result], others: Sequence[Mapping[int, Result]], reference: Reference, key: str
) -> ErrorRatio:
    ratios = []
    for seed, result in fused.items():
        best = min(_error(by_seed[seed], reference, key) for by_seed in others if seed in by_seed)
        ratios.append(_error(result, reference, key) / best if 0.0 < best < inf else inf)
    median = float(np.median(ratios)) if ratios and not np.isinf(ratios).all() else inf
    is_finite = bool(np.isfinite(median))
    return ErrorRatio(median_ratio=median if is_finite else None, holds=is_finite and median <= TOLERANCE)


def _policies(plan: TablePlan, results: Results) -> dict[str, dict[str, dict[str, TrajectorySummary]]]:
    """By trial and policy, over the seeds that every policy has: medians of error and consistency."""
    by_trial: dict[str, dict[str, dict[str, TrajectorySummary]]] = {}
    names = dict.fromkeys(name for variant in plan.policies for name in variant.trajectories)
    for trial in results.trials if plan.policies else ():
        by_trial[trial] = {}
        for name in names:
            by_policy = {
                plan.policy_of(variant): results.by_seed(trial, name, variant.name)
                for variant in plan.policies
                if name in variant.trajectories
            }
            seeds = set.intersection(*(set(by_seed) for by_seed in by_policy.values()))
            for policy, by_seed in by_policy.items():
                chosen = _of_trajectory(by_seed[seed] for seed in sorted(seeds))
                by_trial[trial].setdefault(policy, {})[name] = chosen
    return by_trial


def representative_seed(results: Results, trial: str) -> int | None:
    """The seed whose drift is the (lower) median: of the first fused trajectory, or of the first one there is."""
    name = next((name for name in results.names if is_fused(name)), results.names[0])
    drifts = {
        seed: drift
        for seed, result in results.by_seed(trial, name).items()
        if (drift := result.figure("vicon", DRIFT)) is not None
    }
    ordered = sorted(drifts, key=lambda seed: (drifts[seed], seed))
    return ordered[(len(ordered) - 1) // 2] if ordered else None


def _pairs(first: Mapping[int, Result], second: Mapping[int, Result]) -> list[tuple[Result, Result]]:
    return [(result, second[seed]) for seed, result in first.items() if seed in second]


def _error(result: Result, reference: Reference, key: str) -> float:
    """The figure, infinite where there is none."""
    value = result.figure(reference, key)
    return inf if value is None else value


def _win_count(is_won: Sequence[bool]) -> WinCount:
    return WinCount(wins=sum(is_won), of=len(is_won), share=sum(is_won) / len(is_won) if is_won else None)


def _total(counts: Sequence[WinCount]) -> WinCount:
    wins, of = sum(count.wins for count in counts), sum(count.of for count in counts)
    return WinCount(wins=wins, of=of, share=wins / of if of else None)

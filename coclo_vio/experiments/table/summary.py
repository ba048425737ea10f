# SPDX-License-Identifier: BSD-3-Clause
"""What the rows of all jobs come to: medians and spreads, who wins how often, what each feedback policy does.

An estimator that failed, or stopped early, has no figures: it counts as a failure, and loses where it is compared.
"""

from collections.abc import Iterable, Mapping, Sequence
from math import inf
from typing import Any

import numpy as np

from coclo_vio.experiments.table.job import REFERENCES
from coclo_vio.experiments.table.paper_comparison import claims
from coclo_vio.experiments.table.plan import TablePlan
from coclo_vio.experiments.table.job_store import Row
from coclo_vio.experiments.table.trial_results import ERRORS, FIGURES, Result, Results

PAIRS: Mapping[str, str] = {"combined_coclo": "coclo", "combined_vins": "vins"}  # combined, and the same alone
TOLERANCE = 1.1  # combined is to be no worse than the better of the two by more than 10 %
_SPREAD_PERCENT = (10.0, 50.0, 90.0)


def summarise(plan: TablePlan, rows: Sequence[Row]) -> Row:
    """The summary of a table, in plain types.

    Args:
        plan: what the rows are of.
        rows: of all jobs.
    """
    results = Results.of(rows)
    medians = {
        trial: {name: _of_estimator(results.by_seed(trial, name).values()) for name in results.estimators}
        for trial in results.trials
    }
    return {
        "trials": medians,
        "wins": {
            name: _wins(results, name, alone)
            for name, alone in PAIRS.items()
            if {name, alone} <= set(results.estimators)
        },
        "against_the_better": {
            name: {trial: _against_better(results, trial, name) for trial in results.trials}
            for name in PAIRS
            if {*PAIRS, *PAIRS.values()} <= set(results.estimators)
        },
        "policies": _policies(plan, results),
        "claims": claims(medians),
    }


def spread(values: Iterable[float | None], *, more_is_better: bool = False) -> dict[str, float] | None:
    """Median, 10 and 90 % over seeds, and the worst; None without any."""
    known = [value for value in values if value is not None]
    if not known:
        return None
    low, median, high = (float(value) for value in np.percentile(known, _SPREAD_PERCENT))
    return {"median": median, "p10": low, "p90": high, "worst": min(known) if more_is_better else max(known)}


def _of_estimator(results: Iterable[Result]) -> Row:
    every = list(results)
    told: Row = {"n": len(every), "failures": sum(one.failure is not None for one in every)}
    told |= {
        reference: {key: spread(one.figure(reference, key) for one in every) for key in FIGURES}
        for reference in REFERENCES
    }
    return {**told, "realtime_factor": spread((one.realtime_factor for one in every), more_is_better=True)}


def _wins(results: Results, name: str, alone: str) -> Row:
    """How often the combined estimate is better than the same estimator alone, by trial and over all."""
    told: Row = {}
    for reference in REFERENCES:
        by_trial: Row = {}
        for trial in results.trials:
            pairs = _pairs(results.by_seed(trial, name), results.by_seed(trial, alone))
            by_trial[trial] = {
                error: _share([_error(one, reference, key) < _error(other, reference, key) for one, other in pairs])
                for error, key in ERRORS.items()
            }
        by_trial["all"] = {error: _together([won[error] for won in by_trial.values()]) for error in ERRORS}
        told[reference] = by_trial
    return told


def _against_better(results: Results, trial: str, name: str) -> Row:
    """Over seeds, the median of this error over that of the better of the two alone."""
    told: Row = {}
    alone = [results.by_seed(trial, other) for other in PAIRS.values()]
    for reference in REFERENCES:
        told[reference] = {}
        for error, key in ERRORS.items():
            ratios = []
            for seed, one in results.by_seed(trial, name).items():
                best = min(_error(others[seed], reference, key) for others in alone if seed in others)
                ratios.append(_error(one, reference, key) / best if 0.0 < best < inf else inf)
            median = float(np.median(ratios)) if ratios and not np.isinf(ratios).all() else None
            finite = median is not None and np.isfinite(median)
            told[reference][error] = {
                "median_ratio": median if finite else None,
                "holds": bool(finite and median is not None and median <= TOLERANCE),
            }
    return told


def _policies(plan: TablePlan, results: Results) -> Row:
    """By trial and policy, over the seeds that every policy has: medians of error and consistency."""
    told: Row = {}
    for trial in results.trials if plan.policies else ():
        told[trial] = {}
        for name in PAIRS:
            by_policy = {plan.policy_of(one): results.by_seed(trial, name, one.name) for one in plan.policies}
            seeds = set.intersection(*(set(found) for found in by_policy.values()))
            for policy, found in by_policy.items():
                chosen = _of_estimator(found[seed] for seed in sorted(seeds))
                told[trial].setdefault(policy, {})[name] = chosen
    return told


def representative_seed(results: Results, trial: str) -> int | None:
    """The seed whose drift is the (lower) median: of the combined estimate, or of the first estimator there is."""
    name = "combined_coclo" if "combined_coclo" in results.estimators else results.estimators[0]
    drifts = {
        seed: drift
        for seed, one in results.by_seed(trial, name).items()
        if (drift := one.figure(REFERENCES[0], "drift_percent")) is not None
    }
    ordered = sorted(drifts, key=lambda seed: (drifts[seed], seed))
    return ordered[(len(ordered) - 1) // 2] if ordered else None


def _pairs(some: Mapping[int, Result], others: Mapping[int, Result]) -> list[tuple[Result, Result]]:
    return [(one, others[seed]) for seed, one in some.items() if seed in others]


def _error(one: Result, reference: str, key: str) -> float:
    """The figure, infinite where there is none."""
    value = one.figure(reference, key)
    return inf if value is None else value


def _share(won: Sequence[bool]) -> dict[str, Any]:
    return {"wins": sum(won), "of": len(won), "share": sum(won) / len(won) if won else None}


def _together(shares: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    wins, of = (sum(share[key] for share in shares) for key in ("wins", "of"))
    return {"wins": wins, "of": of, "share": wins / of if of else None}

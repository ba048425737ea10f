# SPDX-License-Identifier: BSD-3-Clause
"""The paper's claims, a line each, computed from the medians: who drifts less on which ground, and by how much."""

from collections.abc import Mapping
from typing import Any

from coclo_vio.evaluation.paper_table import PAPER_TABLE_I
from coclo_vio.experiments.table.trial_results import ERRORS

NAMES: Mapping[str, str] = {
    "coclo": "COCLO",
    "vins": "VINS",
    "combined_coclo": "combined COCLO",
    "combined_vins": "combined VINS",
}
_CLAIMED = (("coclo", "vins"), ("combined_coclo", "coclo"), ("combined_vins", "vins"))  # the first is to be better
_REFERENCE = "vicon"


def claims(medians: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Every claim for every ground.

    Args:
        medians: by trial and estimator, as the summary has them.

    Returns:
        For each: ``trial``, ``first`` and ``second`` estimator, both errors of both, whether the first is ``better``
        by each error, whether the ``paper`` found it better (None where it does not say), and the ``sentence``.
    """
    return [
        _claim(trial, of_trial, first, second)
        for first, second in _CLAIMED
        for trial, of_trial in medians.items()
        if first in of_trial and second in of_trial
    ]


def _claim(trial: str, of_trial: Mapping[str, Any], first: str, second: str) -> dict[str, Any]:
    errors = {error: (_median(of_trial[first], key), _median(of_trial[second], key)) for error, key in ERRORS.items()}
    better = {error: None if None in pair else pair[0] < pair[1] for error, pair in errors.items()}  # type: ignore[operator]
    paper = PAPER_TABLE_I.get(trial, {})
    said = paper[first] < paper[second] if first in paper and second in paper else None
    verdicts = [
        _verdict(better["drift"], "drifts less", "does not drift less"),
        _verdict(better["rpe"], "is better over a metre", "is not better over a metre"),
    ]
    told = ", ".join(f"{label} {_pair(errors[error])}" for error, label in (("drift", "drift"), ("rpe", "RPE")))
    found = {None: "the paper does not say", True: "the paper: better", False: "the paper: worse"}[said]
    if said is not None:
        found += f", {paper[first]:.2f} against {paper[second]:.2f} %"
    return {
        "trial": trial,
        "first": first,
        "second": second,
        **{error: list(pair) for error, pair in errors.items()},
        "better": better,
        "paper": said,
        "sentence": f"{trial}: {name_of(first)} against {name_of(second)}: {told}: {', '.join(verdicts)} ({found})",
    }


def name_of(estimator: str) -> str:
    """What an estimator is called in a table."""
    return NAMES.get(estimator, estimator)


def _median(of_estimator: Mapping[str, Any], key: str) -> float | None:
    spread = of_estimator[_REFERENCE][key]
    return None if spread is None else float(spread["median"])


def _pair(values: tuple[float | None, float | None]) -> str:
    first, second = ("-" if value is None else f"{value:.2f}" for value in values)
    return f"{first} against {second} %"


def _verdict(holds: bool | None, yes: str, no: str) -> str:
    return {None: f"whether it {yes} is not known", True: yes, False: no}[holds]

# SPDX-License-Identifier: BSD-3-Clause
"""What one recording says of the paper's claims: legs against eyes, together against alone, and when it cannot tell.

Errors at the end are averaged over as long as the start is tied. What the ground truth's noise leaves open is counted
generously: its errors are taken to last for ``_MEMORY_S``, so that a second of them is ten readings, not a hundred.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from coclo_vio.evaluation.evaluate import EvaluationConfig
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.evaluation.paper_table import PAPER_COLUMNS

Verdict = Literal["yes", "no", "open"]

_MEMORY_S = 0.1
_SIGMAS = 2.0
_SMALL_M = 0.1
_PAIRS = (("combined_coclo", "coclo"), ("combined_vins", "vins"))


@dataclass(frozen=True, slots=True)
class Claim:
    """One comparison of two estimates on one recording.

    Attributes:
        subject: the estimator that is asked about.
        against: the one it is held against.
        verdict: whether the subject drifts less; ``open`` where the ground truth cannot tell.
        subject_m: how far the subject is off at the end, m.
        against_m: the same of the other.
        margin_m: a smaller difference than this may be noise of the ground truth, m.
        path_length_m: of the ground truth, m.
    """

    subject: str
    against: str
    verdict: Verdict
    subject_m: float
    against_m: float
    margin_m: float
    path_length_m: float

    @property
    def sentence(self) -> str:
        """What came of it, for a person."""
        names = [PAPER_COLUMNS.get(name, name) for name in (self.subject, self.against)]
        ends = [in_units(length_m) for length_m in (self.subject_m, self.against_m)]
        if self.verdict == "open":
            return f"{names[0]} or {names[1]}: ground truth too short to tell, {ends[0]} or {ends[1]} off"
        how = "less" if self.verdict == "yes" else "more"
        return f"{names[0]} drifts {how} than {names[1]}: {ends[0]} off after {self.path_length_m:.2f} m, not {ends[1]}"

    def to_json(self) -> dict[str, object]:
        """Plain types, the sentence included."""
        return {
            "subject": self.subject,
            "against": self.against,
            "drifts_less": {"yes": True, "no": False, "open": None}[self.verdict],
            "subject_end_error_m": self.subject_m,
            "against_end_error_m": self.against_m,
            "ground_truth_allows_m": self.margin_m,
            "sentence": self.sentence,
        }


def claims(evaluations: Mapping[str, Evaluation], config: EvaluationConfig) -> tuple[Claim, ...]:
    """The comparisons that these evaluations allow: the paper's, and together against the better of both alone."""
    pairs = [pair for pair in _PAIRS if set(pair) <= set(evaluations)]
    alone = [name for name in ("coclo", "vins") if name in evaluations]
    if len(alone) == 2:
        better, worse = sorted(alone, key=lambda name: end_error_m(evaluations[name], config))
        pairs.insert(0, (better, worse))
        if "combined_coclo" in evaluations and better != "coclo":  # otherwise it is said already
            pairs.append(("combined_coclo", better))
    return tuple(_claim(subject, against, evaluations, config) for subject, against in pairs)


def what_can_be_told(found: Sequence[Claim]) -> str | None:
    """The difference that the ground truth can tell, in a sentence; None where no claim was left open for it."""
    margins_m = [claim.margin_m for claim in found if claim.verdict == "open"]
    return f"ground truth tells differences above {in_units(max(margins_m))}" if margins_m else None


def least_drift(evaluations: Mapping[str, Evaluation], config: EvaluationConfig) -> tuple[str, ...]:
    """The estimator that is nearest to the ground truth at the end, and those that the noise cannot tell from it."""
    if not evaluations:
        return ()
    ends_m = {name: end_error_m(evaluation, config) for name, evaluation in evaluations.items()}
    first = min(ends_m, key=lambda name: ends_m[name])
    margin_m = difference_margin_m(evaluations[first], config)
    return (first, *(name for name in ends_m if name != first and ends_m[name] - ends_m[first] <= margin_m))


def end_error_m(evaluation: Evaluation, config: EvaluationConfig) -> float:
    """Distance to the ground truth, m, its mean vector over the last ``start_window_s``, tied at the start."""
    estimate = evaluation.estimate
    apart = estimate.positions - evaluation.reference.interpolated(estimate.stamps_ns).positions
    tail = estimate.times_s >= estimate.times_s[-1] - config.start_window_s
    return float(np.linalg.norm(apart[tail].mean(axis=0)))


def difference_margin_m(evaluation: Evaluation, config: EvaluationConfig) -> float:
    """How much nearer one estimate must be than another, m, so that it is not the ground truth's noise.

    With n independent readings in the window, position noise s and rotation noise r an axis and net displacement L the
    end is known to ``sqrt(2 s^2 / n + L^2 r^2 / n)`` (both ends, and the heading of the start), and two distances from
    it differ by at most ``sqrt(2)`` times that where the errors are square to each other; two sigmas.
    """
    readings = max(1.0, config.start_window_s / _MEMORY_S)
    positions = evaluation.estimate.positions
    net_m = float(np.linalg.norm(positions[-1] - positions[0]))
    variance = (
        2.0 * config.ground_truth_position_noise_m**2 + (net_m * config.ground_truth_rotation_noise_rad) ** 2
    ) / readings
    return float(_SIGMAS * np.sqrt(2.0 * variance))


def in_units(length_m: float) -> str:
    """A length with three digits or so: below a metre in millimetres."""
    if length_m >= 1.0:
        return f"{length_m:.2f} m"
    return f"{1e3 * length_m:.0f} mm" if length_m >= _SMALL_M else f"{1e3 * length_m:.1f} mm"


def _claim(subject: str, against: str, evaluations: Mapping[str, Evaluation], config: EvaluationConfig) -> Claim:
    subject_m, against_m = (end_error_m(evaluations[name], config) for name in (subject, against))
    margin_m = difference_margin_m(evaluations[against], config)
    verdict: Verdict = "open" if abs(subject_m - against_m) <= margin_m else "yes" if subject_m < against_m else "no"
    path_m = evaluations[subject].path_length_m
    return Claim(subject, against, verdict, subject_m, against_m, margin_m, path_m)

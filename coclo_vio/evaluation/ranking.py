# SPDX-License-Identifier: BSD-3-Clause
"""Who drifts less on one recording: standalone against standalone, fused against standalone; and when it is undecided.

Errors at the end are averaged over as long as the start is tied. What the ground truth's noise leaves undecided is
counted generously: its errors are taken to last for ``_NOISE_CORRELATION_S``, so that a second of them is ten readings,
not a hundred.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from coclo_vio.evaluation.evaluate import EvaluationConfig
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.evaluation.trajectory_roles import fused_pairs, standalone_names
from coclo_vio.values.trajectory_kind import trajectory_kind

_NOISE_CORRELATION_S = 0.1
_SIGMAS = 2.0
_MM_PER_M = 1e3
_SMALL_M = 0.1


@dataclass(frozen=True, slots=True)
class Ranking:
    """Two trajectories of one recording, compared by their drift.

    Attributes:
        subject: the trajectory that is ranked.
        against: the one that it is compared with.
        drift: of the subject, ``less`` or ``more``; ``undecided`` where the ground truth is too noisy for it.
        subject_m: position error of the subject at the end, m.
        against_m: that of the other trajectory, m.
        resolution_m: a smaller difference than this may be noise of the ground truth, m.
        path_length_m: of the ground truth, m.
    """

    subject: str
    against: str
    drift: Literal["less", "more", "undecided"]
    subject_m: float
    against_m: float
    resolution_m: float
    path_length_m: float

    @property
    def sentence(self) -> str:
        """The result in a sentence, without a full stop."""
        subject, against = (trajectory_kind(name).label for name in (self.subject, self.against))
        subject_end, against_end = (length_text(length_m) for length_m in (self.subject_m, self.against_m))
        if self.drift == "undecided":
            return f"{subject} or {against}: ground truth too short to decide, {subject_end} or {against_end} off"
        return (
            f"{subject} drifts {self.drift} than {against}: {subject_end} off after {self.path_length_m:.2f} m, not "
            f"{against_end}"
        )


def rank(evaluations: Mapping[str, Evaluation], config: EvaluationConfig) -> tuple[Ranking, ...]:
    """The comparisons that these evaluations allow.

    The best standalone trajectory against each other one; each fused trajectory against its standalone counterpart;
    and the first of the fused ones against the best standalone one.
    """
    pairs = fused_pairs(evaluations)
    alone = [name for name in standalone_names() if name in evaluations]
    if len(alone) > 1:
        best, *others = sorted(alone, key=lambda name: end_error_m(evaluations[name], config))
        with_best = [(pairs[0][0], best)] if pairs and pairs[0][1] != best else []
        pairs = [*((best, other) for other in others), *pairs, *with_best]
    return tuple(_ranking(subject, against, evaluations, config) for subject, against in pairs)


def resolution_sentence(rankings: Sequence[Ranking]) -> str | None:
    """The difference that the ground truth resolves, in a sentence; None where every ranking is decided."""
    undecided_m = [ranking.resolution_m for ranking in rankings if ranking.drift == "undecided"]
    return f"ground truth resolves differences above {length_text(max(undecided_m))}" if undecided_m else None


def least_drift(evaluations: Mapping[str, Evaluation], config: EvaluationConfig) -> tuple[str, ...]:
    """The trajectory nearest to the ground truth at the end, and those within the noise of it."""
    if not evaluations:
        return ()
    ends_m = {name: end_error_m(evaluation, config) for name, evaluation in evaluations.items()}
    first = min(ends_m, key=lambda name: ends_m[name])
    within_m = resolution_m(evaluations[first], config)
    return (first, *(name for name in ends_m if name != first and ends_m[name] - ends_m[first] <= within_m))


def end_error_m(evaluation: Evaluation, config: EvaluationConfig) -> float:
    """Distance to the ground truth, m, its mean vector over the last ``start_window_s``, tied at the start."""
    estimate = evaluation.estimate
    apart = estimate.positions - evaluation.reference.interpolated(estimate.stamps_ns).positions
    tail = estimate.times_s >= estimate.times_s[-1] - config.start_window_s
    return float(np.linalg.norm(apart[tail].mean(axis=0)))


def resolution_m(evaluation: Evaluation, config: EvaluationConfig) -> float:
    """How much nearer one estimate must be than another, m, so that it is not the ground truth's noise.

    With n independent readings in the window, position noise s and rotation noise r an axis and net displacement L the
    end is known to ``sqrt(2 s^2 / n + L^2 r^2 / n)`` (both ends, and the heading of the start), and two distances from
    it differ by at most ``sqrt(2)`` times that where the errors are square to each other; two sigmas.
    """
    readings = max(1.0, config.start_window_s / _NOISE_CORRELATION_S)
    positions = evaluation.estimate.positions
    net_m = float(np.linalg.norm(positions[-1] - positions[0]))
    variance = (
        2.0 * config.ground_truth_position_noise_m**2 + (net_m * config.ground_truth_rotation_noise_rad) ** 2
    ) / readings
    return float(_SIGMAS * np.sqrt(2.0 * variance))


def length_text(length_m: float) -> str:
    """A length with three digits or so: below a metre in millimetres."""
    if length_m >= 1.0:
        return f"{length_m:.2f} m"
    return f"{_MM_PER_M * length_m:.0f} mm" if length_m >= _SMALL_M else f"{_MM_PER_M * length_m:.1f} mm"


def _ranking(subject: str, against: str, evaluations: Mapping[str, Evaluation], config: EvaluationConfig) -> Ranking:
    subject_m, against_m = (end_error_m(evaluations[name], config) for name in (subject, against))
    within_m = resolution_m(evaluations[against], config)
    drift: Literal["less", "more", "undecided"] = (
        "undecided" if abs(subject_m - against_m) <= within_m else "less" if subject_m < against_m else "more"
    )
    return Ranking(subject, against, drift, subject_m, against_m, within_m, evaluations[subject].path_length_m)

# SPDX-License-Identifier: BSD-3-Clause
"""The innovation gate of evidence from outside, such as vision.

One wrong result must not spoil the filter, so evidence whose innovation is larger than its covariance allows is
rejected. But consistent evidence that is rejected again and again means that the filter itself is wrong: after some
rejections in a row its covariance is inflated until the evidence fits, and the evidence is accepted, unless no
third sensor agrees with it.
"""

from collections import Counter
from dataclasses import dataclass
from enum import Enum

from scipy.stats import chi2

from coclo_vio.filter.config import GateConfig
from coclo_vio.filter.remembered_poses import Innovation, correction_by
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.unscented_transform import Correction
from coclo_vio.values.keyframes import PoseEvidence


class GateOutcome(Enum):
    """Whether evidence corrected the filter."""

    ACCEPTED = "accepted"
    REJECTED = "rejected"
    FORCED = "forced"
    EMPTY = "empty"


@dataclass(frozen=True, slots=True)
class GateResult:
    """What the gate did with evidence, and the evidence's innovation.

    Attributes:
        outcome: ``ACCEPTED``; ``REJECTED``; ``FORCED``: accepted with inflated covariance after rejections in a row;
            ``EMPTY``: it determines nothing.
        innovation_squared: normalised innovation squared before ``FORCED`` inflates the covariance, chi-square with
            ``rows`` degrees of freedom.
        rows: independent directions that the evidence determines.
    """

    outcome: GateOutcome
    innovation_squared: float
    rows: int


class EvidenceGate:
    """Corrects a filter by evidence that passes, and counts what became of all evidence."""

    def __init__(self, config: GateConfig) -> None:
        self._config = config
        self._rejections = 0
        self.counts: Counter[str] = Counter()

    def correct(
        self,
        core: SquareRootFilter,
        evidence: PoseEvidence,
        fallback: PoseEvidence | None = None,
        *,
        may_force: bool = True,
    ) -> GateResult:
        """Correct the filter by evidence on keyframe and frame, if its innovation passes.

        Args:
            core: the filter.
            evidence: the novel information.
            fallback: all information of the other side: used in place of ``evidence`` where the correction is forced,
                so that evidence that was rejected before is made up for.
            may_force: False where no other sensor agrees with this evidence: it is rejected however often it comes.
        """
        innovation, correction = correction_by(core, evidence)
        if correction is None:
            return self._result(GateOutcome.EMPTY, innovation)
        limit = float(chi2.ppf(self._config.probability, innovation.rows))
        outcome = GateOutcome.ACCEPTED
        if innovation.squared > limit:
            self._rejections += 1
            if self._rejections <= self._config.max_rejections or not may_force:
                return self._result(GateOutcome.REJECTED, innovation)
            outcome = GateOutcome.FORCED
            correction = self._inflated_correction(core, evidence if fallback is None else fallback)
        self._rejections = 0
        core.apply(correction)
        return self._result(outcome, innovation)

    @staticmethod
    def _inflated_correction(core: SquareRootFilter, evidence: PoseEvidence) -> Correction:
        """Inflate the filter's covariance until the innovation is as large as expected, and correct by it then."""
        innovation, correction = correction_by(core, evidence)
        if correction is not None and innovation.squared > innovation.rows:
            core.inflate_poses(float((innovation.squared / innovation.rows) ** 0.5))
            _, correction = correction_by(core, evidence)
        assert correction is not None, "evidence with an innovation determines something"
        return correction

    def _result(self, outcome: GateOutcome, innovation: Innovation) -> GateResult:
        self.counts[f"feedback_{outcome.value}"] += 1
        return GateResult(outcome, innovation.squared, innovation.rows)

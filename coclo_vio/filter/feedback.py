# SPDX-License-Identifier: BSD-3-Clause
"""Evidence that comes from outside, such as eyes: what is let in, what is not, and when the filter gives in.

One wrong result must not spoil the filter, so evidence that its covariance does not allow is left out. But a filter
that goes on contradicting somebody who agrees with himself has lost: after some refusals in a row it widens until
the evidence fits, and takes it.
"""

from collections import Counter
from dataclasses import dataclass
from enum import Enum
from typing import Annotated

from pydantic import Field
from scipy.stats import chi2

from coclo_vio.filter.cloning import weigh
from coclo_vio.filter.core import SquareRootFilter
from coclo_vio.filter.square_root import Correction
from coclo_vio.values.config import StageConfig
from coclo_vio.values.keyframes import PoseEvidence


class GateConfig(StageConfig):
    """The innovation gate of evidence from outside."""

    probability: Annotated[
        float, Field(gt=0.5, lt=1, description="share of good evidence that passes the innovation gate")
    ] = 0.9999
    patience: Annotated[
        int, Field(ge=1, description="after so many refusals in a row the filter widens and takes the evidence")
    ] = 3


class Outcome(Enum):
    """What became of evidence."""

    TAKEN = "taken"
    REFUSED = "refused"
    GAVE_IN = "gave_in"
    EMPTY = "empty"


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of evidence, and how surprising it was.

    Attributes:
        outcome: what became of it.
        squared: normalised innovation squared before anything was widened, chi-square with ``rows`` degrees of freedom.
        rows: how many independent things it said.
    """

    outcome: Outcome
    squared: float
    rows: int


class EvidenceGate:
    """Lets evidence into a filter, and counts."""

    def __init__(self, config: GateConfig) -> None:
        self._config = config
        self._refusals = 0
        self.counts: Counter[str] = Counter()

    def take(self, core: SquareRootFilter, evidence: PoseEvidence, whole: PoseEvidence | None = None) -> Verdict:
        """Correct the filter by evidence on keyframe and frame, if it may be believed.

        Args:
            core: the filter.
            evidence: what is new.
            whole: all that the other side believes: taken in place of the evidence where the filter gives in, so that
                what was refused before is made good.
        """
        surprise, correction = weigh(core, evidence)
        if correction is None:
            return self._verdict(Outcome.EMPTY, surprise.squared, surprise.rows)
        limit = float(chi2.ppf(self._config.probability, surprise.rows))
        outcome = Outcome.TAKEN
        if surprise.squared > limit:
            self._refusals += 1
            if self._refusals <= self._config.patience:
                return self._verdict(Outcome.REFUSED, surprise.squared, surprise.rows)
            outcome = Outcome.GAVE_IN
            correction = self._widened_for(core, evidence if whole is None else whole)
        self._refusals = 0
        core.apply(correction)
        return self._verdict(outcome, surprise.squared, surprise.rows)

    @staticmethod
    def _widened_for(core: SquareRootFilter, evidence: PoseEvidence) -> Correction:
        """Widen the filter by as much as the evidence surprises it, and weigh it again."""
        surprise, correction = weigh(core, evidence)
        if correction is not None and surprise.squared > surprise.rows:
            core.factor = core.factor * float((surprise.squared / surprise.rows) ** 0.5)
            _, correction = weigh(core, evidence)
        assert correction is not None, "evidence that surprises says something"
        return correction

    def _verdict(self, outcome: Outcome, squared: float, rows: int) -> Verdict:
        self.counts[f"feedback_{outcome.value}"] += 1
        return Verdict(outcome, squared, rows)

# SPDX-License-Identifier: BSD-3-Clause
"""The files of evaluations: ``compare.json`` and ``ranking.json``, of one recording or of several.

The keys of ``EvaluationRecord`` are the contract of ``evaluate --json`` and ``compare.json``.
"""

import re
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar, Literal, Self

from pydantic import BaseModel, ConfigDict, model_validator

from coclo_vio.evaluation.alignment import Alignment
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.evaluation.metrics import DriftInstant
from coclo_vio.evaluation.ranking import Ranking
from coclo_vio.values.record import Record, RecordMapping

_COMPARE_AGAIN = "compare again"
_SEGMENT_KEY = re.compile(r"drift_([0-9.e+-]+)m_percent")
_COPIED = (
    *("ate_m", "ate_planar_m", "rpe_1m_percent", "drift_percent", "paper_drift_percent", "paper_drift_at"),
    *("velocity_rmse_mps", "velocity_source", "yaw_drift_deg", "path_length_m", "path_length_estimate_m"),
    *("path_length_ratio", "coverage", "anees_pose", "realtime_factor", "alignment", "start_tilt_deg", "duration_s"),
    *("poses", "notes"),
)


class GapsRecord(BaseModel):
    """Holes in the trajectories and the poses left out for them; see ``evaluation.Gaps``."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    ground_truth_holes: int
    estimate_holes: int
    poses_outside: int
    poses_in_holes: int


class EvaluationRecord(Record):
    """One trajectory against its ground truth: ``Evaluation`` without its trajectories, and its clock in flat keys.

    Besides, a key such as ``drift_100m_percent`` for each length of segment that the ground truth travels.
    """

    model_config = ConfigDict(extra="allow")
    next_step: ClassVar[str] = _COMPARE_AGAIN

    schema_version: Literal[1] = 1
    ate_m: float
    ate_planar_m: float
    rpe_1m_percent: float | None
    drift_percent: float | None
    paper_drift_percent: float | None
    paper_drift_at: DriftInstant
    velocity_rmse_mps: float | None
    velocity_source: Literal["estimate", "positions"]
    yaw_drift_deg: float
    path_length_m: float
    path_length_estimate_m: float
    path_length_ratio: float | None
    coverage: float | None
    anees_pose: float | None
    realtime_factor: float | None
    alignment: Alignment
    start_tilt_deg: float
    duration_s: float
    poses: int
    gaps: GapsRecord
    notes: tuple[str, ...]
    clock_offset_s: float
    clock_rate_hz: float | None
    clock_is_estimated: bool
    clock_correlation: float | None
    clock_residual_deg: float | None
    __pydantic_extra__: dict[str, float]

    @classmethod
    def of(cls, evaluation: Evaluation) -> Self:
        """The record of an evaluation."""
        clock, gaps = evaluation.clock, evaluation.gaps
        values: dict[str, Any] = {name: getattr(evaluation, name) for name in _COPIED}
        values |= {
            f"drift_{length_m:g}m_percent": drift for length_m, drift in evaluation.segment_drift_percent.items()
        }
        return cls(
            **values,
            gaps=GapsRecord(
                ground_truth_holes=gaps.ground_truth_holes,
                estimate_holes=gaps.estimate_holes,
                poses_outside=gaps.poses_outside,
                poses_in_holes=gaps.poses_in_holes,
            ),
            clock_offset_s=clock.offset_s,
            clock_rate_hz=clock.rate_hz,
            clock_is_estimated=clock.is_estimated,
            clock_correlation=clock.correlation,
            clock_residual_deg=clock.residual_deg,
        )

    @property
    def segment_drift_percent(self) -> dict[float, float]:
        """Mean drift over all segments by their length, m."""
        return {float(_SEGMENT_KEY.fullmatch(key)[1]): drift for key, drift in self.__pydantic_extra__.items()}  # type: ignore[index]

    @model_validator(mode="after")
    def _check_segment_keys(self) -> Self:
        unknown = [key for key in self.__pydantic_extra__ if not _SEGMENT_KEY.fullmatch(key)]
        if unknown:
            raise ValueError(f"there is no {unknown[0]}; further keys are called drift_<length>m_percent")
        return self


class ComparisonRecord(RecordMapping[EvaluationRecord]):
    """``compare.json`` of one recording: an object for each trajectory."""

    next_step: ClassVar[str] = _COMPARE_AGAIN

    @classmethod
    def of(cls, evaluations: Mapping[str, Evaluation]) -> Self:
        """The record of evaluations by trajectory."""
        return cls({name: EvaluationRecord.of(evaluation) for name, evaluation in evaluations.items()})


class ComparisonsRecord(RecordMapping[ComparisonRecord]):
    """``compare.json`` over several recordings: by recording, then by trajectory."""

    next_step: ClassVar[str] = _COMPARE_AGAIN

    @classmethod
    def of(cls, evaluations: Mapping[str, Mapping[str, Evaluation]]) -> Self:
        """The record of evaluations by recording and trajectory."""
        return cls({recording: ComparisonRecord.of(by_name) for recording, by_name in evaluations.items()})


class RankedPair(BaseModel):
    """Two trajectories compared by their drift; see ``ranking.Ranking``.

    Attributes:
        drifts_less: whether the subject does; None where it is undecided.
        resolution_m: smaller differences may be noise of the ground truth, m.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    subject: str
    against: str
    drifts_less: bool | None
    subject_end_error_m: float
    against_end_error_m: float
    resolution_m: float
    sentence: str


class RankingRecord(Record):
    """``ranking.json`` of one recording."""

    next_step: ClassVar[str] = _COMPARE_AGAIN

    schema_version: Literal[1] = 1
    pairs: tuple[RankedPair, ...]

    @classmethod
    def of(cls, rankings: Iterable[Ranking]) -> Self:
        """The record of the rankings of one recording."""
        return cls(
            pairs=tuple(
                RankedPair(
                    subject=ranking.subject,
                    against=ranking.against,
                    drifts_less=None if ranking.drift == "undecided" else ranking.drift == "less",
                    subject_end_error_m=ranking.subject_m,
                    against_end_error_m=ranking.against_m,
                    resolution_m=ranking.resolution_m,
                    sentence=ranking.sentence,
                )
                for ranking in rankings
            )
        )


class RankingsRecord(RecordMapping[RankingRecord]):
    """``ranking.json`` over several recordings, by recording."""

    next_step: ClassVar[str] = _COMPARE_AGAIN

    @classmethod
    def of(cls, rankings: Mapping[str, Iterable[Ranking]]) -> Self:
        """The record of rankings by recording."""
        return cls({recording: RankingRecord.of(found) for recording, found in rankings.items()})

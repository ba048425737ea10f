# SPDX-License-Identifier: BSD-3-Clause
"""``compare.json`` and ``ranking.json`` are read as they were written; older and damaged ones are refused."""

import json

import numpy as np
import pytest

from coclo_vio.evaluation.evaluate import EvaluationConfig, evaluate
from coclo_vio.evaluation.evaluation_record import (
    ComparisonRecord,
    ComparisonsRecord,
    EvaluationRecord,
    RankingRecord,
    RankingsRecord,
)
from coclo_vio.evaluation.ranking import Ranking
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.trajectory import GroundTruth

CONTRACT = {
    "schema_version", "ate_m", "rpe_1m_percent", "drift_percent", "paper_drift_percent", "velocity_rmse_mps",
    "yaw_drift_deg", "path_length_m", "path_length_ratio", "coverage", "anees_pose", "realtime_factor",
}  # fmt: skip


@pytest.fixture
def evaluations(walk, line):
    truth, straight = walk(np.arange(0.0, 25.0, 0.02)), line(20.0, scale=1.01)
    config = EvaluationConfig.model_validate({"clock": {"offset_s": 0.0}, "segment_lengths_m": (2.5, 10.0)})
    return {
        "legs": evaluate(walk(np.arange(0.0, 25.0, 0.02), 1), GroundTruth(truth, True, "vicon")),
        "vision": evaluate(straight, GroundTruth(line(20.0), True, "vicon"), config),
    }


def test_a_comparison_is_an_object_for_each_trajectory(evaluations, tmp_path):
    ComparisonRecord.of(evaluations).write(tmp_path / "compare.json")
    values = json.loads((tmp_path / "compare.json").read_text(encoding="utf-8"))
    assert list(values) == ["legs", "vision"]
    assert all(set(each) >= CONTRACT for each in values.values())
    assert all(each["schema_version"] == 1 for each in values.values())
    assert values["legs"]["ate_m"] == evaluations["legs"].ate_m
    assert ComparisonRecord.read(tmp_path / "compare.json") == ComparisonRecord.of(evaluations)


def test_drifts_over_segments_are_keys_of_their_own(evaluations):
    record = EvaluationRecord.of(evaluations["vision"])
    values = record.to_json()
    assert values["drift_2.5m_percent"] == pytest.approx(1.0, abs=1e-6)
    assert record.segment_drift_percent == evaluations["vision"].segment_drift_percent
    assert EvaluationRecord.parse(values, "compare.json") == record


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema_version": None}, r"^compare.json: legs: it has no schema version.* reads version 1; compare again$"),
        ({"ate_m": "far"}, r"^compare.json: legs.ate_m = 'far': "),
        ({"ate": 1.0}, r"^compare.json: legs: there is no ate; further keys are called drift_<length>m_percent"),
        ({"gaps": {"holes": 1}}, r"^compare.json: legs.gaps.ground_truth_holes"),
    ],
)
def test_another_schema_is_refused(evaluations, change, message):
    values = ComparisonRecord.of(evaluations).to_json()
    values["legs"] |= change
    with pytest.raises(DatasetError, match=message):
        ComparisonRecord.parse(values, "compare.json")


def test_several_recordings_are_an_object_for_each(evaluations, tmp_path):
    record = ComparisonsRecord.of({"walk": evaluations, "empty": {}})
    record.write(tmp_path / "compare.json")
    assert ComparisonsRecord.read(tmp_path / "compare.json") == record
    assert record["walk"] == ComparisonRecord.of(evaluations)


def test_a_ranking_is_read_as_it_was_written(tmp_path):
    rankings = [
        Ranking("fused_legs", "legs", "less", 0.01, 0.1, 0.002, 5.0),
        Ranking("fused_vision", "vision", "undecided", 0.01, 0.011, 0.002, 5.0),
        Ranking("legs", "vision", "more", 0.1, 0.011, 0.002, 5.0),
    ]
    RankingRecord.of(rankings).write(tmp_path / "ranking.json")
    record = RankingRecord.read(tmp_path / "ranking.json")
    assert [pair.drifts_less for pair in record.pairs] == [True, None, False]
    assert record.pairs[0].sentence == "fused Legs drifts less than Legs: 10.0 mm off after 5.00 m, not 100 mm"
    assert (record.pairs[1].subject_end_error_m, record.pairs[1].against_end_error_m) == (0.01, 0.011)
    RankingsRecord.of({"walk": rankings}).write(tmp_path / "ranking.json")
    assert RankingsRecord.read(tmp_path / "ranking.json")["walk"] == record
    with pytest.raises(DatasetError, match="it has no schema version"):
        RankingRecord.read(tmp_path / "ranking.json")

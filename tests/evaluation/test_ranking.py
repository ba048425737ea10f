# SPDX-License-Identifier: BSD-3-Clause
"""Trajectories are ranked by their drift, and not ranked where the noise of the ground truth may decide."""

import numpy as np
import pytest

from coclo_vio.evaluation.evaluate import EvaluationConfig, evaluate
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.evaluation.evaluation_record import RankingRecord
from coclo_vio.evaluation.ranking import end_error_m, least_drift, rank, resolution_m, resolution_sentence
from coclo_vio.values.trajectory import GroundTruth

CONFIG = EvaluationConfig.model_validate({"clock": {"offset_s": 0.0}})


@pytest.fixture
def drifting(line):
    """``drifting(metres, off_m)``: an evaluation of an estimate that is off by ``off_m`` after a path of ``metres``."""

    def make(metres: float, off_m: float) -> Evaluation:
        truth = line(metres, 30.0)
        estimate = line(metres, 30.0, scale=1.0 + off_m / metres)
        return evaluate(estimate, GroundTruth(truth, True, "truth"), CONFIG)

    return make


def test_the_end_error_is_the_distance_at_the_end(drifting):
    evaluation = drifting(5.0, 0.1)
    assert end_error_m(evaluation, CONFIG) == pytest.approx(0.1, rel=0.05)


def test_standalone_and_fused_trajectories_are_ranked_by_their_drift(drifting):
    evaluations = {
        "legs": drifting(5.0, 0.1),
        "vision": drifting(5.0, 0.05),
        "fused_legs": drifting(5.0, 0.02),
        "fused_vision": drifting(5.0, 0.2),
    }
    found = {(ranking.subject, ranking.against): ranking for ranking in rank(evaluations, CONFIG)}
    assert [(pair, ranking.drift) for pair, ranking in found.items()] == [
        (("vision", "legs"), "less"),
        (("fused_legs", "legs"), "less"),
        (("fused_vision", "vision"), "more"),
        (("fused_legs", "vision"), "less"),
    ]
    assert found["vision", "legs"].sentence.startswith("Vision drifts less than Legs: ")
    assert "19.3 mm off after 5.00 m, not 96.7 mm" in found["fused_legs", "legs"].sentence
    assert [pair.drifts_less for pair in RankingRecord.of(found.values()).pairs] == [True, True, False, True]


def test_a_difference_within_the_noise_of_the_ground_truth_is_undecided(drifting):
    evaluations = {"legs": drifting(0.6, 0.005), "vision": drifting(0.6, 0.0045)}
    [ranking] = rank(evaluations, CONFIG)
    assert ranking.drift == "undecided"
    assert "ground truth too short to decide" in ranking.sentence
    assert RankingRecord.of([ranking]).pairs[0].drifts_less is None
    assert resolution_sentence([ranking]) == "ground truth resolves differences above 1.7 mm"
    exact = CONFIG.model_copy(update={"ground_truth_position_noise_m": 1e-5, "ground_truth_rotation_noise_rad": 0.0})
    [ranking] = rank(evaluations, exact)
    assert (ranking.subject, ranking.drift) == ("vision", "less")
    assert resolution_sentence([ranking]) is None


def test_noise_stays_below_the_resolution_in_nineteen_of_twenty_cases(drifting):
    """Two estimates that are equally far off, square to each other, against a ground truth with noise as configured."""
    rng = np.random.default_rng(3)
    within_m = resolution_m(drifting(5.0, 0.001), CONFIG)
    readings = 10
    ends = rng.normal(0.0, 0.001 / np.sqrt(readings), (20_000, 2, 2)).sum(axis=1)
    turned = rng.normal(0.0, 0.002 / np.sqrt(readings), 20_000)
    shift = ends + np.stack((np.zeros_like(turned), 5.0 * turned), axis=1)
    first, second = np.array([0.1, 0.1]) / np.sqrt(2.0), np.array([0.1, -0.1]) / np.sqrt(2.0)
    apart = np.linalg.norm(first + shift, axis=1) - np.linalg.norm(second + shift, axis=1)
    assert 0.9 < np.mean(np.abs(apart) <= within_m) < 0.99


def test_the_nearest_estimate_is_listed_with_those_within_the_noise_of_it(drifting):
    evaluations = {"a": drifting(0.6, 0.02), "b": drifting(0.6, 0.0042), "c": drifting(0.6, 0.004)}
    assert least_drift(evaluations, CONFIG) == ("c", "b")
    assert least_drift({}, CONFIG) == ()


def test_baselines_are_not_ranked(drifting):
    assert rank({"naive": drifting(0.6, 0.004), "legs": drifting(0.6, 0.005)}, CONFIG) == ()

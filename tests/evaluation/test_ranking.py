# SPDX-License-Identifier: BSD-3-Clause
"""What a recording says of legs, eyes and both, and that it does not say more than its ground truth can tell."""

import numpy as np
import pytest

from coclo_vio.evaluation.evaluate import EvaluationConfig, evaluate
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.evaluation.ranking import claims, difference_margin_m, end_error_m, least_drift, what_can_be_told
from coclo_vio.values.trajectory import GroundTruth

CONFIG = EvaluationConfig.model_validate({"clock": {"offset_s": 0.0}})


@pytest.fixture
def drifting(line):
    """``drifting(metres, off_m)``: an evaluation whose estimate is so far off at the end of so long a way."""

    def make(metres: float, off_m: float) -> Evaluation:
        truth = line(metres, 30.0)
        estimate = line(metres, 30.0, scale=1.0 + off_m / metres)
        return evaluate(estimate, GroundTruth(truth, True, "truth"), CONFIG)

    return make


def test_the_end_is_as_far_off_as_it_is(drifting):
    evaluation = drifting(5.0, 0.1)
    assert end_error_m(evaluation, CONFIG) == pytest.approx(0.1, rel=0.05)


def test_each_claim_says_who_drifts_less(drifting):
    evaluations = {
        "coclo": drifting(5.0, 0.1),
        "vins": drifting(5.0, 0.05),
        "combined_coclo": drifting(5.0, 0.02),
        "combined_vins": drifting(5.0, 0.2),
    }
    found = {(claim.subject, claim.against): claim for claim in claims(evaluations, CONFIG)}
    verdicts = {pair: claim.verdict for pair, claim in found.items()}
    assert verdicts == {
        ("vins", "coclo"): "yes",
        ("combined_coclo", "coclo"): "yes",
        ("combined_vins", "vins"): "no",
        ("combined_coclo", "vins"): "yes",
    }
    assert found["vins", "coclo"].sentence.startswith("VINS drifts less than COCLO: ")
    assert "19.3 mm off after 5.00 m, not 96.7 mm" in found["combined_coclo", "coclo"].sentence
    assert found["combined_vins", "vins"].to_json()["drifts_less"] is False


def test_a_difference_within_the_noise_of_the_ground_truth_is_left_open(drifting):
    evaluations = {"coclo": drifting(0.6, 0.005), "vins": drifting(0.6, 0.0045)}
    [claim] = claims(evaluations, CONFIG)
    assert claim.verdict == "open"
    assert "ground truth too short to tell" in claim.sentence
    assert claim.to_json()["drifts_less"] is None
    assert what_can_be_told([claim]) == "ground truth tells differences above 1.7 mm"
    exact = CONFIG.model_copy(update={"ground_truth_position_noise_m": 1e-5, "ground_truth_rotation_noise_rad": 0.0})
    [claim] = claims(evaluations, exact)
    assert (claim.subject, claim.verdict) == ("vins", "yes")
    assert what_can_be_told([claim]) is None


def test_the_margin_is_kept_by_noise_in_nineteen_of_twenty_cases(drifting):
    """Two estimates that are equally far off, square to each other, against a ground truth with the noise it has."""
    rng = np.random.default_rng(3)
    margin = difference_margin_m(drifting(5.0, 0.001), CONFIG)
    readings = 10
    ends = rng.normal(0.0, 0.001 / np.sqrt(readings), (20_000, 2, 2)).sum(axis=1)
    turned = rng.normal(0.0, 0.002 / np.sqrt(readings), 20_000)
    shift = ends + np.stack((np.zeros_like(turned), 5.0 * turned), axis=1)
    one, other = np.array([0.1, 0.1]) / np.sqrt(2.0), np.array([0.1, -0.1]) / np.sqrt(2.0)
    apart = np.linalg.norm(one + shift, axis=1) - np.linalg.norm(other + shift, axis=1)
    assert 0.9 < np.mean(np.abs(apart) <= margin) < 0.99


def test_the_nearest_estimate_comes_first_with_those_that_cannot_be_told_from_it(drifting):
    evaluations = {"a": drifting(0.6, 0.02), "b": drifting(0.6, 0.0042), "c": drifting(0.6, 0.004)}
    assert least_drift(evaluations, CONFIG) == ("c", "b")
    assert least_drift({}, CONFIG) == ()


def test_without_the_papers_estimators_nothing_is_claimed(drifting):
    assert claims({"naive": drifting(0.6, 0.004), "coclo": drifting(0.6, 0.005)}, CONFIG) == ()

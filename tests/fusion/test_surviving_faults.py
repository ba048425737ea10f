# SPDX-License-Identifier: BSD-3-Clause
"""Legs and eyes together on the analytic walk of ``test_combined``, with each fault put on it."""

from collections.abc import Iterator

import numpy as np
import pytest
from test_combined import DAISY, WALK, combined, events, miss_m, play

from coclo_vio.runs.faults import Faults, FaultsConfig
from coclo_vio.simulation.analytic import AnalyticTrial, AnalyticTrialConfig, generate
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.measurements import Measurement


@pytest.fixture(scope="module")
def walk() -> AnalyticTrial:
    return generate(AnalyticTrialConfig(body=WALK), DAISY, seed=5)


@pytest.fixture(scope="module")
def recorded(walk: AnalyticTrial) -> list[Measurement]:
    return events(walk)


def answers(recorded: list[Measurement], **faults: object) -> tuple[list[StateEstimate], list[StateEstimate]]:
    """By legs and by eyes, with faults."""

    def read(sensors: frozenset[type]) -> Iterator[Measurement]:
        return (one for one in recorded if type(one) in sensors)

    put_on = Faults(FaultsConfig.parse(faults, "test"), DAISY.description)
    return play(combined(), put_on.measurements(read, frozenset(type(one) for one in recorded)))


@pytest.mark.parametrize(
    "faults", [{"frame_loss": 0.3}, {"frozen_legs": "leg2:2:1.5"}], ids=["lost frames", "frozen leg"]
)
def test_one_that_fails_is_held_by_the_other(
    walk: AnalyticTrial, recorded: list[Measurement], faults: dict[str, object]
) -> None:
    by_legs, by_eyes = answers(recorded, **faults)
    assert len(by_legs) > 400
    assert max(miss_m(walk, one) for one in (*by_legs, *by_eyes)) < 0.02


def test_where_both_fail_at_once_the_answers_go_on_and_know_how_little_they_know(
    walk: AnalyticTrial, recorded: list[Measurement]
) -> None:
    """Darkness begins while the joints say nothing: for half a second there is a gyroscope and no more."""
    by_legs, by_eyes = answers(recorded, silent_joints="2:1", blackouts="2.5:1")
    for estimates in (by_legs, by_eyes):
        assert estimates[-1].stamp_ns > walk.truth.stamps_ns[-1] - 100_000_000
        sure_m = [float(np.sqrt(np.trace(one.covariance[3:6, 3:6]))) for one in estimates]
        missed_m = [miss_m(walk, one) for one in estimates]
        assert all(missed < 3.0 * sure + 0.01 for missed, sure in zip(missed_m, sure_m, strict=True))
        assert sure_m[-1] > 0.02

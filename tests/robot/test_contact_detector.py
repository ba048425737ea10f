# SPDX-License-Identifier: BSD-3-Clause
"""The built-in contact estimators, and the guard around every estimator."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coclo_vio.robot.contact import ContactConfig, ContactDetector
from coclo_vio.robot.contact_probability import logistic_probability, paper_probability
from coclo_vio.values.errors import ConfigError

MS = 1_000_000
METHODS = ["paper", "logistic", "hysteresis"]
load = st.floats(-1e4, 1e4)


def stances(config: ContactConfig, loads: list[float], step_ns: int = 10 * MS) -> list[bool]:
    detector = ContactDetector(config, legs=1)
    return [bool(detector.update(i * step_ns, np.array([value])).is_stance[0]) for i, value in enumerate(loads)]


@settings(derandomize=True, max_examples=60)
@given(loads=st.lists(load, min_size=2, max_size=20), method=st.sampled_from(METHODS))
def test_probability_stays_in_bounds_and_grows_with_the_load(loads, method) -> None:
    detector = ContactDetector(ContactConfig(method=method), legs=len(loads))
    state = detector.update(0, np.array(loads))
    assert ((state.probability >= 0.0) & (state.probability <= 1.0)).all()
    assert (np.diff(state.probability[np.argsort(loads)]) >= 0.0).all()


@settings(derandomize=True, max_examples=60)
@given(loads=st.lists(st.floats(0, 40), min_size=2, max_size=60))
def test_hysteresis_is_stance_above_on_swing_below_off_and_unchanged_between(loads) -> None:
    before = False
    for value, now in zip(loads, stances(ContactConfig(on_force=20, off_force=12), loads), strict=True):
        expected = True if value >= 20 else (False if value < 12 else before)
        assert now == expected
        before = now


def test_paper_probability_by_hand() -> None:
    np.testing.assert_allclose(paper_probability(np.array([-5.0, 0.0, 15.0, 30.0, 50.0]), 30.0), [0, 0, 0.5, 1, 1])
    detector = ContactDetector(ContactConfig(method="paper", max_force=50, min_force=10), legs=2)
    state = detector.update(0, np.array([10.0, 30.0]))
    np.testing.assert_allclose(state.probability, [0.25, 0.75])
    np.testing.assert_array_equal(state.is_stance, [False, True])


def test_paper_without_recorded_forces_is_even_midway_between_off_and_on() -> None:
    state = ContactDetector(ContactConfig(method="paper", on_force=20, off_force=12), legs=1).update(
        0, np.array([16.0])
    )
    assert state.probability[0] == pytest.approx(0.5)


def test_logistic_probability_by_hand() -> None:
    width = 2.0
    odds = logistic_probability(np.array([16.0, 18.0, 14.0, -1e9, 1e9]), 16.0, width)
    np.testing.assert_allclose(odds, [0.5, 1 / (1 + np.exp(-1)), 1 / (1 + np.exp(1)), 0.0, 1.0], atol=1e-15)
    config = ContactConfig(method="logistic", logistic_centre=30, logistic_width=5)
    state = ContactDetector(config, legs=2).update(0, np.array([29.0, 31.0]))
    np.testing.assert_array_equal(state.is_stance, [False, True])


def test_stance_probability_moves_the_decision_of_the_memoryless_methods() -> None:
    config = ContactConfig(method="paper", max_force=100, min_force=0, stance_probability=0.8)
    assert stances(config, [79.0, 80.0, 79.0]) == [False, True, False]


def test_on_dwell_ignores_a_short_impact() -> None:
    config = ContactConfig(on_force=20, off_force=12, on_dwell_s=0.03)
    loads = [0, 50, 50, 50, 5, 50, 50, 50, 50, 15, 15]
    expected = [False] * 8 + [True] * 3
    assert stances(config, loads) == expected


def test_off_dwell_bridges_a_short_gap() -> None:
    config = ContactConfig(on_force=20, off_force=12, off_dwell_s=0.02)
    assert stances(config, [50, 5, 5, 15, 5, 5, 5, 15]) == [True] * 6 + [False] * 2


def test_dwell_is_time_not_samples() -> None:
    config = ContactConfig(on_force=20, off_force=12, on_dwell_s=0.03)
    fast = stances(config, [50.0] * 40, step_ns=MS)
    assert fast.index(True) == 30
    assert stances(config, [50.0] * 3, step_ns=20 * MS) == [False, False, True]


@pytest.mark.parametrize("method", METHODS)
def test_a_missing_load_is_no_contact_at_once_and_counted(method) -> None:
    detector = ContactDetector(ContactConfig(method=method, off_dwell_s=0.5), legs=2)
    assert detector.update(0, np.array([50.0, 50.0])).is_stance.all()
    state = detector.update(MS, np.array([np.nan, 50.0]))
    np.testing.assert_array_equal(state.is_stance, [False, True])
    assert state.probability[0] == 0.0
    assert np.isnan(state.load[0])
    assert detector.counts["contact_load_missing"] == 1
    np.testing.assert_array_equal(detector.update(2 * MS, np.array([50.0, 50.0])).is_stance, [True, True])


def test_a_stamp_that_goes_back_changes_nothing_and_is_counted() -> None:
    detector = ContactDetector(ContactConfig(), legs=1)
    state = detector.update(5 * MS, np.array([50.0]))
    assert detector.update(4 * MS, np.array([0.0])) is state
    assert detector.counts["contact_stamp_backwards"] == 1
    assert not detector.update(6 * MS, np.array([0.0])).is_stance[0]


def test_states_do_not_change_afterwards() -> None:
    detector = ContactDetector(ContactConfig(), legs=1)
    state = detector.update(0, np.array([50.0]))
    detector.update(MS, np.array([0.0]))
    assert state.is_stance[0]
    assert state.probability[0] > 0.9


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"on_force": 10, "off_force": 12}, r"off_force = 12\.0 must lie below on_force = 10\.0"),
        ({"max_force": 50}, "set both or neither"),
        ({"max_force": 50, "min_force": 60}, r"min_force = 60\.0 must lie below max_force = 50\.0"),
        ({"on_dwell_s": -1}, "greater than or equal to 0"),
        (
            {"method": "schmitt"},
            "no contact estimator 'schmitt'; there are: hysteresis, kinematic, kinematic_load, logistic, paper; ",
        ),
        ({"parameters": {"gain": 2}}, "'hysteresis' takes no parameters, but gain is given; remove it"),
        ({"method": "logistic", "parameters": {"gain": 2}}, "'logistic' takes no parameters"),
        ({"method": "paper", "parameters": {"gain": 2}}, "'paper' takes no parameters"),
        ({"on_treshold": 3}, "there is no on_treshold; the keys there are: .*on_force"),
    ],
)
def test_a_wrong_configuration_is_refused_with_the_reason(values, message) -> None:
    with pytest.raises(ConfigError, match=message):
        ContactConfig.parse(values, "contact")

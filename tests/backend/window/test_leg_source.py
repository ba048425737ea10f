# SPDX-License-Identifier: BSD-3-Clause
"""Legs as a source of the window: priors and factors hold what leg odometry gave, and nothing else."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.factors import Term
from coclo_vio.backend.window.keyframe_source import KeyframeState
from coclo_vio.backend.window.leg_source import LegSource
from coclo_vio.backend.window.motion_model import PredictedMotion
from coclo_vio.backend.window.variables import POSE, KeyframeVariables
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.leg_motion import LegMotion, LegState

LEGS, SIZE = 5, 11
START_NS, END_NS = 1_000, 2_000
STEADY = PredictedMotion(np.eye(4), np.zeros(3), np.eye(6), np.zeros((3, 3)), is_measured=False)


def state(stamp_ns: int, seed: int) -> LegState:
    random = np.random.default_rng(seed)
    root = random.normal(size=(SIZE, SIZE))
    T_world_body = se3.exp(random.normal(0.0, 0.5, size=6))
    return LegState(stamp_ns, T_world_body, random.normal(size=LEGS), 0.01 * (root @ root.T + np.eye(SIZE)))


def motion(start: LegState, seed: int = 5) -> LegMotion:
    random = np.random.default_rng(seed)
    end, rows = state(END_NS, seed + 1), random.normal(size=(SIZE + 4, 2 * SIZE))
    return LegMotion(start, end, rows, random.normal(size=SIZE + 4), np.array([0.1, 0.2, 0.3]), 0.01 * np.eye(6))


def keyframe(source: LegSource, of: LegState) -> KeyframeState:
    """Number 0, as it was given."""
    variables, values = KeyframeVariables(source.variables), gtsam.Values()
    values.insert(POSE.key(0), gtsam.Pose3(of.T_world_body))
    values.insert(source.legs.key(0), np.array(of.legs))
    covariance = np.eye(variables.state_size)
    rows = np.r_[0:6, variables.rows(source.legs)]
    covariance[np.ix_(rows, rows)] = of.covariance
    return KeyframeState(0, of.stamp_ns, values, covariance, variables)


def linear(terms: list[Term], keys: list[int], values: gtsam.Values) -> tuple[Array, Array]:
    """Information and vector of some keys."""
    graph = gtsam.NonlinearFactorGraph()
    for term in terms:
        graph.push_back(term.factor)
    information, vector = graph.linearize(values).hessian(factors.ordered(keys))
    return np.asarray(information), np.ravel(vector)


def test_the_prior_of_a_beginning_is_leg_odometrys_covariance_once_the_pose_has_its_own() -> None:
    given = state(START_NS, 1)
    source = LegSource(given)
    first = source.begin(0, START_NS, np.zeros(3), 1.0)
    values = keyframe(source, given).values
    pose = factors.pose_prior(0, given.T_world_body, given.covariance[:6, :6])
    information, vector = linear([pose, *first.terms], [POSE.key(0), source.legs.key(0)], values)
    np.testing.assert_allclose(np.linalg.inv(information), given.covariance, rtol=1e-6, atol=1e-10)
    np.testing.assert_allclose(vector, 0.0, atol=1e-9)
    np.testing.assert_array_equal(first.values[source.legs], given.legs)


def test_the_tie_holds_what_was_measured_of_both_keyframes() -> None:
    given = state(START_NS, 1)
    source, measured = LegSource(given), motion(given)
    source.take(measured)
    newest = keyframe(source, given)
    ties = source.ties(newest, END_NS, STEADY)
    values = gtsam.Values(newest.values)
    values.insert(POSE.key(1), gtsam.Pose3(measured.end.T_world_body))
    values.insert(source.legs.key(1), np.array(measured.end.legs))
    keys = [key for number in (0, 1) for key in (POSE.key(number), source.legs.key(number))]
    information, vector = linear(list(ties.terms), keys, values)
    assert ties.has_motion
    assert ties.gap is None
    np.testing.assert_allclose(information, measured.rows.T @ measured.rows, atol=1e-9)
    np.testing.assert_allclose(vector, measured.rows.T @ measured.measured, atol=1e-9)
    np.testing.assert_array_equal(source.initial(STEADY)[source.legs], measured.end.legs)


def test_a_frame_is_expected_where_leg_odometry_has_it() -> None:
    given = state(START_NS, 1)
    source, measured = LegSource(given), motion(given)
    assert source.expect(keyframe(source, given), END_NS, STEADY) is None
    source.take(measured)
    expected = source.expect(keyframe(source, given), END_NS, STEADY)
    assert expected is not None
    assert expected.is_measured
    np.testing.assert_array_equal(expected.T_world_body, measured.end.T_world_body)
    np.testing.assert_array_equal(expected.velocity_world, measured.velocity_world)


@pytest.mark.parametrize("change", ["start", "end"])
def test_a_motion_between_other_times_ties_nothing_and_says_so(change: str) -> None:
    given = state(START_NS, 1)
    source, measured = LegSource(given), motion(given)
    source.take(replace(measured, **{change: replace(getattr(measured, change), stamp_ns=1_500)}))
    ties = source.ties(keyframe(source, given), END_NS, STEADY)
    assert not ties.has_motion
    assert ties.gap is not None
    assert [term.keys for term in ties.terms] == [(source.legs.key(1),)]


def test_leg_odometry_goes_on_from_the_state_in_the_window() -> None:
    given = state(START_NS, 1)
    source, solved = LegSource(given), state(END_NS, 9)
    source.take(motion(given))
    source.restart(keyframe(source, solved))
    assert source.newest.stamp_ns == END_NS
    np.testing.assert_allclose(source.newest.T_world_body, solved.T_world_body)
    np.testing.assert_array_equal(source.newest.legs, solved.legs)
    np.testing.assert_array_equal(source.newest.covariance, solved.covariance)
    assert source.expect(keyframe(source, solved), 3_000, STEADY) is None


def test_a_window_that_begins_at_another_time_is_an_error_that_names_both() -> None:
    with pytest.raises(SmootherError, match=r"2000 ns.*1000 ns"):
        LegSource(state(START_NS, 1)).begin(0, END_NS, np.zeros(3), 1.0)

# SPDX-License-Identifier: BSD-3-Clause
"""Angular velocities are compared up to a rotation, never up to a mirror."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from coclo_vio.evaluation.angular_motion import AngularMotion, SteadyTurns, correlation, stamped_motion, turning_score


def test_best_rotation_by_hand_and_no_reflection():
    assert turning_score(np.diag([3.0, 2.0, 1.0])) == pytest.approx(6.0)
    assert turning_score(np.diag([3.0, 2.0, -1.0])) == pytest.approx(4.0)


def test_correlation_ignores_a_rotation_but_not_a_mirror():
    rates = np.random.default_rng(1).normal(0.0, 1.0, (500, 3))
    R = Rotation.random(rng=np.random.default_rng(2)).as_matrix()
    assert correlation(rates, rates @ R.T) == pytest.approx(1.0)
    assert correlation(rates, -rates) < 0.5
    assert correlation(rates, np.zeros((500, 3))) is None


def test_rates_are_zero_and_unknown_outside_and_in_holes(walk):
    full = walk(np.arange(0.0, 20.0, 0.01))
    holed = full.select((full.times_s < 8.0) | (full.times_s > 10.0))
    motion = stamped_motion(holed, holed.stamps_ns, 0, 0.2, 0.25)
    rates, is_known = motion.rates(np.array([-1.0, 0.05, 1.0, 7.95, 9.0, 10.5, 25.0]), 0.2)
    assert is_known.tolist() == [False, False, True, False, False, True, False]
    assert not rates[~is_known].any()


def test_attitudes_between_knots_and_their_rates_are_those_of_scipy():
    rng = np.random.default_rng(3)
    times_s = np.cumsum(rng.uniform(0.01, 0.2, 60))
    knots = Rotation.from_rotvec(rng.normal(0.0, 1.0, (60, 3)))  # up to half a turn from one to the next
    asked_s = np.concatenate((times_s, rng.uniform(times_s[0], times_s[-1], 500)))
    found, expected = SteadyTurns.through(times_s, knots.as_matrix()), Slerp(times_s, knots)
    np.testing.assert_allclose(found.at(asked_s), expected(asked_s).as_matrix(), atol=1e-12)
    motion = AngularMotion(found, 1.0, (times_s[0], times_s[-1]), np.zeros((0, 2)))
    middle_s = rng.uniform(times_s[0] + 0.5, times_s[-1] - 0.5, 300)
    turns = (expected(middle_s - 0.25).inv() * expected(middle_s + 0.25)).as_rotvec()
    assert np.linalg.norm(turns, axis=1).max() > 3.1  # some are near half a turn
    np.testing.assert_allclose(motion.rates(middle_s, 0.5)[0], turns / 0.5, atol=1e-9)


def test_outside_its_span_an_attitude_is_that_of_the_nearest_end():
    knots = Rotation.from_rotvec([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    found = SteadyTurns.through(np.array([0.0, 1.0]), knots.as_matrix()).at(np.array([-1.0, 0.5, 2.0]))
    expected = Rotation.from_rotvec([[0.0, 0.0, 0.0], [0.0, 0.0, 0.5], [0.0, 0.0, 1.0]]).as_matrix()
    np.testing.assert_allclose(found, expected, atol=1e-15)

# SPDX-License-Identifier: BSD-3-Clause
"""What the other legs predict of a leg, against least squares written out."""

import numpy as np
import pytest

from coclo_vio.filter.leg_residual_kernel import left_out, translations
from coclo_vio.geometry import so3

LEGS, SIGMA, TURN_SIGMA = 5, 2e-3, 3e-3
RADII = np.full(LEGS, 0.02)
UP = np.array([0.0, 0.0, 1.0])


def test_legs_that_roll_on_one_spot_measure_the_translation_of_the_body() -> None:
    random = np.random.default_rng(3)
    feet = random.uniform(-0.4, 0.4, (LEGS, 3))
    rotations = so3.exp(random.normal(0.0, 0.5, (LEGS, 3)))
    turn, moved = so3.exp(np.array([0.01, -0.02, 0.03])), np.array([0.012, -0.004, 0.002])
    roll = random.normal(0.0, 0.05, (LEGS, 3))
    centres = feet + 0.02 * np.cross(roll, UP)
    later = (centres - moved) @ turn
    later_rotations = turn.T @ so3.exp(roll) @ rotations
    measured, carried = translations((feet, later), (rotations, later_rotations), turn, UP, RADII)
    np.testing.assert_allclose(measured, np.tile(moved, (LEGS, 1)), atol=1e-12)
    np.testing.assert_allclose(carried, centres - moved, atol=1e-12)


@pytest.mark.long
def test_a_leg_is_predicted_by_the_least_squares_of_the_others() -> None:
    random = np.random.default_rng(4)
    moved, levers = random.normal(0.0, 0.01, (LEGS, 3)), random.uniform(-0.4, 0.4, (LEGS, 3))
    used, tested = np.array([True, True, False, True, True]), np.array([True, False, True, True, True])
    predicted, variance = left_out(moved, levers, used, tested, SIGMA, TURN_SIGMA, 2)
    for leg in np.flatnonzero(tested):
        others = [other for other in range(LEGS) if used[other] and other != leg]
        rows = [np.hstack([np.eye(3), -so3.hat(levers[other])]) / SIGMA for other in others]
        prior = np.hstack([np.zeros((3, 3)), np.eye(3) / TURN_SIGMA])
        matrix = np.vstack([*rows, prior])
        values = np.concatenate([*(moved[other] / SIGMA for other in others), np.zeros(3)])
        own = np.hstack([np.eye(3), -so3.hat(levers[leg])])
        np.testing.assert_allclose(predicted[leg], own @ np.linalg.lstsq(matrix, values)[0], atol=1e-12)
        covariance = own @ np.linalg.inv(matrix.T @ matrix) @ own.T
        assert variance[leg] == pytest.approx(np.trace(covariance) / 3.0)
    assert np.isnan(predicted[1]).all()
    assert np.isnan(variance[1])


def test_a_leg_without_enough_others_is_not_predicted() -> None:
    moved, levers = np.zeros((LEGS, 3)), np.eye(LEGS, 3)
    used = np.array([True, True, False, False, False])
    _, variance = left_out(moved, levers, used, np.ones(LEGS, dtype=np.bool_), SIGMA, TURN_SIGMA, 2)
    assert np.isnan(variance[:2]).all()
    assert np.isfinite(variance[2:]).all()

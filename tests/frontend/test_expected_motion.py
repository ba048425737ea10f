# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from coclo_vio.frontend.expected_motion import ExpectedMotion
from coclo_vio.geometry import se3

STEP = se3.exp(np.array([0.01, 0.02, -0.01, 0.05, 0.0, 0.1]))
PERIOD_NS = 100_000_000


def started() -> ExpectedMotion:
    motion = ExpectedMotion()
    motion.advance(0, None)
    motion.set_reference(None)
    return motion


def test_at_first_the_motion_is_unknown() -> None:
    motion = ExpectedMotion()
    motion.advance(0, STEP)
    assert motion.T_reference_current is None


def test_predictions_are_chained_until_the_next_reference() -> None:
    motion = started()
    motion.advance(PERIOD_NS, STEP)
    motion.advance(2 * PERIOD_NS, STEP)
    np.testing.assert_allclose(motion.T_reference_current, STEP @ STEP)
    motion.set_reference(None)
    motion.advance(3 * PERIOD_NS, STEP)
    np.testing.assert_allclose(motion.T_reference_current, STEP)


def test_without_prediction_the_last_motion_is_extrapolated() -> None:
    motion = started()
    motion.advance(PERIOD_NS, None)
    motion.set_reference(STEP)
    motion.advance(3 * PERIOD_NS, None)
    np.testing.assert_allclose(motion.T_reference_current, STEP @ STEP, atol=1e-12)


def test_a_prediction_is_preferred_to_extrapolation() -> None:
    motion = started()
    motion.advance(PERIOD_NS, None)
    motion.set_reference(STEP)
    motion.advance(2 * PERIOD_NS, np.eye(4))
    np.testing.assert_allclose(motion.T_reference_current, np.eye(4))


def test_one_unknown_step_makes_the_motion_unknown() -> None:
    motion = started()
    motion.advance(PERIOD_NS, None)
    motion.advance(2 * PERIOD_NS, STEP)
    assert motion.T_reference_current is None


def test_after_a_long_pause_nothing_is_extrapolated() -> None:
    motion = started()
    motion.advance(PERIOD_NS, None)
    motion.set_reference(STEP)
    motion.advance(30 * PERIOD_NS, None)
    assert motion.T_reference_current is None


def test_after_a_reset_the_motion_is_unknown() -> None:
    motion = started()
    motion.reset()
    motion.advance(PERIOD_NS, STEP)
    assert motion.T_reference_current is None


@pytest.mark.parametrize("step", [np.eye(3), np.full((4, 4), np.nan)])
def test_a_prediction_of_wrong_shape_or_not_finite_is_refused(step: np.ndarray) -> None:
    with pytest.raises(ValueError, match="T_previous_current"):
        started().advance(PERIOD_NS, step)

# SPDX-License-Identifier: BSD-3-Clause
"""Angular velocities are compared up to a rotation, never up to a mirror."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coclo_vio.evaluation.angular_motion import correlation, stamped_motion, turning_score


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

# SPDX-License-Identifier: BSD-3-Clause
"""The mean reading of a step: the compiled form against the readable one, and a turn about an axis by hand."""

import numpy as np
import pytest

from coclo_vio.backend.window.lever_arm import mean_reading_by_numpy, set_mean_reading


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("scale", [0.0, 1e-6, 1.0, 30.0])
def test_the_compiled_form_is_the_readable_one(seed: int, scale: float) -> None:
    random = np.random.default_rng(seed)
    begin, end, bias = scale * random.standard_normal((3, 6))
    before, lever = scale * random.standard_normal(3), random.standard_normal(3)
    result = np.empty(6)
    set_mean_reading(result, begin, end, before, bias, lever, 0.005)
    expected = mean_reading_by_numpy(begin, end, before, bias, lever, 0.005)
    np.testing.assert_allclose(result, expected, rtol=1e-12, atol=1e-12 * max(1.0, np.abs(expected).max()))


def test_the_force_of_angular_acceleration_at_the_end_of_the_arm_is_subtracted() -> None:
    """About z with 2 rad/s^2 at 0.5 m along x: 1 m/s^2 along y, and no turn as long as the rate is zero on average."""
    begin, end = np.array([0.0, 0.0, -0.01, 0.0, 1.0, 9.81]), np.array([0.0, 0.0, 0.01, 0.0, 1.0, 9.81])
    mean = mean_reading_by_numpy(begin, end, begin[:3], np.zeros(6), np.array([0.5, 0.0, 0.0]), 0.01)
    np.testing.assert_allclose(mean, [0.0, 0.0, 0.0, 0.0, 0.0, 9.81], atol=1e-12)

# SPDX-License-Identifier: BSD-3-Clause
"""A gyroscope that was set aside returns when it agrees with the cameras in turns, not while nothing turns."""

import numpy as np
import pytest

from coclo_vio.fusion.gyroscope_return import GyroscopeReturn
from coclo_vio.fusion.rotation_findings import GyroscopeAgrees
from coclo_vio.fusion.rotation_streams import GyroscopeRotation
from coclo_vio.values.arrays import Array
from coclo_vio.values.units import NS_PER_S

BIAS = np.array([0.02, -0.01, 0.03])


def returned(scale: Array, *, amplitude: float = 0.2) -> GyroscopeAgrees | None:
    """What 20 intervals of half a second lead to, with a gyroscope whose axes are multiplied by ``scale``."""
    gyroscope = GyroscopeRotation(np.eye(3))
    watch = GyroscopeReturn(gyroscope)
    periods = np.array([1.7, 2.3, 3.1])
    result, angle_of = None, lambda time_s: amplitude * periods / 6.28 * np.sin(6.28 * time_s / periods)
    for number in range(2000):
        time_s = 0.005 * number
        rate = amplitude * np.cos(6.28 * time_s / periods)
        gyroscope.push(round(time_s * NS_PER_S), scale * rate + BIAS)
        if number and number % 100 == 0:
            turn = angle_of(time_s) - angle_of(time_s - 0.5)
            result = result or watch.push(round((time_s - 0.5) * NS_PER_S), round(time_s * NS_PER_S), turn)
    return result


def test_a_gyroscope_that_agrees_returns_with_its_bias() -> None:
    result = returned(np.ones(3))
    assert result is not None
    np.testing.assert_allclose(result.bias, BIAS, atol=0.005)
    assert 0.0 <= result.sigma < 0.005


@pytest.mark.parametrize("scale", [-np.ones(3), np.array([1.0, 1.0, -1.0]), np.zeros(3)])
def test_a_gyroscope_with_a_wrong_or_dead_axis_does_not_return(scale: Array) -> None:
    assert returned(scale) is None


def test_no_gyroscope_returns_while_the_robot_stands() -> None:
    assert returned(np.ones(3), amplitude=0.0) is None


def test_intervals_without_readings_do_not_count() -> None:
    watch = GyroscopeReturn(GyroscopeRotation(np.eye(3)))
    turns = [watch.push(number * NS_PER_S, (number + 1) * NS_PER_S, np.ones(3) * number) for number in range(20)]
    assert turns == [None] * 20

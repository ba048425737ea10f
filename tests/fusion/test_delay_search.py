# SPDX-License-Identifier: BSD-3-Clause
"""A delay of the images that is found by rates alone, and where it is not to be found."""

from collections.abc import Callable

import numpy as np
import pytest

from coclo_vio.fusion.delay_search import DelaySearch
from coclo_vio.fusion.rotation_streams import GyroscopeRotation
from coclo_vio.values.arrays import Array
from coclo_vio.values.units import NS_PER_S

IMU_S, FRAMES_S, SECONDS = 0.005, 0.4, 12.0
Rates = Callable[[Array], Array]


def wandering(times_s: Array) -> Array:
    """Rates that do not repeat themselves, rad/s, (n, 3)."""
    random = np.random.default_rng(3)
    periods, phases = random.uniform(0.7, 4.0, (3, 6)), random.uniform(0.0, 6.28, (3, 6))
    return np.sin(2.0 * np.pi * times_s[:, None, None] / periods + phases).sum(axis=2) * 0.03


def periodic(times_s: Array) -> Array:
    """Rates of a gait of 0.6 s and nothing else."""
    return np.sin(2.0 * np.pi * times_s[:, None] / 0.6 + np.array([0.0, 1.0, 2.0])) * 0.1


def still(times_s: Array) -> Array:
    """A robot that stands."""
    return np.zeros((len(times_s), 3))


def found(rates: Rates, delay_s: float, *, noise_rad: float = 0.0005, bias: float = 0.0) -> list[float]:
    """The delays that a search finds along a recording with images late by so much."""
    random = np.random.default_rng(1)
    gyroscope = GyroscopeRotation(np.eye(3))
    search = DelaySearch(gyroscope)
    times_s = np.arange(0.0, SECONDS, IMU_S)
    readings = rates(times_s) + bias + 0.002 * random.standard_normal((len(times_s), 3))
    turned = np.cumsum(rates(times_s), axis=0) * IMU_S
    delays, last_s = [], 0.0
    for time_s, reading in zip(times_s, readings, strict=True):
        gyroscope.push(round(time_s * NS_PER_S), reading)
        if time_s - last_s < FRAMES_S or last_s - delay_s < 0.0 or time_s - delay_s > times_s[-1]:
            last_s = time_s if last_s - delay_s < 0.0 else last_s
            continue
        begin, end = (round((each - delay_s) / IMU_S) for each in (last_s, time_s))
        by_vision = turned[end] - turned[begin] + noise_rad * random.standard_normal(3)
        delay = search.push(round(last_s * NS_PER_S), round(time_s * NS_PER_S), by_vision)
        delays += [] if delay is None else [delay]
        last_s = time_s
    return delays


@pytest.mark.parametrize("delay_s", [-0.8, -0.3, -0.1, 0.1, 0.5, 0.9])
def test_a_delay_is_found_to_the_step_of_the_grid_whatever_the_bias(delay_s: float) -> None:
    delays = found(wandering, delay_s, bias=0.1)
    assert delays
    np.testing.assert_allclose(delays, delay_s, atol=0.021)


@pytest.mark.parametrize("delay_s", [0.0, 0.015, -0.02])
def test_nothing_is_found_where_stamps_agree_or_nearly_so(delay_s: float) -> None:
    assert found(wandering, delay_s) == []


@pytest.mark.parametrize(("rates", "delay_s"), [(periodic, 0.3), (still, 0.5)])
def test_nothing_is_found_by_a_gait_that_repeats_itself_or_by_a_robot_that_stands(rates: Rates, delay_s: float) -> None:
    assert found(rates, delay_s) == []


def test_nothing_is_found_in_rates_that_have_nothing_in_common() -> None:
    assert found(wandering, 0.5, noise_rad=0.05) == []


def test_a_restart_forgets_the_pairs_before() -> None:
    gyroscope = GyroscopeRotation(np.eye(3))
    search = DelaySearch(gyroscope)
    for number in range(30):
        search.push(number * NS_PER_S // 2, (number + 1) * NS_PER_S // 2, np.zeros(3))
    search.restart()
    assert search.push(20 * NS_PER_S, 21 * NS_PER_S, np.zeros(3)) is None

# SPDX-License-Identifier: BSD-3-Clause
"""Two IMUs at two places of one moving body, at other rates, against each other."""

from collections.abc import Callable

import numpy as np
import pytest

from coclo_vio.geometry import se3, so3
from coclo_vio.robot.imu_comparison import ImuComparison, ImuDifference
from coclo_vio.values.measurements import CameraImuSample, ImuSample, InertialReading

FIRST = se3.transform(so3.exp(np.array([0.1, -0.2, 0.3])), np.array([0.05, 0.02, -0.03]))
SECOND = se3.transform(so3.exp(np.array([1.2, -1.1, 0.8])), np.array([0.25, -0.05, 0.15]))
START_NS = 1_700_000_000_000_000_000
AMPLITUDES, PULSES = np.array([0.4, 0.3, 0.5]), np.array([8.0, 11.0, 5.0])
STILL_FORCE = np.array([0.3, -0.2, 9.7])
BIASES = np.array([0.01, -0.02, 0.03]), np.array([0.2, -0.1, 0.15])


def rate_at(time_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Angular velocity and its derivative, body axes."""
    return AMPLITUDES * np.sin(PULSES * time_s), AMPLITUDES * PULSES * np.cos(PULSES * time_s)


def sample(kind: type[InertialReading], time_s: float, mounting: np.ndarray, delay_s: float = 0.0) -> InertialReading:
    rate, acceleration = rate_at(time_s - delay_s)
    lever = mounting[:3, 3]
    force = STILL_FORCE + np.cross(acceleration, lever) + np.cross(rate, np.cross(rate, lever))
    gyroscope_bias, accelerometer_bias = BIASES if kind is CameraImuSample else (np.zeros(3), np.zeros(3))
    to_imu = mounting[:3, :3].T
    stamp_ns = START_NS + round(time_s * 1e9)
    return kind(stamp_ns, to_imu @ (rate + gyroscope_bias), to_imu @ (force + accelerometer_bias))


def differences(
    keep: Callable[[InertialReading], bool] = lambda reading: True, delay_s: float = 0.0
) -> list[ImuDifference]:
    comparison = ImuComparison(FIRST, SECOND)
    readings = [sample(ImuSample, k / 100.0, FIRST) for k in range(201)]
    readings += [sample(CameraImuSample, 0.0013 + k / 200.0, SECOND, delay_s) for k in range(400)]
    found = []
    for reading in sorted(readings, key=lambda one: one.stamp_ns):
        if keep(reading):
            comparison.push(reading, is_second=isinstance(reading, CameraImuSample))
        difference = comparison.next()
        found += [] if difference is None else [difference]
    return found


def test_biases_are_what_is_left_of_two_imus_at_two_places() -> None:
    """The body turns at up to 0.5 rad/s with 5 rad/s^2: samples alone would differ by 0.02 rad/s and 1 m/s^2."""
    found = differences()
    assert len(found) == 19
    for difference in found:
        np.testing.assert_allclose(difference.angular_velocity, BIASES[0], atol=1.5e-3)
        np.testing.assert_allclose(difference.specific_force, BIASES[1], atol=0.02)
    mean = np.mean([difference.specific_force for difference in found], axis=0)
    np.testing.assert_allclose(mean, BIASES[1], atol=4e-3)


def test_a_delay_shows_as_a_part_of_the_angular_acceleration() -> None:
    delay_s = 0.004
    without, late = differences(), differences(delay_s=delay_s)
    for one, other in zip(without, late, strict=True):
        change = other.angular_velocity - one.angular_velocity
        np.testing.assert_allclose(change, -delay_s * one.angular_acceleration, atol=1.5e-3)
    assert max(np.abs(one.angular_acceleration).max() for one in without) > 2.0, "more than 8e-3 rad/s of it"


@pytest.mark.parametrize("kind", [ImuSample, CameraImuSample])
def test_a_pause_of_either_gives_no_difference_and_the_next_ones_are_right(kind: type[InertialReading]) -> None:
    def keep(reading: InertialReading) -> bool:
        return not (isinstance(reading, kind) and 0.5 < (reading.stamp_ns - START_NS) / 1e9 < 0.9)

    found = differences(keep)
    assert 13 <= len(found) <= 15
    for difference in found:
        np.testing.assert_allclose(difference.angular_velocity, BIASES[0], atol=1.5e-3)


def test_one_imu_alone_gives_nothing() -> None:
    assert differences(lambda reading: isinstance(reading, ImuSample)) == []

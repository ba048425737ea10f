# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coclo_vio.robot.standstill import StandstillConfig, StandstillDetector
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.measurements import ImuSample, JointSample
from coclo_vio.values.units import NS_PER_S

MS = 1_000_000
BIAS = np.array([0.01, -0.02, 0.005])
UP = np.array([0.3, -0.2, 9.8])


def joints(stamp_ns: int, velocity: np.ndarray) -> JointSample:
    return JointSample(stamp_ns, np.zeros_like(velocity), velocity, np.full_like(velocity, np.nan))


def watch(seconds: float, *, rate=BIAS, force=UP, joint=0.0, noise=1.0, seed=31) -> StandstillDetector:
    """A detector after IMU and three joints at 200 Hz; sensor noise 5 mrad/s, 0.05 m/s^2, 10 mrad/s a joint."""
    detector, rng = StandstillDetector(StandstillConfig().limits), np.random.default_rng(seed)
    for stamp_ns in range(0, int(seconds * NS_PER_S) + 1, 5 * MS):
        gyroscope = rate + noise * rng.normal(0.0, 0.005, 3)
        detector.push(ImuSample(stamp_ns, gyroscope, force + noise * rng.normal(0.0, 0.05, 3)))
        detector.push(joints(stamp_ns, joint + noise * rng.normal(0.0, 0.01, 3)))
    return detector


def test_rest_holds_bias_and_up() -> None:
    rest = watch(1.0).rest
    assert rest is not None
    assert rest.stamp_ns == 1_000_000_000
    assert rest.sample_count == 101
    np.testing.assert_allclose(rest.angular_velocity, BIAS, atol=4 * 0.005 / np.sqrt(101))
    np.testing.assert_allclose(rest.specific_force, UP, atol=4 * 0.05 / np.sqrt(101))


def test_there_is_no_standstill_before_the_window_is_spanned() -> None:
    assert not StandstillDetector(StandstillConfig().limits).is_stationary
    assert watch(0.3).rest is None
    assert watch(0.5).is_stationary


@pytest.mark.parametrize(
    "motion",
    [
        {"rate": np.array([0.0, 0.0, 0.06])},  # a slow steady turn, more than a bias can be
        {"rate": np.array([0.04, 0.03, 0.01])},  # the same over three axes
        {"joint": 0.15},
        {"joint": np.array([0.0, 0.0, -0.15])},
        {"noise": 15.0},
    ],
)
def test_motion_is_not_rest(motion) -> None:
    assert not watch(2.0, **motion).is_stationary


def test_shaking_within_each_axis_counts_together() -> None:
    detector = StandstillDetector(StandstillConfig().limits)
    for index, stamp_ns in enumerate(range(0, 1_000_000_000, 5 * MS)):
        shake = 0.3 if index % 2 else -0.3
        detector.push(ImuSample(stamp_ns, BIAS, UP + shake))  # std 0.3 an axis, 0.52 in all
    assert not detector.is_stationary


def test_rest_ends_within_30_ms_of_the_first_motion() -> None:
    detector = watch(1.0)
    assert detector.is_stationary
    for stamp_ns in range(1_005 * MS, 1_035 * MS, 5 * MS):
        detector.push(ImuSample(stamp_ns, BIAS, UP))
        detector.push(joints(stamp_ns, np.array([0.0, 0.5, 0.0])))
    assert not detector.is_stationary


def test_an_imu_alone_is_enough_and_unknown_joints_do_not_count() -> None:
    detector = StandstillDetector(StandstillConfig().limits)
    for stamp_ns in range(0, 600 * MS, 5 * MS):
        detector.push(ImuSample(stamp_ns, BIAS, UP))
    assert detector.is_stationary
    for stamp_ns in range(0, 600 * MS, 5 * MS):
        detector.push(joints(stamp_ns, np.array([np.nan, 0.5])))
    assert not detector.is_stationary
    for stamp_ns in range(600 * MS, 1_200 * MS, 5 * MS):  # no joint samples any more: the last ones leave the window
        detector.push(ImuSample(stamp_ns, BIAS, UP))
    assert detector.is_stationary


def test_joints_alone_are_not_enough() -> None:
    detector = StandstillDetector(StandstillConfig().limits)
    for stamp_ns in range(0, 600 * MS, 5 * MS):
        detector.push(joints(stamp_ns, np.zeros(3)))
    assert not detector.is_stationary


def test_a_gap_starts_the_window_anew() -> None:
    detector = watch(1.0)
    detector.push(ImuSample(3_000 * MS, BIAS, UP))
    assert not detector.is_stationary


def test_stamps_that_repeat_or_go_back_are_left_out_and_counted() -> None:
    detector = watch(1.0)
    before = detector.rest
    detector.push(ImuSample(1_000 * MS, BIAS + 1.0, UP))
    detector.push(ImuSample(900 * MS, BIAS + 1.0, UP))
    detector.push(joints(1_000 * MS, np.full(3, 9.0)))
    assert detector.counts["standstill_stamp_refused"] == 3
    assert before is not None
    assert detector.rest is not None
    np.testing.assert_array_equal(detector.rest.angular_velocity, before.angular_velocity)


@settings(derandomize=True, max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), shock=st.sampled_from([0.0, 1e3, 1e6]))
def test_the_running_means_are_those_of_the_window(seed, shock) -> None:
    """Against NumPy over the last window, with uneven stamps and after a shock that would drown naive sums."""
    rng = np.random.default_rng(seed)
    detector = StandstillDetector(StandstillConfig().limits)
    stamps = np.cumsum(rng.integers(MS, 10 * MS, 1500))
    readings = np.hstack((rng.normal(0.0, 0.005, (1500, 3)), UP + rng.normal(0.0, 0.05, (1500, 3))))
    readings[700] += shock
    for stamp_ns, reading in zip(stamps, readings, strict=True):
        detector.push(ImuSample(int(stamp_ns), reading[:3], reading[3:]))
    inside = readings[stamps >= stamps[-1] - 500 * MS]
    rest = detector.rest
    assert rest is not None
    assert rest.sample_count == len(inside)
    np.testing.assert_allclose(rest.angular_velocity, inside[:, :3].mean(axis=0), atol=1e-9)
    np.testing.assert_allclose(rest.specific_force, inside[:, 3:].mean(axis=0), atol=1e-9)


def test_the_go1_stands_for_two_seconds_then_trots(shared_data) -> None:
    table = np.loadtxt(shared_data / "go1_mocap" / "go1.csv", delimiter=",", skiprows=1, max_rows=4000)
    stamps = np.round((table[:, 0] - table[0, 0]) * NS_PER_S).astype(np.int64)
    detector, stationary = StandstillDetector(StandstillConfig().limits), []
    for row in range(4, len(table)):
        step_s = (stamps[row] - stamps[row - 4]) / NS_PER_S
        velocity = (table[row, 11:] - table[row - 4, 11:]) / step_s
        detector.push(ImuSample(int(stamps[row]), table[row, 8:11], table[row, 5:8]))
        detector.push(joints(int(stamps[row]), velocity))
        stationary.append(detector.is_stationary)
        if stamps[row] < 2_300 * MS and detector.rest is not None:
            last_rest = detector.rest
    times_s = stamps[4:] / NS_PER_S
    stationary_s = times_s[np.array(stationary)]
    assert 0.5 < stationary_s[0] < 1.5  # it settles first
    assert 2.2 < stationary_s[-1] < 2.5
    assert np.array(stationary)[(times_s > 1.5) & (times_s < 2.2)].all()
    assert np.linalg.norm(last_rest.angular_velocity) < 0.005
    assert np.linalg.norm(last_rest.specific_force) == pytest.approx(9.81, abs=0.15)


def test_a_wrong_window_is_refused() -> None:
    with pytest.raises(ConfigError, match="window_s = 0"):
        StandstillConfig.parse({"window_s": 0}, "standstill")

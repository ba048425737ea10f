# SPDX-License-Identifier: BSD-3-Clause
"""Sensors against their configuration: gains, densities, bias walks, ranges, steps."""

from dataclasses import replace

import numpy as np
import pytest
from motions import JOINTS, LEGS, motion, times

from coclo_vio.geometry import se3
from coclo_vio.simulation.trial.imperfection import IDEAL, draw_imperfection
from coclo_vio.simulation.trial.sensors import (
    EPOCH_NS,
    ImuConfig,
    JointSensorConfig,
    imu_readings,
    interpolated_at,
    joint_samples,
    nominal_calibration,
    sample_times,
)
from coclo_vio.values.measurements import ImuSample

UP = np.array([0.0, 0.0, 9.81])
SILENT = {
    **dict.fromkeys(("gyroscope_noise_density", "gyroscope_bias", "gyroscope_bias_walk", "gyroscope_step_radps"), 0.0),
    **dict.fromkeys(("accelerometer_noise_density", "accelerometer_bias", "accelerometer_bias_walk"), 0.0),
    "accelerometer_step_mps2": 0.0,
}
QUIET_JOINTS = JointSensorConfig(
    position_noise_rad=0.0, velocity_noise_radps=0.0, effort_noise_nm=0.0, effort_offset_nm=0.0
)
AS_DESCRIBED = draw_imperfection(IDEAL, LEGS, JOINTS, np.random.default_rng(0))


def read(moved, config: ImuConfig, seed: int = 1):
    """Rates (N, 3), specific forces (N, 3) and the true biases of the readings of a motion."""
    samples, truth = imu_readings(ImuSample, moved, np.eye(4), config, np.random.default_rng(seed))
    rates = np.array([sample.angular_velocity for sample in samples])
    return rates, np.array([sample.specific_force for sample in samples]), truth


def test_an_accelerometer_at_rest_reads_up() -> None:
    rates, forces, truth = read(motion(2.0, specific_force=UP), ImuConfig(**SILENT))
    assert len(rates) == len(truth.stamps_ns) == 201
    np.testing.assert_allclose(forces, np.tile(UP, (201, 1)), atol=1e-12)
    np.testing.assert_array_equal(rates, 0.0)


@pytest.mark.parametrize("frequency_hz", [10.0, 62.5, 180.0])
def test_the_low_pass_has_the_gain_of_a_butterworth_of_second_order(frequency_hz) -> None:
    """|H|^2 = 1 / (1 + (f / fc)^4), with both frequencies warped by the bilinear transform at 1 kHz."""
    wave = np.sin(2.0 * np.pi * frequency_hz * times(4.0))[:, None]
    config = ImuConfig(**SILENT, rate_hz=1000.0, low_pass_hz=62.5)
    rates, _, _ = read(motion(4.0, rate=wave), config)
    warped = np.tan(np.pi * frequency_hz / 1000.0) / np.tan(np.pi * 62.5 / 1000.0)
    expected = 1.0 / np.sqrt(1.0 + warped**4)
    assert np.sqrt(2.0 * np.mean(rates[1000:] ** 2)) == pytest.approx(expected, rel=1e-3)


def test_a_shock_between_two_samples_is_measured() -> None:
    """3 ms of 30 m/s^2 right between samples 10 ms apart: sampling without the low-pass would miss it."""
    shock = np.zeros((len(times(1.0)), 3))
    shock[503:506, 2] = 30.0
    _, forces, _ = read(motion(1.0, specific_force=shock), ImuConfig(**SILENT))
    assert 3.0 < forces[:, 2].max() < 15.0


def test_noise_is_white_with_its_density() -> None:
    """Standard deviation of a sample is density * sqrt(rate); consecutive samples are independent."""
    config = ImuConfig(**{**SILENT, "gyroscope_noise_density": 3e-4, "accelerometer_noise_density": 2e-3}, rate_hz=200)
    rates, forces, _ = read(motion(60.0), config)
    for noise, density in ((rates, 3e-4), (forces, 2e-3)):
        assert noise.std() == pytest.approx(density * np.sqrt(200.0), rel=0.02)
        assert abs(np.mean(noise[1:] * noise[:-1])) < 0.02 * noise.var()


def test_biases_start_and_walk_as_configured() -> None:
    """Increments over a time T have the standard deviation walk * sqrt(T); the readings carry the true bias."""
    config = ImuConfig(**{**SILENT, "gyroscope_bias_walk": 1e-3, "accelerometer_bias_walk": 1e-2})
    rates, forces, truth = read(motion(100.0), config)
    np.testing.assert_allclose(rates, truth.gyroscope_bias, atol=1e-12)
    np.testing.assert_allclose(forces, truth.accelerometer_bias, atol=1e-12)
    for bias, walk in ((truth.gyroscope_bias, 1e-3), (truth.accelerometer_bias, 1e-2)):
        assert np.diff(bias, axis=0).std() == pytest.approx(walk * np.sqrt(0.01), rel=0.03)
        over_a_second = bias[100:] - bias[:-100]
        assert over_a_second.std() == pytest.approx(walk, rel=0.25)
    starts = ImuConfig(**{**SILENT, "gyroscope_bias": 0.01, "accelerometer_bias": 0.05})
    firsts = [read(motion(0.1), starts, seed)[2] for seed in range(100)]
    assert np.std([truth.gyroscope_bias[0] for truth in firsts]) == pytest.approx(0.01, rel=0.1)
    assert np.std([truth.accelerometer_bias[0] for truth in firsts]) == pytest.approx(0.05, rel=0.1)


def test_an_accelerometer_saturates_at_its_range() -> None:
    config = ImuConfig(**SILENT, accelerometer_range_mps2=39.2)
    _, forces, _ = read(motion(0.2, specific_force=np.array([-100.0, 30.0, 100.0])), config)
    np.testing.assert_allclose(forces, np.tile([-39.2, 30.0, 39.2], (21, 1)), atol=1e-9)


def test_scaled_shocks_leave_slow_motion_as_it_is_and_end_where_they_began() -> None:
    """What is added is the acceleration of a mass on a damped spring: its velocity and displacement return to zero."""
    time_s = times(4.0)
    slow = 2.0 * np.sin(2.0 * np.pi * 0.5 * time_s)
    shock = np.zeros_like(time_s)
    shock[2000:2005] = 30.0

    def measured(force: np.ndarray, scale: float) -> np.ndarray:
        moved = motion(4.0, specific_force=UP + force[:, None] * [0.0, 0.0, 1.0])
        config = ImuConfig(**SILENT, rate_hz=1000.0, accelerometer_range_mps2=1e3, shock_scale=scale)
        return read(moved, config)[1]

    np.testing.assert_allclose(
        measured(slow, 10.0), measured(slow, 1.0), atol=0.25
    )  # |H(0.5 Hz)| = (0.5 / 20)^2, nine times 2
    plain, shaken = measured(shock, 1.0), measured(shock, 10.0)
    np.testing.assert_allclose(shaken[:2000], plain[:2000], atol=1e-11)
    added = (shaken - plain)[:, 2]
    assert added.max() > 5.0 * (plain[:, 2] - 9.81).max()
    np.testing.assert_array_equal((shaken - plain)[:, :2], 0.0)
    velocity = np.cumsum(added) * 1e-3
    assert velocity.max() > 0.5
    assert abs(velocity[-1]) < 1e-4
    assert abs(np.sum(velocity) * 1e-3) < 1e-4


def test_a_shock_scale_of_one_changes_no_byte() -> None:
    force = np.random.default_rng(3).standard_normal((len(times(1.0)), 3))
    plain = read(motion(1.0, specific_force=force), ImuConfig())
    once, thrice = (read(motion(1.0, specific_force=force), ImuConfig(shock_scale=scale)) for scale in (1.0, 3.0))
    for rates_or_forces in (0, 1):
        np.testing.assert_array_equal(once[rates_or_forces], plain[rates_or_forces])
    np.testing.assert_array_equal(thrice[0], plain[0])
    assert np.abs(thrice[1] - plain[1]).max() > 0.5


def test_readings_are_steps_of_the_resolution() -> None:
    ramp = np.linspace(0.0, 1.0, 1001)[:, None]
    steps = {"gyroscope_step_radps": 0.002, "accelerometer_step_mps2": 0.05}
    rates, forces, _ = read(motion(1.0, rate=ramp, specific_force=ramp), ImuConfig(**{**SILENT, **steps}))
    for readings, step in ((rates, 0.002), (forces, 0.05)):
        np.testing.assert_allclose(readings / step, np.round(readings / step), atol=1e-9)
        assert len(np.unique(np.round(readings / step))) > 15


def test_stamps_are_those_of_the_rate_from_the_epoch_on() -> None:
    stamps, offsets = sample_times(1.0, 15.0)
    assert len(stamps) == 16
    np.testing.assert_array_equal(stamps - EPOCH_NS, offsets)
    np.testing.assert_array_equal(offsets, np.round(np.arange(16) / 15.0 * 1e9))


def test_values_between_steps_are_interpolated() -> None:
    time_s = times(0.01)
    line = np.stack((3.0 * time_s, 1.0 - time_s), axis=1)
    offsets = np.array([0, 300_000, 4_500_000, 10_000_000])
    np.testing.assert_allclose(interpolated_at(time_s, line, offsets)[:, 0], 3.0 * offsets / 1e9, atol=1e-12)
    poses = np.tile(np.eye(4), (len(time_s), 1, 1))
    np.testing.assert_array_equal(interpolated_at(time_s, poses, offsets), poses[:4])


def test_an_encoder_reads_its_zero_and_joints_their_rates_and_torques() -> None:
    zeros = np.random.default_rng(3).normal(0.0, 0.01, JOINTS)
    moved = motion(0.5, angle=0.4, velocity=-1.0, torque=7.0)
    samples = list(
        joint_samples(moved, QUIET_JOINTS, replace(AS_DESCRIBED, joint_zero_rad=zeros), np.random.default_rng(0))
    )
    assert len(samples) == 51
    for sample in samples:
        np.testing.assert_allclose(sample.position, 0.4 + zeros, atol=1e-12)
        np.testing.assert_allclose(sample.velocity, -1.0, atol=1e-12)
        np.testing.assert_allclose(sample.effort, 7.0, atol=1e-12)


def test_joint_velocity_and_torque_lag_by_first_order() -> None:
    """At the cutoff a one-pole filter with pole a = exp(-2 pi fc T) has |H| = (1 - a) / |1 - a exp(-j 2 pi fc T)|."""
    wave = np.sin(2.0 * np.pi * 20.0 * times(5.0))[:, None]
    config = QUIET_JOINTS.model_copy(
        update={"rate_hz": 1000.0, "velocity_low_pass_hz": 20.0, "effort_low_pass_hz": 80.0}
    )
    moved = motion(5.0, velocity=wave, torque=wave)
    samples = list(joint_samples(moved, config, AS_DESCRIBED, np.random.default_rng(0)))[500:]
    for name, cutoff_hz in (("velocity", 20.0), ("effort", 80.0)):
        pole = np.exp(-2.0 * np.pi * cutoff_hz * 0.001)
        gain = (1.0 - pole) / abs(1.0 - pole * np.exp(-2j * np.pi * 20.0 * 0.001))
        size = np.sqrt(2.0 * np.mean([getattr(sample, name)[0] ** 2 for sample in samples]))
        assert size == pytest.approx(gain, rel=1e-3)


def test_joint_noise_is_as_configured_and_the_torque_offset_stays() -> None:
    config = JointSensorConfig()
    samples = list(joint_samples(motion(30.0), config, AS_DESCRIBED, np.random.default_rng(5)))
    position, velocity, effort = (
        np.array([getattr(sample, name) for sample in samples]) for name in ("position", "velocity", "effort")
    )
    assert position.std() == pytest.approx(config.position_noise_rad, rel=0.03)
    assert velocity.std() == pytest.approx(config.velocity_noise_radps, rel=0.03)
    offsets = effort.mean(axis=0)
    assert (effort - offsets).std() == pytest.approx(config.effort_noise_nm, rel=0.03)
    assert offsets.std() == pytest.approx(config.effort_offset_nm, rel=0.4)


def test_the_nominal_calibration_of_an_imu_is_its_mounting_and_its_data_sheet() -> None:
    config = ImuConfig(rate_hz=200.0)
    T_body_imu = se3.exp(np.array([0.3, -0.7, 1.9, 0.1, -0.2, 0.05]))
    known = nominal_calibration(config, T_body_imu)
    np.testing.assert_allclose(known.T_body_imu, T_body_imu, atol=1e-12)
    assert known.gyroscope_noise_density == config.gyroscope_noise_density
    assert known.accelerometer_bias_walk == config.accelerometer_bias_walk

# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.joint_velocity import JointVelocityConfig, JointVelocityEstimator
from coclo_vio.robot.description import load_robot
from coclo_vio.values.measurements import JointSample


def velocities(stamps_ns, angles, **settings):
    estimator = JointVelocityEstimator(JointVelocityConfig(**settings))
    return np.stack([estimator.push(int(t), np.atleast_1d(q)) for t, q in zip(stamps_ns, angles, strict=True)])


def irregular_stamps(count, seed=2):
    return 10**18 + np.cumsum(np.random.default_rng(seed).integers(1_000_000, 4_000_000, size=count))


@pytest.mark.parametrize("degree", [1, 2])
def test_constant_velocity_is_exact_at_irregular_stamps(degree):
    stamps_ns = irregular_stamps(50)
    t = (stamps_ns - stamps_ns[0]) * 1e-9
    found = velocities(stamps_ns, np.outer(t, [3.0, -0.5]) + 1.0, degree=degree, window_s=0.02)
    assert np.isnan(found[:degree]).all()
    np.testing.assert_allclose(found[degree:], np.broadcast_to([3.0, -0.5], (50 - degree, 2)), atol=1e-9)


def test_a_line_lags_by_half_its_window_and_a_parabola_not_at_all():
    t = np.arange(40) * 0.0025
    angles = 0.5 * 8.0 * t**2
    line = velocities(np.round(t * 1e9), angles, degree=1, window_s=0.0105)[-1, 0]
    parabola = velocities(np.round(t * 1e9), angles, degree=2, window_s=0.0105)[-1, 0]
    assert line == pytest.approx(8.0 * (t[-1] - 0.005), abs=1e-9)
    assert parabola == pytest.approx(8.0 * t[-1], abs=1e-9)


def test_the_estimate_is_causal():
    stamps_ns = irregular_stamps(60)
    angles = np.random.default_rng(4).normal(size=(60, 3))
    changed = angles.copy()
    changed[30:] += 1.0
    np.testing.assert_array_equal(velocities(stamps_ns, angles)[:30], velocities(stamps_ns, changed)[:30])


def test_noise_falls_with_the_window_as_documented():
    rng = np.random.default_rng(8)
    angles = rng.normal(scale=1e-3, size=(4000, 4))
    stamps_ns = np.arange(4000) * 2_500_000
    for samples, noise in ((3, 0.28), (5, 0.13), (9, 0.05)):
        found = velocities(stamps_ns, angles, window_s=(samples - 1) * 0.0025 + 0.001)[10:]
        assert found.std() == pytest.approx(noise, abs=0.01)


def test_a_joint_without_angle_has_no_velocity_and_does_not_affect_the_others():
    stamps_ns = np.arange(20) * 2_500_000
    angles = np.outer(np.arange(20) * 0.0025, [2.0, -1.0])
    angles[10, 0] = np.nan
    found = velocities(stamps_ns, angles)
    assert np.isnan(found[10, 0])
    np.testing.assert_allclose(found[11:, 0], 2.0, atol=1e-9)
    np.testing.assert_allclose(found[1:, 1], -1.0, atol=1e-9)


def test_a_gap_starts_the_estimate_anew():
    stamps_ns = np.concatenate((np.arange(10), np.arange(10) + 200)) * 2_500_000
    angles = np.concatenate((np.zeros(10), np.full(10, 1.0)))
    found = velocities(stamps_ns, angles)[:, 0]
    assert np.isnan(found[10])
    np.testing.assert_allclose(found[11:], 0.0, atol=1e-12)


def test_a_slow_log_uses_the_newest_two_angles_however_far_apart():
    t = np.arange(10) * 0.02
    np.testing.assert_allclose(velocities(np.round(t * 1e9), 4.0 * t, window_s=0.006)[1:, 0], 4.0, atol=1e-9)


def test_repeated_and_late_stamps_have_no_velocity_and_do_not_affect_later_ones():
    stamps_ns = np.array([0, 1, 2, 2, 1, 3, 4]) * 2_500_000
    angles = np.array([0.0, 1.0, 2.0, 9.0, -9.0, 3.0, 4.0])
    found = velocities(stamps_ns, angles)[:, 0]
    assert np.isnan(found[[3, 4]]).all()
    np.testing.assert_allclose(found[[1, 2, 5, 6]], 400.0, rtol=1e-9)


def test_a_clock_that_jumps_back_does_not_stop_the_estimate():
    stamps_ns = np.concatenate((np.arange(5) * 2_500_000 + 10**12, np.arange(5) * 2_500_000))
    found = velocities(stamps_ns, np.tile(np.arange(5) * 0.0025, 2))[:, 0]
    np.testing.assert_allclose(found[6:], 1.0, atol=1e-9)


def test_the_default_is_the_line_that_predicts_the_go1s_next_angles_best(shared_data):
    """The choice rests on the robot's own angles: ground truth is not read here."""
    dataset = open_dataset(shared_data / "go1_mocap", load_robot("go1"))
    joints = [sample for sample in dataset.measurements() if isinstance(sample, JointSample)][2000:4000]
    stamps_ns = np.array([sample.stamp_ns for sample in joints])
    angles = np.stack([sample.position for sample in joints])
    steps_s = np.diff(stamps_ns)[:, None] * 1e-9

    def next_error(**settings):
        found = velocities(stamps_ns, angles, **settings)
        return np.sqrt(np.nanmean((angles[1:] - angles[:-1] - found[:-1] * steps_s) ** 2))

    default = next_error()
    for window_s in (0.0035, 0.0085, 0.0135, 0.021):
        assert default < 0.95 * next_error(window_s=window_s)
    assert default < next_error(window_s=0.0135, degree=2)

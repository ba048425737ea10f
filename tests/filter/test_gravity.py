# SPDX-License-Identifier: BSD-3-Clause
"""Windows of gravity: what a swaying body accelerates is taken out exactly, no sample counts twice, tilt stays."""

import numpy as np
import pytest

from coclo_vio.filter.config import FilterConfig, InitialConfig, RobustConfig
from coclo_vio.filter.gravity import GravityReading, GravityScale, GravityWindow
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.geometry import so3
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial, AnalyticTrialConfig, SensorNoiseConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.measurements import ImuSample

TICK_NS = 10_000_000
GRAVITY = np.array([0.0, 0.0, 9.81])


def swaying(tick: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean specific force since the last tick and velocity now, of a body that sways by 1 m/s^2 at 1.5 Hz, world."""
    pulse, directions = 2.0 * np.pi * 1.5, np.array([[1.0, 0.3, 0.0], [0.0, -0.5, 0.8]])
    velocity_then, velocity = (
        np.array([np.sin(pulse * time_s), np.cos(pulse * time_s)]) @ directions / pulse
        for time_s in ((tick - 1) * 1e-2, tick * 1e-2)
    )
    return GRAVITY + (velocity - velocity_then) / 1e-2, velocity


def readings(window: GravityWindow, ticks: range) -> dict[int, GravityReading]:
    """The readings of the window, by the tick at which they come."""
    results = {tick: window.add(tick * TICK_NS, *swaying(tick)) for tick in ticks}
    return {tick: reading for tick, reading in results.items() if reading is not None}


def test_a_swaying_body_of_known_velocity_shows_gravity_exactly() -> None:
    raw = np.array([swaying(tick)[0] - GRAVITY for tick in range(10)])
    assert np.abs(raw.mean(axis=0)).max() > 0.3, "the mean force alone is off by degrees"
    found = readings(GravityWindow(dwell_s=0.03, length_s=0.1), range(100))
    assert len(found) == 9
    for reading in found.values():
        np.testing.assert_allclose(reading.force_world, GRAVITY, atol=1e-12)
        assert reading.duration_s == pytest.approx(0.1)


def test_windows_follow_one_another_and_share_no_sample() -> None:
    """After the dwell, one reading each 0.1 s; a single outlier is in one of them only."""
    window = GravityWindow(dwell_s=0.03, length_s=0.1)
    ticks = sorted(readings(window, range(100)))
    assert ticks == list(range(13, 100, 10))
    disturbed = GravityWindow(dwell_s=0.03, length_s=0.1)
    found = {}
    for tick in range(100):
        force, velocity = swaying(tick)
        reading = disturbed.add(tick * TICK_NS, force + (tick == 33) * np.array([5.0, 0.0, 0.0]), velocity)
        if reading is not None:
            found[tick] = reading.force_world[0]
    assert [tick for tick, force in found.items() if abs(force) > 1e-9] == [33]
    assert found[33] == pytest.approx(0.5)


@pytest.mark.parametrize(("last", "counts"), [(2, False), (4, False), (7, False), (8, True), (12, True)])
def test_a_window_that_a_lifting_foot_cuts_counts_from_half_its_length(last: int, counts: bool) -> None:
    window = GravityWindow(dwell_s=0.03, length_s=0.1)
    assert not readings(window, range(last + 1))
    reading = window.close()
    assert (reading is not None) == counts
    if reading is not None:
        assert reading.duration_s == pytest.approx((last - 3) * 1e-2)
        np.testing.assert_allclose(reading.force_world, GRAVITY, atol=1e-12)
    assert window.close() is None, "the reading is returned once"


def test_a_closed_window_dwells_again_and_forgets_the_samples_before() -> None:
    """The time between closing and the next sample, however long, is in no window."""
    window = GravityWindow(dwell_s=0.03, length_s=0.1)
    readings(window, range(8))
    window.close()
    found = readings(window, range(500, 520))
    assert list(found) == [513]
    np.testing.assert_allclose(found[513].force_world, GRAVITY, atol=1e-12)


def test_an_accelerometer_slower_than_the_joints_is_as_exact() -> None:
    """Five samples a window instead of ten, each the mean force of its own time."""
    window, found = GravityWindow(dwell_s=0.03, length_s=0.1), []
    for tick in range(0, 100, 2):
        force = 0.5 * (swaying(tick - 1)[0] + swaying(tick)[0])
        reading = window.add(tick * TICK_NS, force, swaying(tick)[1])
        found += [] if reading is None else [reading.force_world]
    assert len(found) == 9
    np.testing.assert_allclose(found, np.tile(GRAVITY, (9, 1)), atol=1e-12)


def test_a_gap_of_the_accelerometer_starts_the_dwell_anew() -> None:
    window = GravityWindow(dwell_s=0.03, length_s=0.1)
    readings(window, range(8))
    assert list(readings(window, range(20, 40))) == [33], "0.12 s later it dwells anew"


def swaying_walk(robot: RobotModel, seed: int, rest_s: float) -> AnalyticTrial:
    """A walk whose body rolls and pitches by 3 degrees; the accelerometer has noise and no bias."""
    body = BodyMotionConfig(rest_s=rest_s, walk_s=8.0, stop_s=0.0, sway_roll_rad=0.06, sway_pitch_rad=0.05)
    sensors = SensorNoiseConfig(accelerometer_bias_mps2=0.0)
    return generate(AnalyticTrialConfig(body=body, sensors=sensors), robot, seed)


def tilt_errors_deg(trial: AnalyticTrial, robot: RobotModel, config: FilterConfig, lean_rad: float) -> np.ndarray:
    """Angle between the estimated upward direction and the true one, (N,).

    Until the filter starts the accelerometer leans: it starts with a wrong roll.
    """
    odometry, errors = LegOdometryFilter(robot, config), []
    row_of = {int(stamp_ns): row for row, stamp_ns in enumerate(trial.truth.stamps_ns)}
    turn = so3.exp(np.array([lean_rad, 0.0, 0.0]))
    for sample in trial.measurements:
        if isinstance(sample, ImuSample) and not errors:
            odometry.push(ImuSample(sample.stamp_ns, sample.angular_velocity, turn @ sample.specific_force))
            continue
        estimate = odometry.push(sample)
        if estimate is not None:
            true_up = trial.truth.T_world_body[row_of[estimate.stamp_ns], 2, :3]
            errors.append(np.degrees(np.linalg.norm(np.cross(estimate.nav.T_world_body[2, :3], true_up))))
    return np.array(errors)


@pytest.mark.long
def test_tilt_stays_on_a_swaying_walk(daisy: RobotModel) -> None:
    """The specific force itself points 2 degrees beside up while the body gathers speed and sways."""
    trial = swaying_walk(daisy, seed=1, rest_s=1.0)
    walking = slice(110, 200)
    force = np.einsum("nij,nj->ni", trial.body.rotation, trial.body.specific_force_at(np.zeros(3)))[walking]
    assert np.degrees(np.arctan2(force[:, 0], force[:, 2])).max() > 1.5
    assert tilt_errors_deg(trial, daisy, FilterConfig(), lean_rad=0.0).max() < 0.2


@pytest.mark.long
def test_tilt_that_starts_wrong_converges_while_the_body_sways(daisy: RobotModel) -> None:
    """From 1 degree, with as large a sigma, to a few tenths; legs and gyroscope alone do not correct it."""
    trial = swaying_walk(daisy, seed=1, rest_s=0.5)
    uncertain = InitialConfig(rest_force_noise_mps2=0.5, accelerometer_bias_mps2=0.01)
    with_gravity, without = (
        tilt_errors_deg(trial, daisy, FilterConfig(robust=robust, initial=uncertain), lean_rad=np.radians(1.0))
        for robust in (RobustConfig(), RobustConfig(gravity_noise_mps2=1e6))
    )
    assert with_gravity[0] > 0.95
    assert with_gravity[-100:].max() < 0.3
    assert without[-100:].min() > 0.45


def test_the_noise_of_windows_follows_their_innovations_between_its_limits() -> None:
    generator = np.random.default_rng(7)
    for sigma, expected in ((0.1, 0.35), (0.6, 0.6), (2.0, 2.0), (9.0, 4.0)):
        scale = GravityScale(0.35)
        for _ in range(200):
            scale.learn(float(np.mean(np.square(sigma * generator.standard_normal(3)))))
        assert scale.scale == pytest.approx(expected, rel=0.2)


def test_one_shock_does_not_decide_the_noise_of_windows() -> None:
    scale = GravityScale(0.35)
    for _ in range(100):
        scale.learn(0.2)
    before = scale.scale
    scale.learn(1e4)
    assert before < scale.scale < 1.2 * before


def test_a_filter_learns_how_good_its_gravity_is(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    """With exact windows tilt becomes certain sooner than by the claimed noise."""
    sigmas = []
    for least in (1.0, 0.35):
        config = FilterConfig.of_robot(daisy.description, {"robust": {"gravity_least_scale": least}})
        odometry = LegOdometryFilter(daisy, config)
        last = [one for one in map(odometry.push, noisy_walk.measurements) if one is not None][-1]
        sigmas.append(float(np.sqrt(last.covariance[:2, :2].trace())))
    assert sigmas[1] < sigmas[0]

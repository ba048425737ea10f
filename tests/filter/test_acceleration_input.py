# SPDX-License-Identifier: BSD-3-Clause
"""The accelerometer drives the velocity as far as legs agree with it, and is left out where they do not."""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from coclo_vio.filter.acceleration_input import AccelerationInput
from coclo_vio.filter.config import FilterConfig, RobustConfig
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.filter.robust_profile import RobustProfile
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.stance import Reading
from coclo_vio.filter.state import POSITION, RATE, VELOCITY, State
from coclo_vio.geometry import so3
from coclo_vio.robot.leg_sensing import InertialStep
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial

CONFIG = RobustConfig()
DT_S = 0.01
LEVER = np.array([0.1, -0.05, 0.02])
PULSE = 2.0 * np.pi * 1.5


def core_of(robot: RobotModel, rotation: np.ndarray) -> SquareRootFilter:
    layout = RobustProfile(robot, CONFIG, Counter()).layout
    mean = State(layout, rotation, np.zeros(layout.dimension), ())
    return SquareRootFilter(mean, np.ones(layout.dimension), is_wide=False)


def motion(time_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Velocity, world, and angular velocity of a body that sways and turns about its own z axis."""
    sway = np.array([0.1, 0.05, 0.1]) * np.sin(PULSE * time_s + np.array([0.0, 0.5 * np.pi, 0.0]))
    return sway + np.array([0.6, 0.0, 0.0]), np.array([0.0, 0.0, 0.5 * np.sin(PULSE * time_s)])


def drive(
    robot: RobotModel,
    still: Reading,
    *,
    wrong: np.ndarray | None = None,
    imu_every: int = 1,
    seconds: float = 3.0,
) -> tuple[AccelerationInput, SquareRootFilter, list[bool], np.ndarray]:
    """Push the readings of such a body; legs measure its velocity after each step.

    Args:
        robot: the legs.
        still: a reading, whose IMU is replaced.
        wrong: matrix on the specific force, (3, 3).
        imu_every: of so many joint samples one has readings of the IMU.
        seconds: how long.

    Returns:
        The input, the filter, where it was used, and the errors of the velocity before each correction, (n, 3).
    """
    rotation = so3.exp(np.array([0.1, -0.2, 0.7]))
    core = core_of(robot, rotation)
    acceleration = AccelerationInput(CONFIG, so3.hat(LEVER))
    used, errors = [], []
    core.mean.vector[VELOCITY] = motion(0.0)[0]
    for number in range(1, round(seconds / DT_S)):
        (before, rate_before), (after, rate) = motion((number - 1) * DT_S), motion(number * DT_S)
        at_imu = after - before + rotation @ (np.cross(rate, LEVER) - np.cross(rate_before, LEVER))
        force = rotation.T @ (at_imu / DT_S + [0.0, 0.0, 9.81])
        reading = replace(
            still, angular_velocity=rate, specific_force=force if wrong is None else wrong @ force, is_stationary=False
        )
        if number % imu_every:
            reading = replace(reading, angular_velocity=None, specific_force=None)
        acceleration.predict(core, reading, DT_S, is_gap=False)
        used.append(acceleration.is_used)
        errors.append(core.mean.vector[VELOCITY] - after)
        vector = core.mean.vector.copy()
        vector[POSITION] += vector[VELOCITY] * DT_S
        vector[VELOCITY] = after
        core.mean = replace(core.mean, vector=vector)
        acceleration.learn(core)
    return acceleration, core, used, np.array(errors)


def still_at(still: Reading, force: np.ndarray) -> Reading:
    return replace(still, angular_velocity=np.zeros(3), specific_force=force)


@pytest.fixture
def still(clean_walk: AnalyticTrial, readings_of: Callable[..., list[Reading]]) -> Reading:
    return readings_of(clean_walk.measurements[:50])[5]


def test_velocity_and_position_follow_the_accelerometer_without_any_leg(daisy: RobotModel, still: Reading) -> None:
    """After the first window, which legs must confirm, the input is exact: rotation, lever and gravity are right."""
    _, _, used, errors = drive(daisy, still)
    assert not any(used[:25])
    assert all(used[26:])
    assert np.abs(errors[27:]).max() < 1e-9
    assert np.abs(errors[1:25]).max() > 0.005, "without it a constant velocity is wrong at once"


def test_the_position_is_that_of_the_mean_velocity(daisy: RobotModel, still: Reading) -> None:
    core = core_of(daisy, np.eye(3))
    acceleration = AccelerationInput(CONFIG, np.zeros((3, 3)))
    acceleration._weight = 1.0  # a window has been confirmed
    reading = replace(still, angular_velocity=np.zeros(3), specific_force=np.array([2.0, 0.0, 9.81]))
    acceleration.predict(core, reading, 0.1, is_gap=False)
    vector = core.mean.vector
    assert vector[VELOCITY] == pytest.approx([0.2, 0.0, 0.0])
    assert vector[POSITION] + 0.1 * vector[VELOCITY] == pytest.approx([0.01, 0.0, 0.0]), "a t^2 / 2"
    assert not vector[RATE].any()


def test_an_imu_that_is_slower_than_the_joints_is_used_too(daisy: RobotModel, still: Reading) -> None:
    _, _, used, errors = drive(daisy, still, imu_every=2)
    assert all(used[30:])
    assert np.abs(errors[30:]).max() < 0.02, "a reading holds until the next one"
    _, _, used, _ = drive(daisy, still, imu_every=10)
    assert not all(used), "but not for long"


@pytest.mark.parametrize(
    "wrong",
    [-np.eye(3), np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), so3.exp(np.array([0.0, 0.8, 0.0]))],
    ids=["signs", "axes", "mounting"],
)
def test_an_accelerometer_that_contradicts_the_legs_is_not_used(
    daisy: RobotModel, still: Reading, wrong: np.ndarray
) -> None:
    acceleration, _, used, _ = drive(daisy, still, wrong=wrong)
    assert not any(used)
    assert acceleration.density == CONFIG.acceleration_density


def test_its_noise_follows_what_legs_contradict(daisy: RobotModel, still: Reading) -> None:
    """A tilt of 2 degrees is 0.34 m/s^2, and counts as that much over a window."""
    exact, *_ = drive(daisy, still)
    leaning, _, used, _ = drive(daisy, still, wrong=so3.exp(np.array([0.035, 0.0, 0.0])))
    assert exact.noise_density == CONFIG.acceleration_input_density
    assert leaning.noise_density is not None
    assert leaning.noise_density == pytest.approx(0.34 / np.sqrt(3.0) * 0.5, rel=0.1)
    assert used[-1]


def test_it_is_not_used_across_a_gap_and_without_readings(daisy: RobotModel, still: Reading) -> None:
    acceleration, core, used, _ = drive(daisy, still)
    assert used[-1]
    acceleration.predict(core, still, 0.5, is_gap=True)
    assert not acceleration.is_used
    acceleration.predict(core, replace(still, specific_force=None), 0.03, is_gap=False)
    assert not acceleration.is_used, "no reading, no input"


def test_alone_it_drives_the_velocity_and_its_noise_grows_with_the_time(daisy: RobotModel, still: Reading) -> None:
    """A push of 1 m/s^2 for half a second, without joints: tilt and bias are wrong by the same all that time."""
    acceleration, core, _, _ = drive(daisy, still)
    core.replace_active(0.01 * np.eye(len(core.active_factor)))
    force = core.mean.rotation.T @ np.array([1.0, 0.0, 9.81])
    acceleration.predict(core, still_at(still, force), DT_S, is_gap=False)
    velocity, densities = core.mean.vector[VELOCITY].copy(), []
    for number in range(50):
        acceleration.coast(core, InertialStep(number, np.zeros(3), force), DT_S)
        densities.append(acceleration.density)
    np.testing.assert_allclose(core.mean.vector[VELOCITY] - velocity, [0.5, 0.0, 0.0], atol=1e-9)
    constant = np.sqrt(9.81**2 + 1.0) * 0.01
    growth = np.square(densities) - CONFIG.acceleration_input_density**2
    np.testing.assert_allclose(growth, 2.0 * constant**2 * DT_S * np.arange(1, 51), rtol=1e-6)
    acceleration.coast(core, InertialStep(51, np.zeros(3), force), 0.5)
    assert not acceleration.is_used, "a single sample tells nothing of half a second"


def test_alone_it_is_not_used_where_it_contradicted_the_legs(daisy: RobotModel, still: Reading) -> None:
    acceleration, core, used, _ = drive(daisy, still, wrong=np.diag([1.0, -1.0, -1.0]))
    assert not used[-1]
    velocity = core.mean.vector[VELOCITY].copy()
    acceleration.coast(core, InertialStep(1, np.zeros(3), np.array([0.0, 0.0, -9.81])), DT_S)
    np.testing.assert_array_equal(core.mean.vector[VELOCITY], velocity)
    assert acceleration.density == CONFIG.acceleration_density


def test_a_walk_uses_it_and_can_be_without(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    for density, is_used in ((0.1, True), (0.9, False)):
        config = FilterConfig.of_robot(daisy.description, {"robust": {"acceleration_input_density": density}})
        odometry, last = LegOdometryFilter(daisy, config), None
        for measurement in noisy_walk.measurements:
            last = odometry.push(measurement) or last
        profile = odometry._profile
        assert isinstance(profile, RobustProfile)
        assert profile._acceleration.is_used is is_used
        assert last is not None
        true = noisy_walk.truth.T_world_body[-1][:3, 3] - noisy_walk.truth.T_world_body[0][:3, 3]
        assert np.linalg.norm(last.nav.T_world_body[:3, 3] - true) < 0.03


def test_feet_that_touch_down_settle_first(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    """A foot is not used as stance for so long after its load says that it stands."""
    config = FilterConfig.of_robot(daisy.description, {"robust": {"settling_s": 0.05}})
    odometry, stood_ns, checked = LegOdometryFilter(daisy, config), np.zeros(6, dtype=np.int64), 0
    for measurement in noisy_walk.measurements:
        estimate = odometry.push(measurement)
        if estimate is None or estimate.feet is None or odometry.reading is None:
            continue
        is_stance = odometry.reading.is_stance
        stood_ns = np.where(is_stance & (stood_ns == 0), estimate.stamp_ns, np.where(is_stance, stood_ns, 0))
        stands_ns = np.where(is_stance, estimate.stamp_ns - stood_ns, 0)
        profile = odometry._profile
        assert isinstance(profile, RobustProfile)
        if profile._acceleration.is_used:
            is_young = is_stance & (stands_ns > 0) & (stands_ns < 30_000_000)
            checked += int(is_young.sum())
            assert not (estimate.feet.is_stance & is_young).any()
    assert checked > 10

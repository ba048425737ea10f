# SPDX-License-Identifier: BSD-3-Clause
"""The camera's IMU in the filter beside the body's, on analytic walks."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from state_layouts import state_of

from coclo_vio.filter.camera_imu import CameraImu
from coclo_vio.filter.config import CameraImuConfig, FilterConfig
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.state import ACCELEROMETER_BIAS, GYROSCOPE_BIAS, GYROSCOPE_SCALE, StateLayout
from coclo_vio.filter.state_blocks import robust_blocks
from coclo_vio.geometry import so3
from coclo_vio.robot.imu_comparison import ImuDifference
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial, AnalyticTrialConfig, SensorNoiseConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import ImuCalibration
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.measurements import CameraImuSample, ImuSample, InertialReading, Measurement
from coclo_vio.values.outputs import Event
from coclo_vio.values.units import NS_PER_S

WALK = BodyMotionConfig(rest_s=0.8, walk_s=3.2, stop_s=0.0, ramp_s=0.6, speed_mps=0.18, curvature_per_m=0.4)
CAMERA_IMU = ImuCalibration(
    grade="calibrated_mems", position_body_m=(0.25, 0.02, 0.1), rotation_body_imu_rpy_rad=(-1.5, 0.2, -1.6)
)
BLOCKS = ("camera_gyroscope_bias", "camera_accelerometer_bias", "camera_imu_rotation")


@cache
def walk_of(robot: RobotModel, seed: int) -> AnalyticTrial:
    """A walk with a cheap IMU in the body."""
    sensors = SensorNoiseConfig(accelerometer_bias_mps2=0.2, gyroscope_bias_radps=0.01)
    return generate(AnalyticTrialConfig(body=WALK, sensors=sensors, substeps=1), robot, seed)


def drawn(seed: int) -> dict[str, Array]:
    """True errors of the camera's IMU, body axes."""
    random = np.random.default_rng(seed)
    sigmas = (CAMERA_IMU.gyroscope_bias, CAMERA_IMU.accelerometer_bias, CameraImuConfig().rotation_sigma_rad)
    return {name: sigma * random.standard_normal(3) for name, sigma in zip(BLOCKS, sigmas, strict=True)}


def with_camera_imu(trial: AnalyticTrial, errors: dict[str, Array], seed: int = 0) -> Iterator[Measurement]:
    """The walk with a sample of the camera's IMU after each joint sample."""
    random, mounting = np.random.default_rng(seed), CAMERA_IMU.T_body_imu
    turn = so3.exp(errors["camera_imu_rotation"])
    to_imu = mounting[:3, :3].T
    rate = trial.body.angular_velocity @ turn.T + errors["camera_gyroscope_bias"]
    force = trial.body.specific_force_at(mounting[:3, 3]) @ turn.T + errors["camera_accelerometer_bias"]
    rate += 10.0 * CAMERA_IMU.gyroscope_noise_density * random.standard_normal(rate.shape)
    force += 10.0 * CAMERA_IMU.accelerometer_noise_density * random.standard_normal(force.shape)
    row_of = {int(stamp_ns): row for row, stamp_ns in enumerate(trial.truth.stamps_ns)}
    for measurement in trial.measurements:
        yield measurement
        if isinstance(measurement, ImuSample):
            row = row_of[measurement.stamp_ns]
            yield CameraImuSample(measurement.stamp_ns, to_imu @ rate[row], to_imu @ force[row])


def run(
    robot: RobotModel, measurements: Iterator[Measurement], camera_imu: ImuCalibration | None = CAMERA_IMU
) -> tuple[LegOdometryFilter, list[StateEstimate]]:
    odometry = LegOdometryFilter(robot, camera_imu=camera_imu)
    return odometry, [estimate for estimate in map(odometry.push, measurements) if estimate is not None]


def tilt_error_rad(trial: AnalyticTrial, estimate: StateEstimate) -> Array:
    """Difference of the upward directions in body axes, (3,)."""
    row = int(np.searchsorted(trial.truth.stamps_ns, estimate.stamp_ns))
    return np.asarray(estimate.nav.T_world_body[2, :3] - trial.truth.T_world_body[row, 2, :3])


def position_error_m(trial: AnalyticTrial, estimate: StateEstimate) -> float:
    row = int(np.searchsorted(trial.truth.stamps_ns, estimate.stamp_ns))
    moved = trial.truth.positions[row] - trial.truth.positions[0]
    return float(np.linalg.norm(estimate.nav.T_world_body[:3, 3] - moved))


def test_the_difference_of_two_imus_is_the_update_of_a_kalman_filter(daisy: RobotModel) -> None:
    """A dense update of the full covariance, with the model written out again."""
    config = FilterConfig()
    camera = CameraImu(CAMERA_IMU, daisy.description.imu, config)
    blocks = robust_blocks(6, config.robust, config.initial, daisy.description.imu, extra=camera.blocks)
    layout, random = StateLayout(blocks), np.random.default_rng(3)
    core = random_core(layout, random)
    vector, covariance = core.mean.vector.copy(), core.factor @ core.factor.T
    bias_walks = (CAMERA_IMU.gyroscope_bias_walk, CAMERA_IMU.accelerometer_bias_walk)
    for name, walk in zip(BLOCKS, bias_walks, strict=False):
        at = np.r_[layout.at(name)]
        covariance[at, at] += walk**2 * 0.1
    difference = ImuDifference(*(random.normal(size=(5, 3)) * [[1e-3], [0.01], [0.5], [9.0], [3.0]]), duration_s=0.1)
    camera._compare(core, difference)

    rate, force = difference.rate - vector[GYROSCOPE_BIAS], difference.force - vector[ACCELEROMETER_BIAS]
    H = np.zeros((6, layout.dimension))
    H[:3, GYROSCOPE_BIAS] = H[3:, ACCELEROMETER_BIAS] = -np.eye(3)
    H[:3, GYROSCOPE_SCALE] = -np.diag(rate)
    H[:3, layout.at(BLOCKS[0])] = H[3:, layout.at(BLOCKS[1])] = np.eye(3)
    for axis in range(3):
        H[:3, layout.at(BLOCKS[2])][:, axis] = np.cross(np.eye(3)[axis], rate)
        H[3:, layout.at(BLOCKS[2])][:, axis] = np.cross(np.eye(3)[axis], force)
    H[:3, layout.at("camera_imu_delay").start] = -difference.angular_acceleration
    own = daisy.description.imu.gyroscope_noise_density
    rate_variance = (own**2 + CAMERA_IMU.gyroscope_noise_density**2) / 0.1 + CameraImuConfig().rate_noise_radps ** 2
    noise = np.repeat([rate_variance, CameraImuConfig().force_noise_mps2 ** 2], 3)
    noise[:3] += (CAMERA_IMU.gyroscope_scale * rate) ** 2
    gain = covariance @ H.T @ np.linalg.inv(H @ covariance @ H.T + np.diag(noise))
    measured = np.concatenate((difference.angular_velocity, difference.specific_force))
    plain = np.r_[GYROSCOPE_BIAS, GYROSCOPE_SCALE, ACCELEROMETER_BIAS, layout.active : layout.dimension]
    expected = vector + gain @ (measured - H @ vector)
    np.testing.assert_allclose(core.mean.vector[plain], expected[plain], rtol=1e-8, atol=1e-12)
    remaining = covariance - gain @ H @ covariance
    np.testing.assert_allclose(core.factor @ core.factor.T, remaining, rtol=1e-7, atol=1e-12)
    assert camera.counts == {}


def random_core(layout: StateLayout, random: np.random.Generator) -> SquareRootFilter:
    """A filter with small random states, correlated."""
    state = state_of(layout, random)
    core = SquareRootFilter(replace(state, vector=1e-3 * state.vector), np.full(layout.dimension, 0.01), is_wide=False)
    core.factor = np.tril(0.002 * random.normal(size=(layout.dimension, layout.dimension))) + 0.01 * np.eye(
        layout.dimension
    )
    return core


def test_without_a_second_imu_nothing_changes(daisy: RobotModel) -> None:
    """A calibration without samples leaves every estimate as it is, to rounding; samples without one exactly."""
    trial = walk_of(daisy, 1)
    alone = run(daisy, iter(trial.measurements), None)[1]
    ignored = run(daisy, with_camera_imu(trial, drawn(1)), None)[1]
    silent = run(daisy, iter(trial.measurements))[1]
    for one, other, third in zip(alone, ignored, silent, strict=True):
        np.testing.assert_array_equal(one.nav.T_world_body, other.nav.T_world_body)
        np.testing.assert_array_equal(one.covariance, other.covariance)
        np.testing.assert_allclose(one.nav.T_world_body, third.nav.T_world_body, atol=1e-9)
        np.testing.assert_allclose(one.covariance, third.covariance, rtol=1e-6, atol=1e-12)


def test_frames_that_are_remembered_change_nothing_that_is_measured(daisy: RobotModel) -> None:
    """Poses of frames and the second IMU are passive states side by side."""
    trial, errors = walk_of(daisy, 1), drawn(1)
    plain = run(daisy, with_camera_imu(trial, errors))[1]
    odometry, keyframe = LegOdometryFilter(daisy, remembers_frames=True, camera_imu=CAMERA_IMU), None
    estimates = []
    for measurement in with_camera_imu(trial, errors):
        estimate = odometry.push(measurement)
        if estimate is None:
            continue
        estimates.append(estimate)
        if len(estimates) % 40 == 1:
            at_ns = estimate.stamp_ns + 3_000_000
            keyframe = odometry.mark_frame(at_ns).anchor() if keyframe is None else keyframe.mark_frame(at_ns).keep()
    for one, other in zip(plain, estimates, strict=True):
        np.testing.assert_allclose(one.nav.T_world_body, other.nav.T_world_body, atol=1e-9)
        np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-5, atol=1e-12)


@pytest.mark.long
def test_tilt_is_better_with_a_good_imu_beside_a_cheap_one(daisy: RobotModel) -> None:
    """By the sigmas of the two biases: 20 mrad alone, a quarter of that with the camera's."""
    alone, both, sigmas = [], [], []
    for seed in range(1, 5):
        trial = walk_of(daisy, seed)
        alone.append(tilt_error_rad(trial, run(daisy, iter(trial.measurements), None)[1][-1]))
        last = run(daisy, with_camera_imu(trial, drawn(seed)))[1][-1]
        both.append(tilt_error_rad(trial, last))
        sigmas.append(np.sqrt(np.trace(last.covariance[:2, :2])))
    assert np.linalg.norm(both) < 0.5 * np.linalg.norm(alone)
    assert 0.003 < np.mean(sigmas) < 0.01


@pytest.mark.long
def test_the_sigmas_of_the_second_imu_are_honest(daisy: RobotModel) -> None:
    squared = []
    for seed in range(1, 7):
        errors = drawn(seed)
        odometry, _ = run(daisy, with_camera_imu(walk_of(daisy, seed), errors, seed))
        assert odometry.counts.get("camera_imu_rejected", 0) == 0
        for name in BLOCKS:
            value, sigma = odometry.reports()[name]
            squared.append((value - errors[name]) / sigma)
    mean_square = np.mean(np.square(squared))
    assert 0.4 < mean_square < 1.6, "18 numbers of each of 6 walks, correlated within a walk"


def test_the_delay_of_the_second_imu_is_found(daisy: RobotModel) -> None:
    trial = generate(AnalyticTrialConfig(body=swaying(WALK), substeps=1), daisy, 2)
    late = 20_000_000

    def delayed() -> Iterator[Measurement]:
        held: list[Measurement] = []
        for measurement in with_camera_imu(trial, drawn(2)):
            if isinstance(measurement, CameraImuSample):
                held.append(replace(measurement, stamp_ns=measurement.stamp_ns + late))
                continue
            while held and held[0].stamp_ns <= measurement.stamp_ns:
                yield held.pop(0)
            yield measurement

    odometry, _ = run(daisy, delayed())
    value, sigma = odometry.reports()["camera_imu_delay"]
    assert sigma[0] < 0.002
    assert value[0] == pytest.approx(late / NS_PER_S, abs=0.004)


def swaying(walk: BodyMotionConfig) -> BodyMotionConfig:
    return walk.model_copy(update={"sway_roll_rad": 0.06, "sway_pitch_rad": 0.05})


@pytest.mark.parametrize("silent_from_s", [0.0, 2.0])
def test_the_second_imu_carries_on_where_the_bodys_is_silent(daisy: RobotModel, silent_from_s: float) -> None:
    trial = walk_of(daisy, 3)

    def measurements(camera: bool) -> Iterator[Measurement]:
        for one in with_camera_imu(trial, drawn(3)):
            is_body = isinstance(one, ImuSample) and one.stamp_ns / NS_PER_S >= silent_from_s
            if not is_body and (camera or not isinstance(one, CameraImuSample)):
                yield one

    odometry, estimates = run(daisy, measurements(camera=True))
    without = run(daisy, measurements(camera=False), None)[1]
    assert odometry.counts["camera_imu_alone"] > 150
    assert odometry.counts.get("started_moving", 0) == 0
    assert np.linalg.norm(tilt_error_rad(trial, estimates[-1])) < 0.015
    assert position_error_m(trial, estimates[-1]) < 0.03
    rotation_sigmas = [np.sqrt(np.trace(one[-1].covariance[:3, :3])) for one in (estimates, without)]
    assert rotation_sigmas[0] < 0.7 * rotation_sigmas[1]


@pytest.mark.parametrize("kind", [ImuSample, CameraImuSample])
def test_an_imu_that_is_reversed_on_the_way_is_set_aside(daisy: RobotModel, kind: type[InertialReading]) -> None:
    """A cable or a driver turns all axes of one IMU from a sample to the next; the other one goes on."""
    trial = walk_of(daisy, 3)

    def reversed_from(since_s: float) -> Iterator[Measurement]:
        for one in with_camera_imu(trial, drawn(3)):
            if isinstance(one, kind) and one.stamp_ns / NS_PER_S > since_s:
                yield replace(one, angular_velocity=-one.angular_velocity, specific_force=-one.specific_force)
            else:
                yield one

    odometry, estimates = run(daisy, reversed_from(2.0))
    found = [event for event in odometry.take_events() if isinstance(event, Event)]
    (event,) = (each for each in found if each.kind == "imu_set_aside")
    assert 2.0 < event.stamp_ns / NS_PER_S < 2.2
    assert event.detail.startswith(f"the {'body' if kind is ImuSample else 'camera'}'s accelerometer")
    assert np.linalg.norm(tilt_error_rad(trial, estimates[-1])) < 0.03
    assert position_error_m(trial, estimates[-1]) < 0.03


def test_a_step_of_a_bias_is_counted_and_followed(daisy: RobotModel) -> None:
    """The gyroscope of the camera's IMU jumps by 0.1 rad/s: rejected for a second, then taken up."""
    trial, errors = walk_of(daisy, 4), drawn(4)
    turn = CAMERA_IMU.T_body_imu[:3, :3].T
    step = np.array([0.0, 0.0, 0.1])

    def jumping() -> Iterator[Measurement]:
        for one in with_camera_imu(trial, errors):
            if isinstance(one, CameraImuSample) and one.stamp_ns / NS_PER_S > 2.0:
                yield replace(one, angular_velocity=one.angular_velocity + turn @ step)
            else:
                yield one

    odometry, estimates = run(daisy, jumping())
    assert odometry.counts["camera_imu_disagrees"] == 1
    value, sigma = odometry.reports()["camera_gyroscope_bias"]
    assert np.abs(value - errors["camera_gyroscope_bias"] - step).max() < 5.0 * sigma.max()
    assert position_error_m(trial, estimates[-1]) < 0.03


def test_a_late_sample_of_the_second_imu_is_refused_and_counted(daisy: RobotModel) -> None:
    odometry = LegOdometryFilter(daisy, FilterConfig(), camera_imu=CAMERA_IMU)
    for stamp_ns in (10, 20, 15):
        odometry.push(CameraImuSample(stamp_ns, np.zeros(3), np.array([0.0, 0.0, 9.81])))
    assert odometry.counts == {"camera_imu_stamp_refused": 1}

# SPDX-License-Identifier: BSD-3-Clause
"""Preintegration against motions known by hand and in closed form; detection of rest."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from worlds import IMU, NS_PER_S, WALK, pose_at, readings, stamps_ns, velocity_at

from coclo_vio.backend.window.config import InertialConfig, SmootherConfig, StandstillWindowConfig
from coclo_vio.backend.window.inertial import Preintegration, is_possible
from coclo_vio.backend.window.inertial_source import InertialSource
from coclo_vio.backend.window.variables import BIASES
from coclo_vio.geometry import se3, so3
from coclo_vio.robot.standstill import StandstillDetector
from coclo_vio.values.calibration import ImuCalibration
from coclo_vio.values.measurements import InertialReading

NO_BIAS = gtsam.imuBias.ConstantBias()
UP = np.array([0.0, 0.0, 9.81])
SPIN = np.array([0.3, -0.5, 0.8])  # rad/s, body axes
STEP_NS = 5_000_000
R_BODY_IMU, LEVER = IMU.T_body_imu[:3, :3], IMU.T_body_imu[:3, 3]


def as_read(stamp_ns: int, rate_body: np.ndarray, force_body: np.ndarray) -> InertialReading:
    """The mounted IMU's reading of a rate and of a force at its place, both in body axes."""
    return InertialReading(stamp_ns, R_BODY_IMU.T @ rate_body, R_BODY_IMU.T @ force_body)


def integrated(
    samples: list[InertialReading],
    end_ns: int,
    imu: ImuCalibration = IMU,
    bias: gtsam.imuBias.ConstantBias = NO_BIAS,
) -> Preintegration:
    """From time 0 to ``end_ns``; readings up to 0 are pushed before it starts."""
    motion = Preintegration(imu, InertialConfig())
    for sample in samples:
        if sample.stamp_ns > 0 and motion.start_ns is None:
            motion.restart(0, bias)
        motion.push(sample)
    assert motion.advance(end_ns)
    return motion


def predicted(
    motion: Preintegration,
    pose: np.ndarray | None = None,
    velocity: np.ndarray | None = None,
    bias: gtsam.imuBias.ConstantBias = NO_BIAS,
) -> tuple[np.ndarray, np.ndarray]:
    """Pose and velocity after it, from rest at the origin unless said otherwise."""
    start = gtsam.NavState(
        gtsam.Pose3(np.eye(4) if pose is None else pose), np.zeros(3) if velocity is None else velocity
    )
    end = motion.measured.predict(start, bias)
    return np.asarray(end.pose().matrix()), np.asarray(end.velocity())


def preintegrated_walk(start_s: float, end_s: float, step_ns: int = STEP_NS, offset_ns: int = 0) -> Preintegration:
    """Exact readings of a walk, started at ``start_s``; the stamps of readings and of both ends need not agree."""
    start_ns, end_ns = round(start_s * NS_PER_S), round(end_s * NS_PER_S)
    motion = Preintegration(IMU, InertialConfig())
    samples = readings(WALK, range(start_ns - 20 * step_ns + offset_ns, end_ns + 2 * step_ns, step_ns))
    for sample in samples:
        if sample.stamp_ns > start_ns and motion.start_ns is None:
            motion.advance(start_ns)
            motion.restart(start_ns, NO_BIAS)
        motion.push(sample)
    assert motion.advance(end_ns)
    return motion


def walk_error(motion: Preintegration, start_s: float, end_s: float) -> np.ndarray:
    """[rotation, position, velocity] (9,) of the preintegration against the closed form."""
    start_ns, end_ns = round(start_s * NS_PER_S), round(end_s * NS_PER_S)
    pose, velocity = predicted(motion, pose_at(WALK, start_ns), velocity_at(WALK, start_ns))
    return np.concatenate((se3.log(se3.inverse(pose_at(WALK, end_ns)) @ pose), velocity - velocity_at(WALK, end_ns)))


def test_at_rest_nothing_moves() -> None:
    motion = integrated([as_read(k * STEP_NS, np.zeros(3), UP) for k in range(-3, 201)], NS_PER_S)
    pose, velocity = predicted(motion)
    np.testing.assert_allclose(pose, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(velocity, 0.0, atol=1e-12)
    assert motion.measured.deltaTij() == pytest.approx(1.0)


def test_constant_acceleration_is_half_a_t_squared() -> None:
    acceleration = np.array([0.4, -0.3, 0.2])
    motion = integrated([as_read(k * STEP_NS, np.zeros(3), acceleration + UP) for k in range(-3, 401)], 2 * NS_PER_S)
    pose, velocity = predicted(motion)
    np.testing.assert_allclose(velocity, 2.0 * acceleration, atol=1e-11)
    np.testing.assert_allclose(pose[:3, 3], 2.0 * acceleration, atol=1e-11)
    np.testing.assert_allclose(pose[:3, :3], np.eye(3), atol=1e-12)


def test_rotation_about_the_origin_of_the_body_is_no_translation_with_any_lever_arm() -> None:
    samples = []
    for k in range(-3, 201):
        R_world_body = so3.exp(SPIN * k * STEP_NS / NS_PER_S)
        force = R_world_body.T @ UP + np.cross(SPIN, np.cross(SPIN, LEVER))
        samples.append(as_read(k * STEP_NS, SPIN, force))
    pose, velocity = predicted(integrated(samples, NS_PER_S))
    np.testing.assert_allclose(pose[:3, :3], so3.exp(SPIN), atol=1e-12)
    np.testing.assert_allclose(pose[:3, 3], 0.0, atol=2e-5)  # chords of a force that turns: (w dt)^2 g / 12
    np.testing.assert_allclose(velocity, 0.0, atol=2e-5)


def test_angular_acceleration_at_the_end_of_a_lever_arm_does_not_move_the_body() -> None:
    """About an upright axis, from rest to 2 rad/s: the end of the arm gains 0.2 m/s, the body's origin nothing."""
    spin_up = np.array([0.0, 0.0, 2.0])
    samples = []
    for k in range(-3, 201):
        rate = spin_up * max(k, 0) * STEP_NS / NS_PER_S
        force = UP + np.cross(rate, np.cross(rate, LEVER)) + (np.cross(spin_up, LEVER) if k >= 0 else 0.0)
        samples.append(as_read(k * STEP_NS, rate, force))
    pose, velocity = predicted(integrated(samples, NS_PER_S))
    np.testing.assert_allclose(pose[:3, :3], so3.exp(0.5 * spin_up), atol=1e-12)
    assert np.linalg.norm(np.cross(spin_up, LEVER)) > 0.15
    np.testing.assert_allclose(velocity, 0.0, atol=1e-4)
    np.testing.assert_allclose(pose[:3, 3], 0.0, atol=1e-4)


def test_a_walk_is_reproduced() -> None:
    error = walk_error(preintegrated_walk(2.0, 2.5), 2.0, 2.5)
    assert np.abs(error[:3]).max() < 2e-6
    assert np.abs(error[3:6]).max() < 1e-5
    assert np.abs(error[6:]).max() < 4e-5


@pytest.mark.parametrize("part", [slice(0, 3), slice(3, 6), slice(6, 9)], ids=["rotation", "position", "velocity"])
def test_errors_decrease_with_the_square_of_the_step(part: slice) -> None:
    coarse, fine = (
        np.linalg.norm(walk_error(preintegrated_walk(2.0, 2.5, step_ns), 2.0, 2.5)[part])
        for step_ns in (10_000_000, 2_500_000)
    )
    assert fine < coarse / 10.0  # 16 for second order, 4 for first order


def test_readings_and_frames_need_not_be_taken_at_the_same_time() -> None:
    error = walk_error(preintegrated_walk(2.0013, 2.5038, offset_ns=1_700_000), 2.0013, 2.5038)
    assert np.abs(error[:6]).max() < 1e-5
    assert np.abs(error[6:]).max() < 6e-5


def test_two_parts_make_the_whole() -> None:
    """A keyframe in the middle, between two readings: the second part continues where the first one ended."""
    cut_ns, end_ns = 2_203_300_000, 2_500_000_000
    first = preintegrated_walk(2.0, 2.2033)
    state = predicted(first, pose_at(WALK, 2 * NS_PER_S), velocity_at(WALK, 2 * NS_PER_S))
    first.restart(cut_ns, NO_BIAS)
    newest_ns = cut_ns - cut_ns % STEP_NS + 2 * STEP_NS  # preintegrated_walk has read up to there
    for sample in readings(WALK, range(newest_ns + STEP_NS, end_ns + STEP_NS, STEP_NS)):
        first.push(sample)
    assert first.advance(end_ns)
    assert first.measured.deltaTij() == pytest.approx((end_ns - cut_ns) / NS_PER_S)
    pose, velocity = predicted(first, *state)
    assert np.abs(se3.log(se3.inverse(pose_at(WALK, end_ns)) @ pose)).max() < 1e-5
    assert np.abs(velocity - velocity_at(WALK, end_ns)).max() < 6e-5


def test_readings_may_be_pushed_at_once_or_step_by_step() -> None:
    samples = readings(WALK, range(-20 * STEP_NS + 700_000, 3 * NS_PER_S, STEP_NS))
    at_once = integrated(samples, 2 * NS_PER_S + 1_000_000)
    bit_by_bit = Preintegration(IMU, InertialConfig())
    for sample in samples:
        if sample.stamp_ns > 0 and bit_by_bit.start_ns is None:
            bit_by_bit.restart(0, NO_BIAS)
        bit_by_bit.push(sample)
        bit_by_bit.push(sample)  # twice: the second one is left out
        if 0 < sample.stamp_ns <= 2 * NS_PER_S:
            bit_by_bit.advance(sample.stamp_ns)
    bit_by_bit.advance(2 * NS_PER_S + 1_000_000)
    np.testing.assert_array_equal(predicted(at_once)[0], predicted(bit_by_bit)[0])
    np.testing.assert_array_equal(at_once.measured.preintMeasCov(), bit_by_bit.measured.preintMeasCov())


def test_a_known_bias_is_subtracted() -> None:
    """In the imu frame, also at the end of the lever arm: readings with it give the same motion as those without."""
    gyroscope, accelerometer = np.array([0.02, -0.05, 0.03]), np.array([0.1, 0.2, -0.1])
    samples = readings(WALK, stamps_ns(2.0, 3.0, STEP_NS))
    samples = [
        InertialReading(each.stamp_ns - 2 * NS_PER_S, each.angular_velocity, each.specific_force) for each in samples
    ]
    off = [
        InertialReading(s.stamp_ns, s.angular_velocity + gyroscope, s.specific_force + accelerometer) for s in samples
    ]
    bias = gtsam.imuBias.ConstantBias(accelerometer, gyroscope)
    pose, velocity = predicted(integrated(samples, 900_000_000))
    pose_off, velocity_off = predicted(integrated(off, 900_000_000, bias=bias), bias=bias)
    np.testing.assert_allclose(pose_off, pose, atol=1e-12)
    np.testing.assert_allclose(velocity_off, velocity, atol=1e-12)


def test_a_bias_found_later_is_corrected_to_first_order() -> None:
    gyroscope, accelerometer = np.array([2e-3, -1e-3, 3e-3]), np.array([0.02, -0.01, 0.03])
    samples = [as_read(k * STEP_NS, SPIN, UP) for k in range(-3, 101)]
    off = [
        InertialReading(s.stamp_ns, s.angular_velocity + gyroscope, s.specific_force + accelerometer) for s in samples
    ]
    bias = gtsam.imuBias.ConstantBias(accelerometer, gyroscope)
    pose, velocity = predicted(integrated(samples, 500_000_000))
    uncorrected = predicted(integrated(off, 500_000_000))
    corrected = predicted(integrated(off, 500_000_000), bias=bias)
    assert np.abs(uncorrected[1] - velocity).max() > 0.01
    np.testing.assert_allclose(corrected[0], pose, atol=2e-5)
    np.testing.assert_allclose(corrected[1], velocity, atol=5e-5)


def test_a_long_pause_is_a_gap_until_the_next_start() -> None:
    with_pause = [as_read(k * STEP_NS, np.zeros(3), UP) for k in range(-3, 401) if not 100 < k < 160]
    motion = Preintegration(IMU, InertialConfig(max_gap_s=0.2))
    for sample in with_pause[:4]:
        motion.push(sample)
    motion.restart(0, NO_BIAS)
    for sample in with_pause[4:]:
        motion.push(sample)
    assert motion.advance(500_000_000)
    assert not motion.has_gap
    assert not motion.advance(900_000_000)
    assert motion.has_gap
    motion.restart(900_000_000, NO_BIAS)
    assert motion.advance(1_200_000_000)
    assert not motion.has_gap


def test_a_pause_up_to_the_frame_is_a_gap_as_well() -> None:
    motion = integrated([as_read(k * STEP_NS, np.zeros(3), UP) for k in range(-3, 11)], 100_000_000)
    assert not motion.advance(NS_PER_S)
    assert motion.has_gap


def test_without_readings_there_is_nothing_to_integrate() -> None:
    motion = Preintegration(IMU, InertialConfig())
    motion.restart(0, NO_BIAS)
    assert not motion.advance(NS_PER_S)
    np.testing.assert_array_equal(motion.rate_body, 0.0)


def test_the_newest_rate_is_in_body_axes() -> None:
    motion = integrated([as_read(k * STEP_NS, SPIN, UP) for k in range(-3, 11)], 50_000_000)
    np.testing.assert_allclose(motion.rate_body, SPIN)


def test_the_noise_is_that_of_the_calibration_but_at_least_the_configured_one() -> None:
    samples = [as_read(k * STEP_NS, np.zeros(3), UP) for k in range(-3, 101)]

    def velocity_variance(density: float) -> float:
        imu = IMU.model_copy(update={"accelerometer_noise_density": density})
        return float(integrated(samples, 500_000_000, imu).measured.preintMeasCov()[6, 6])

    least = InertialConfig().accelerometer_noise_density
    assert velocity_variance(1e-6) == velocity_variance(least)
    assert velocity_variance(10 * least) == pytest.approx(100 * least**2 * 0.5, rel=0.02)


def detector_after(rate_noise: float, force_noise: float, count: int = 80, rate: float = 200.0) -> StandstillDetector:
    random = np.random.default_rng(5)
    detector = StandstillDetector(StandstillWindowConfig().limits)
    for k in range(count):
        wobble = random.standard_normal((2, 3)) / np.sqrt(3.0)
        detector.push(
            InertialReading(round(k * NS_PER_S / rate), 0.02 + rate_noise * wobble[0], UP + force_noise * wobble[1])
        )
    return detector


def test_readings_at_rest_give_their_means() -> None:
    rest = detector_after(0.01, 0.1).rest
    assert rest is not None
    np.testing.assert_allclose(rest.angular_velocity, 0.02, atol=3e-3)
    np.testing.assert_allclose(rest.specific_force, UP, atol=0.03)
    assert rest.span_s == pytest.approx(0.3)


@pytest.mark.parametrize(("rate_noise", "force_noise"), [(0.06, 0.1), (0.01, 0.6)], ids=["turns", "shakes"])
def test_readings_in_motion_have_means_but_are_not_at_rest(rate_noise: float, force_noise: float) -> None:
    detector = detector_after(rate_noise, force_noise)
    assert detector.rest is None
    assert detector.means is not None
    np.testing.assert_allclose(detector.means.specific_force, UP, atol=0.2)


def test_a_short_time_is_not_enough_to_be_at_rest() -> None:
    assert detector_after(0.0, 0.0, count=40).rest is None  # 0.2 of 0.3 s
    assert detector_after(0.0, 0.0, count=4, rate=10.0).rest is None  # 4 readings
    assert StandstillDetector(StandstillWindowConfig().limits).means is None


def test_readings_older_than_the_window_are_dropped() -> None:
    detector = detector_after(1.0, 10.0)
    for k in range(80, 160):
        detector.push(InertialReading(k * STEP_NS, np.zeros(3), UP))
    assert detector.rest is not None
    np.testing.assert_allclose(detector.rest.angular_velocity, 0.0, atol=1e-14)


def test_it_can_restart_before_the_last_integrated_reading() -> None:
    """What turned out to be rest is left out, and the readings after it are not lost."""
    motion = preintegrated_walk(2.0, 2.5)
    motion.restart(2_203_300_000, NO_BIAS)
    assert motion.advance(2_500_000_000)
    anew = preintegrated_walk(2.2033, 2.5)
    assert motion.measured.deltaTij() == pytest.approx(0.2967)
    state = pose_at(WALK, 2_203_300_000), velocity_at(WALK, 2_203_300_000)
    for early, late in zip(predicted(motion, *state), predicted(anew, *state), strict=True):
        np.testing.assert_allclose(early, late, atol=5e-6)


def test_the_newest_rate_stays_when_it_starts_in_the_past() -> None:
    samples = [as_read(k * STEP_NS, SPIN * k, UP) for k in range(-3, 11)]
    motion = integrated(samples, 50_000_000)
    motion.restart(20_000_000, NO_BIAS)
    np.testing.assert_allclose(motion.rate_body, 10.0 * SPIN)


def test_a_restart_before_the_kept_readings_is_a_gap() -> None:
    motion = integrated([as_read(k * STEP_NS, np.zeros(3), UP) for k in range(-3, 601)], 3 * NS_PER_S)
    motion.restart(NS_PER_S, NO_BIAS)
    assert not motion.advance(3 * NS_PER_S)
    assert motion.has_gap


def test_a_pause_divided_by_frames_is_a_gap_all_the_same() -> None:
    """Frames every 0.1 s, each a keyframe, and 0.5 s without a reading, which the last one must not replace."""
    motion = integrated([as_read(k * STEP_NS, np.zeros(3), UP) for k in range(-3, 21)], 100_000_000)
    advanced = []
    for stamp_ns in range(200_000_000, 600_000_001, 100_000_000):
        motion.restart(stamp_ns - 100_000_000, NO_BIAS)
        advanced.append(motion.advance(stamp_ns))
    assert advanced == [True, True, False, False, False]  # 0.2 s is allowed


@pytest.mark.parametrize("what", ["angular_velocity", "specific_force"])
def test_readings_that_no_sensor_can_give_are_left_out(what: str) -> None:
    samples = [as_read(k * STEP_NS, np.zeros(3), UP) for k in range(-3, 201)]
    spoilt = [replace(each, **{what: np.full(3, 1e200)}) if 50 < k < 60 else each for k, each in enumerate(samples)]
    motion, detector = integrated(spoilt, NS_PER_S), StandstillDetector(StandstillWindowConfig().limits)
    pose, velocity = predicted(motion)
    np.testing.assert_allclose(pose, np.eye(4), atol=1e-9)
    np.testing.assert_allclose(velocity, 0.0, atol=1e-9)
    for sample in filter(is_possible, spoilt[:70]):
        detector.push(sample)
    assert detector.rest is not None


def test_a_sensor_that_measures_no_gravity_is_not_at_rest() -> None:
    detector = StandstillDetector(StandstillWindowConfig().limits)
    for k in range(80):
        detector.push(InertialReading(k * STEP_NS, np.zeros(3), np.zeros(3)))
    assert detector.rest is None
    assert detector.means is not None


def test_a_reading_that_comes_twice_counts_once() -> None:
    once, twice = (
        StandstillDetector(StandstillWindowConfig().limits),
        StandstillDetector(StandstillWindowConfig().limits),
    )
    for k in range(40):
        sample = InertialReading(k * STEP_NS, np.full(3, 1e-3 * k), UP)
        once.push(sample)
        for _ in range(1 + k % 2):
            twice.push(sample)
    np.testing.assert_array_equal(once.means.angular_velocity, twice.means.angular_velocity)


def test_biases_before_the_start_are_as_uncertain_as_the_imus_grade() -> None:
    imu = ImuCalibration(grade="calibrated_mems")
    for inertial, expected in (
        (InertialConfig(), (imu.accelerometer_bias, imu.gyroscope_bias)),
        (InertialConfig(accelerometer_bias=0.4, gyroscope_bias=0.03), (0.4, 0.03)),
    ):
        source = InertialSource(imu, SmootherConfig(inertial=inertial))
        source.level(None, None)
        sigmas = np.sqrt(np.diag(source.begin(0, 0, np.zeros(3), 0.1).covariances[BIASES]))
        np.testing.assert_allclose(sigmas, np.repeat(expected, 3))

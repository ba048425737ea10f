# SPDX-License-Identifier: BSD-3-Clause
"""IMUs whose rates and accelerations are on two topics: joined, or refused by name."""

import numpy as np
import pytest
from tiny_bags import START_NS, STEP_NS, TinyBag

from coclo_vio.datasets.dataset import DatasetConfig, open_dataset
from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.datasets.rosbag.imu_halves import ImuUnion
from coclo_vio.values.config import parse_settings
from coclo_vio.values.errors import DatasetError, TopicNotFound
from coclo_vio.values.measurements import ALL_SENSORS, CameraImuSample, ImuSample

IMU = "sensor_msgs/msg/Imu"
GYRO, ACCEL = "/camera/gyro/sample", "/camera/accel/sample"
NO_READING = (-1.0,) + (0.0,) * 8


def config_of(*settings):
    return DatasetConfig.parse(parse_settings([f"rosbag.topics.{setting}" for setting in settings]), "test")


def add_rates(bag, topic, count=120, **fields):
    for i in range(count):
        bag.add(topic, IMU, START_NS + i * STEP_NS, angular_velocity__x=0.001 * i + 1.0, **fields)


def add_accelerations(bag, topic, count=60, **fields):
    """At half the rate, between the stamps of the rates; z grows by 2 m/s^2 in each step of 20 ms."""
    for i in range(count):
        stamp_ns = START_NS - STEP_NS // 2 + i * 2 * STEP_NS
        bag.add(topic, IMU, stamp_ns, linear_acceleration__z=9.81 + 2.0 * i, **fields)


@pytest.fixture(params=["walk.bag", "walk.mcap"])
def bag(request, tmp_path):
    return TinyBag(tmp_path / request.param)


def expected(samples, kind):
    assert {type(sample) for sample in samples} == {kind}
    steps = np.array([(sample.stamp_ns - START_NS) / STEP_NS for sample in samples])
    np.testing.assert_allclose([s.angular_velocity[0] for s in samples], 1.0 + 0.001 * steps, atol=1e-12)
    np.testing.assert_allclose([s.specific_force[2] for s in samples], 9.81 + 0.5 + steps, atol=1e-6)
    return len(samples)


def test_the_two_topics_of_a_realsense_are_one_camera_imu(bag):
    add_rates(bag, GYRO, header__frame_id="camera_gyro_optical_frame")
    add_accelerations(bag, ACCEL, header__frame_id="camera_accel_optical_frame")
    dataset = open_dataset(bag.write(), None)
    assert expected(list(dataset.measurements(ALL_SENSORS)), CameraImuSample) == 118  # the last lack a later one
    report = dataset.report()
    assert any(f"rates of {GYRO} and accelerations of {ACCEL} are joined" in note for note in report.notes)
    assert report.dropped == {f"{GYRO}: no acceleration before and after this rate": 2}


@pytest.mark.parametrize("named", [f"camera_imu={GYRO}", f"camera_imu={ACCEL}", f"imu={GYRO}"])
def test_half_an_imu_named_by_hand_gets_its_other_half(bag, named):
    add_rates(bag, GYRO)
    add_accelerations(bag, ACCEL)
    dataset = open_dataset(bag.write(), None, config_of(named))
    assert expected(list(dataset.measurements(ALL_SENSORS)), ImuSample if named[:4] == "imu=" else CameraImuSample)


@pytest.mark.parametrize(
    ("rate_fields", "force_fields"),
    [
        ({"linear_acceleration_covariance": NO_READING}, {"angular_velocity_covariance": NO_READING}),
        ({}, {}),
        ({"linear_acceleration__z": float("nan")}, {"angular_velocity__x": float("nan")}),
        (
            {"linear_acceleration_covariance": NO_READING, "linear_acceleration__z": 5.0},
            {"angular_velocity_covariance": NO_READING, "angular_velocity__x": 7.0},
        ),
    ],
    ids=["covariance", "zeros", "NaN", "covariance against a reading"],
)
def test_halves_under_any_name_are_found_by_what_they_hold(bag, rate_fields, force_fields):
    add_rates(bag, "/trunk/turning", **rate_fields)
    add_accelerations(bag, "/trunk/pulling", **force_fields)
    dataset = open_dataset(bag.write(), None)
    assert expected(list(dataset.measurements(ALL_SENSORS)), ImuSample) == 118
    assert next(choice for choice in dataset.topics() if choice.role == "imu").topics == (
        "/trunk/turning",
        "/trunk/pulling",
    )


def test_a_whole_imu_goes_before_two_halves(bag):
    add_rates(bag, GYRO)
    add_accelerations(bag, ACCEL)
    bag.add_imu(START_NS, topic="/camera/imu")
    dataset = open_dataset(bag.write(), None)
    assert next(choice for choice in dataset.topics() if choice.role == "camera_imu").topics == ("/camera/imu",)


def test_half_an_imu_alone_is_refused_by_name_and_not_called_none(bag):
    add_rates(bag, "/imu", linear_acceleration_covariance=NO_READING)
    bag.add("/other", IMU, START_NS)  # of one message, all of zeros, nothing is known
    path = bag.write()
    sentence = r"/imu have no accelerations \(the covariance begins with -1.*topics\.imu_acceleration"
    with pytest.raises(TopicNotFound, match=sentence):
        open_dataset(path, None, config_of("imu=/imu"))
    whole = open_dataset(path, None)
    assert next(choice for choice in whole.topics() if choice.role == "imu").topic == "/other"
    joined = open_dataset(path, None, config_of("imu=/imu", "imu_acceleration=/other"))
    assert next(choice for choice in joined.topics() if choice.role == "imu").topics == ("/imu", "/other")


def test_an_imu_without_accelerations_is_noted_with_the_reason(bag):
    add_rates(bag, "/imu")
    dataset = open_dataset(bag.write(), None)
    with pytest.raises(DatasetError, match=r"/imu has no accelerations .zero or NaN in the first 120 messages"):
        dataset.report()


def test_a_robot_that_stands_still_at_first_has_a_whole_imu(bag):
    for i in range(400):
        bag.add_imu(START_NS + i * STEP_NS, rate_x=0.0 if i < 300 else 0.2)
    dataset = open_dataset(bag.write(), None)
    assert len(list(dataset.measurements(frozenset({ImuSample})))) == 400


def test_noise_of_two_halves_comes_from_each(bag):
    variance = np.diag([4e-4] * 3).ravel()
    add_rates(bag, GYRO, angular_velocity_covariance=tuple(variance))
    add_accelerations(bag, ACCEL, linear_acceleration_covariance=tuple(variance))
    bag.add_tf(bag.transform("base_link", "gyro", (0.1, 0.2, 0.3)))
    for _, _, message in bag._messages[:120]:
        message.header.frame_id = "gyro"
    imu = open_dataset(bag.write(), None).camera_imu_calibration()
    assert imu.gyroscope_noise_density == pytest.approx(2e-3, rel=1e-6)
    assert imu.accelerometer_noise_density == pytest.approx(2e-2 / np.sqrt(50.0), rel=1e-6)


def test_accelerations_are_not_interpolated_over_a_gap():
    tally = ReadTally("test", 0.1)
    union = ImuUnion("/gyro", tally)
    list(union.add_acceleration(0, np.zeros(3)))
    list(union.add_rate(500_000_000, np.ones(3)))
    assert list(union.add_acceleration(1_000_000_000, np.ones(3))) == []
    assert tally.dropped == {"/gyro: no acceleration before and after this rate": 1}
    assert [stamp_ns for stamp_ns, _, _ in union.add_rate(1_000_000_000, np.ones(3))] == [1_000_000_000]


def test_accelerations_that_are_left_out_leave_a_whole_imu_as_it_is(bag):
    bag.add_imu(START_NS)
    path = bag.write()
    dataset = open_dataset(path, None, config_of("imu=/imu", "imu_acceleration=''"))
    assert next(choice for choice in dataset.topics() if choice.role == "imu").topics == ("/imu",)
    with pytest.raises(TopicNotFound, match=r"no message on /acc.*as imu_acceleration"):
        open_dataset(path, None, config_of("imu=/imu", "imu_acceleration=/acc"))

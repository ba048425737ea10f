# SPDX-License-Identifier: BSD-3-Clause
"""Leg sensing: readings from single measurements, for every estimator with legs."""

import numpy as np
import pytest

from coclo_vio.geometry import so3
from coclo_vio.robot.contact import ContactConfig
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.leg_sensing import LegSensing
from coclo_vio.robot.model import RobotModel
from coclo_vio.robot.standstill import ImuMeans, StandstillConfig, StartRule
from coclo_vio.values.errors import RobotModelError
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample

UP = np.array([0.0, 0.0, 1.0])
MS = 1_000_000
REST = ImuMeans(0, np.zeros(3), 9.81 * UP, 50, 0.5)


@pytest.fixture(scope="module")
def turned_imu() -> RobotModel:
    """A Go1 whose IMU is turned against the body."""
    description = load_robot("go1")
    imu = description.imu.model_copy(update={"rotation_body_imu_rpy_rad": (0.2, -0.4, 1.5)})
    return RobotModel(description.model_copy(update={"imu": imu}))


def sensing_of(robot: RobotModel) -> LegSensing:
    return LegSensing(robot, ContactConfig(source="force_sensor"), StandstillConfig(), force_timeout_s=0.1)


def joints(stamp_ns: int, velocity: float = 0.0) -> JointSample:
    return JointSample(stamp_ns, np.full(12, 0.3), np.full(12, velocity), np.zeros(12))


def test_a_reading_has_the_mean_of_the_imu_since_the_last_in_the_body_frame(turned_imu: RobotModel) -> None:
    sensing, rng = sensing_of(turned_imu), np.random.default_rng(41)
    turn = turned_imu.description.imu.T_body_imu[:3, :3]
    assert not np.allclose(turn, np.eye(3))
    samples = [ImuSample(ms * MS, rng.normal(size=3), rng.normal(size=3)) for ms in range(6)]
    readings = [sensing.push(sample, UP) for sample in (*samples[:3], joints(2 * MS), *samples[3:], joints(5 * MS))]
    reading = readings[-1]
    assert reading is not None
    rates = np.array([sample.angular_velocity for sample in samples[3:]]) @ turn.T
    np.testing.assert_allclose(reading.angular_velocity, rates.mean(axis=0), atol=1e-15)
    forces = np.array([sample.specific_force for sample in samples[2:]]) @ turn.T  # with the one before
    np.testing.assert_allclose(reading.specific_force, forces.mean(axis=0), atol=1e-15)
    assert [step.stamp_ns for step in reading.inertial] == [3 * MS, 4 * MS, 5 * MS]
    assert sensing.imu is samples[-1]


def test_samples_out_of_order_change_nothing_and_are_counted(turned_imu: RobotModel) -> None:
    sensing = sensing_of(turned_imu)
    ordered = (FootForceSample(5, np.full(4, 50.0)), ImuSample(5, np.zeros(3), 9.81 * UP), joints(5))
    first = [sensing.push(sample, UP) for sample in ordered][-1]
    late = (FootForceSample(5, np.zeros(4)), ImuSample(4, np.ones(3), np.ones(3)), joints(5, velocity=3.0))
    assert [sensing.push(sample, UP) for sample in late] == [None, None, None]
    assert sensing.imu is ordered[1]
    assert first is not None
    after = sensing.push(joints(6), UP)
    assert after is not None
    np.testing.assert_array_equal(after.contact.load, 50.0)
    for name in ("foot_force_stamp_refused", "imu_stamp_refused", "joint_stamp_refused", "imu_missing"):
        assert sensing.counts[name] == 1, name


def test_rest_is_in_the_body_frame_and_that_of_the_last_reading(turned_imu: RobotModel) -> None:
    sensing, rate = sensing_of(turned_imu), np.array([0.01, 0.02, -0.03])
    for ms in range(0, 600, 5):
        sensing.push(ImuSample(ms * MS, rate, 9.81 * UP), UP)
        reading = sensing.push(joints(ms * MS), UP)
        assert reading is not None
        assert reading.is_stationary == (sensing.rest is not None) == (ms >= 400)  # 0.8 of half a second
    assert sensing.rest is not None
    turn = turned_imu.description.imu.T_body_imu[:3, :3]
    np.testing.assert_allclose(sensing.rest.angular_velocity, turn @ rate, atol=1e-15)
    assert sensing.rest.span_s == pytest.approx(0.5)


def test_a_sample_of_another_robot_is_an_error(turned_imu: RobotModel) -> None:
    with pytest.raises(RobotModelError, match="has 18 joints, robot 'go1' has 12"):
        sensing_of(turned_imu).push(JointSample(0, np.zeros(18), np.zeros(18), np.zeros(18)), UP)


def test_means_turn_into_another_frame() -> None:
    rotation = so3.exp(np.array([0.3, -1.0, 2.0]))
    turned = REST.rotated(rotation)
    np.testing.assert_allclose(turned.specific_force, 9.81 * rotation[:, 2])
    assert (turned.stamp_ns, turned.sample_count, turned.span_s) == (0, 50, 0.5)


def test_an_estimator_starts_at_rest_or_when_it_has_waited_for_it() -> None:
    rule = StartRule(0.45)
    assert not rule.is_met(7, None)
    assert not rule.is_met(7 + 450 * MS - 1, None)
    assert rule.is_met(7 + 450 * MS, None)
    assert StartRule(0.45).is_met(7, REST)
    assert StartRule(0.0).is_met(7, None)

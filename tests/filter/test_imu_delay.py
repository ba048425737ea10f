# SPDX-License-Identifier: BSD-3-Clause
"""The delay of the gyroscope behind the joints: found by standing feet and by cameras, and taken into account."""

from dataclasses import replace

import numpy as np
import pytest

from coclo_vio.filter.config import FilterConfig
from coclo_vio.filter.imu_delay import ImuDelay
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.robot.contact import ContactState
from coclo_vio.robot.leg_sensing import Reading
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial
from coclo_vio.values.arrays import Array
from coclo_vio.values.measurements import ImuSample
from coclo_vio.values.units import NS_PER_S

UP = np.array([0.0, 0.0, 1.0])
BIAS = np.array([0.004, -0.003, 0.006])


def late_rates(trial: AnalyticTrial, delay_s: float) -> Array:
    """The body's angular velocity as a gyroscope that is late measures it, at the stamps of the joints, (N, 3)."""
    times_s = trial.truth.stamps_ns / NS_PER_S
    rates = trial.body.angular_velocity
    return np.column_stack([np.interp(times_s - delay_s, times_s, rates[:, axis]) for axis in range(3)])


def found(robot: RobotModel, trial: AnalyticTrial, delay_s: float, delay: ImuDelay) -> ImuDelay:
    for row, rate in enumerate(late_rates(trial, delay_s)):
        feet = robot.feet(trial.joint_position[row], trial.joint_velocity[row])
        contact = ContactState(trial.stance[row].astype(float), trial.stance[row], trial.load_n[row])
        reading = Reading(int(trial.truth.stamps_ns[row]), feet, contact, rate + BIAS, (), None, False)
        delay.push(reading, trial.body.rotation[row][2], 0.5 * BIAS)
    return delay


@pytest.mark.parametrize("delay_s", [-0.004, 0.0, 0.003, 0.008])
def test_standing_feet_measure_the_delay_whatever_the_bias(
    daisy: RobotModel, clean_walk: AnalyticTrial, delay_s: float
) -> None:
    delay = found(daisy, clean_walk, delay_s, ImuDelay(daisy.foot_radii_m, 1e-4, 0.001, 0.02))
    assert delay.value_s == pytest.approx(delay_s, abs=0.0008)
    assert delay.by_legs_s == delay.value_s


def test_what_is_expected_counts_against_legs_that_may_bend(daisy: RobotModel, clean_walk: AnalyticTrial) -> None:
    delay = found(daisy, clean_walk, 0.008, ImuDelay(daisy.foot_radii_m, 1e-4, 0.003, 0.003))
    assert 0.0045 < delay.value_s < 0.0065


def test_cameras_decide_where_they_measure_the_delay(daisy: RobotModel, clean_walk: AnalyticTrial) -> None:
    delay = found(daisy, clean_walk, 0.008, ImuDelay(daisy.foot_radii_m, 1e-4, 0.003, 0.003))
    before_s = delay.by_legs_s
    delay.measure(0.002, 0.0005)
    assert delay.value_s == pytest.approx(0.0026, abs=0.0006)
    assert delay.by_legs_s == before_s


def test_a_known_delay_stays(daisy: RobotModel, clean_walk: AnalyticTrial) -> None:
    delay = found(daisy, clean_walk, 0.008, ImuDelay(daisy.foot_radii_m, 1e-4, 0.002, 0.0))
    delay.measure(0.005, 1e-4)
    assert delay.value_s == 0.002


def test_a_pause_of_the_gyroscope_begins_a_new_interval(daisy: RobotModel, clean_walk: AnalyticTrial) -> None:
    delay = ImuDelay(daisy.foot_radii_m, 1e-4, 0.0, 0.02)
    for row, rate in enumerate(late_rates(clean_walk, 0.005)):
        feet = daisy.feet(clean_walk.joint_position[row], clean_walk.joint_velocity[row])
        contact = ContactState(clean_walk.stance[row].astype(float), clean_walk.stance[row], clean_walk.load_n[row])
        measured = None if row % 7 == 0 else rate
        delay.push(Reading(int(clean_walk.truth.stamps_ns[row]), feet, contact, measured, (), None, False), UP, BIAS)
    assert delay.value_s == 0.0


def rotation_error_rad(robot: RobotModel, trial: AnalyticTrial, delay_s: float, **robust: float) -> float:
    """Root mean square error of the filter's rotation over 0.2 s, with a gyroscope that is late."""
    odometry = LegOdometryFilter(robot, FilterConfig.of_robot(robot.description, {"robust": robust}))
    rates = dict(zip(trial.truth.stamps_ns.tolist(), late_rates(trial, delay_s), strict=True))
    truth = dict(zip(trial.truth.stamps_ns.tolist(), trial.body.rotation, strict=True))
    rows = []
    for one in trial.measurements:
        is_late = isinstance(one, ImuSample) and one.stamp_ns in rates
        estimate = odometry.push(replace(one, angular_velocity=rates[one.stamp_ns]) if is_late else one)
        if estimate is not None:
            rows.append((estimate.nav.T_world_body[:3, :3], truth[estimate.stamp_ns]))
    by_filter, true = (np.array(each) for each in zip(*rows, strict=True))
    moved, expected = (np.swapaxes(each[:-20], 1, 2) @ each[20:] for each in (by_filter, true))
    return float(np.sqrt(np.mean(np.square(np.swapaxes(moved, 1, 2) @ expected - np.eye(3)))))


def test_the_filter_integrates_late_rates_without_the_lag(daisy: RobotModel, clean_walk: AnalyticTrial) -> None:
    late_s = 0.006
    ignored = rotation_error_rad(daisy, clean_walk, late_s, imu_delay_s=0.0, imu_delay_sigma_s=0.0)
    known = rotation_error_rad(daisy, clean_walk, late_s, imu_delay_s=late_s, imu_delay_sigma_s=0.0)
    sought = rotation_error_rad(daisy, clean_walk, late_s, imu_delay_s=0.0, imu_delay_sigma_s=0.02)
    assert known < 0.3 * ignored
    assert sought < 0.6 * ignored

# SPDX-License-Identifier: BSD-3-Clause
"""What standing feet would measure, by the compiled form against the formulas in matrices."""

import numpy as np
import pytest

from coclo_vio.geometry import so3
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.foot_motion_model import FootMotionModel
from coclo_vio.robot.model import RobotModel

UP = np.array([0.1, -0.2, np.sqrt(0.95)])


@pytest.mark.parametrize("name", ["go1", "daisy"])
def test_it_equals_the_formulas_in_matrices(name: str) -> None:
    robot, rng = RobotModel(load_robot(name)), np.random.default_rng(5)
    count = len(robot.joint_names)
    feet = robot.feet(rng.normal(scale=0.4, size=count), rng.normal(size=count))
    rate = rng.normal(size=3)
    found = FootMotionModel(robot).at(7, feet, rate, None, UP, is_stationary=False)
    turning, linear = so3.hat(rate), feet.jacobian[:, 3:]
    rolling = (rate + feet.angular_velocity_body) @ so3.hat(UP)  # rows: (rate of the foot) x up
    expected = robot.foot_radii_m[:, None] * rolling - feet.velocity_body - feet.position_body @ turning.T
    variance = robot.description.joint_velocity_noise_radps**2 / 3.0 * np.einsum("nij,nij->n", linear, linear)
    np.testing.assert_allclose(found.body_velocity, expected, atol=1e-13)
    np.testing.assert_allclose(found.velocity_variance, variance, rtol=1e-12)
    np.testing.assert_allclose(found.depth_m, robot.foot_radii_m - feet.position_body @ UP, atol=1e-14)
    np.testing.assert_allclose(found.foot_speed, np.linalg.norm(feet.velocity_body, axis=1), atol=1e-14)
    np.testing.assert_allclose(found.imu_turning, turning @ robot.description.imu.position_body_m, atol=1e-15)


def test_an_unknown_leg_has_no_numbers_and_leaves_the_others() -> None:
    robot = RobotModel(load_robot("go1"))
    position = np.full(12, 0.3)
    position[4] = np.nan
    found = FootMotionModel(robot).at(7, robot.feet(position, np.zeros(12)), None, None, UP, is_stationary=False)
    assert np.isnan(found.body_velocity).all(axis=1).tolist() == [False, True, False, False]
    assert np.isnan(found.depth_m).tolist() == [False, True, False, False]

# SPDX-License-Identifier: BSD-3-Clause
"""Without noise the filter does not drift: what is left is the third order of the rolling increment in the step.

Sensors are perfect and modelled so; no foot is expected to creep. Gravity is not used while the body
accelerates, and standstill ends with the first motion: both are approximations on purpose, with their own noise.
"""

import numpy as np
import pytest

from coclo_vio.filter.config import FilterConfig, InitialConfig, RobustConfig
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.robot.standstill import StandstillConfig
from coclo_vio.simulation.analytic import AnalyticTrial, AnalyticTrialConfig, SensorNoiseConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig

TINY = 1e-7
CERTAIN = FilterConfig(
    robust=RobustConfig(
        angular_acceleration_density=0.5,
        foothold_creep=1e-8,
        foot_position_noise_m=1e-8,
        foot_velocity_noise_mps=1e-3,
        gate_probability=1.0 - 1e-16,
        gravity_noise_mps2=1e6,
        estimates_leg_scale=False,
        estimates_leg_compliance=False,
        slip_share=0.0,
        slip_turn_per_m=0.0,
    ),
    initial=InitialConfig(
        gyroscope_bias_radps=TINY, accelerometer_bias_mps2=TINY, rest_force_noise_mps2=TINY, rest_rate_noise_radps=TINY
    ),
    standstill=StandstillConfig(joint_speed_radps=1e-6, gyroscope_std_radps=1e-6, accelerometer_std_mps2=1e-6),
)


@pytest.fixture(scope="module")
def certain_daisy() -> RobotModel:
    description = load_robot("daisy")
    imu = description.imu.model_copy(
        update={
            "gyroscope_noise_density": TINY,
            "gyroscope_bias_walk": 1e-8,
            "accelerometer_noise_density": 1e-5,
            "accelerometer_bias_walk": 1e-8,
        }
    )
    noise = {"encoder_noise_rad": 1e-8, "joint_velocity_noise_radps": 1e-6, "imu": imu}
    return RobotModel(description.model_copy(update=noise))


def walked(robot: RobotModel, rate_hz: float, walk_s: float) -> AnalyticTrial:
    body = BodyMotionConfig(rest_s=1.0, walk_s=walk_s, stop_s=0.5, speed_mps=0.2)
    config = AnalyticTrialConfig(rate_hz=rate_hz, body=body, sensors=SensorNoiseConfig(noise_scale=0.0))
    return generate(config, robot, seed=1)


def drift_m(robot: RobotModel, trial: AnalyticTrial) -> float:
    """Distance of the last estimate from the truth; the truth starts level, at its own origin."""
    odometry = LegOdometryFilter(robot, CERTAIN)
    estimates = [estimate for estimate in map(odometry.push, trial.measurements) if estimate is not None]
    assert "leg_rejected" not in odometry.counts
    moved = trial.truth.positions[-1] - trial.truth.positions[0]
    return float(np.linalg.norm(estimates[-1].nav.T_world_body[:3, 3] - moved))


def test_one_metre_without_noise_is_one_metre(certain_daisy: RobotModel) -> None:
    trial = walked(certain_daisy, rate_hz=100.0, walk_s=6.0)
    assert trial.truth.path_length_m() > 1.0
    assert drift_m(certain_daisy, trial) < 3e-7


@pytest.mark.slow
def test_ten_metres_without_noise_are_ten_metres(certain_daisy: RobotModel) -> None:
    trial = walked(certain_daisy, rate_hz=200.0, walk_s=51.0)
    assert trial.truth.path_length_m() > 10.0
    assert drift_m(certain_daisy, trial) < 1e-6

# SPDX-License-Identifier: BSD-3-Clause
"""Consistency of the filter: NEES of pose and of relative motion over seeds of the analytic trial.

The filter's noise is the generator's: no foot slips there, so the noise for slip and bending is small, and the
robot's own parameters are used for encoders, joint velocities and IMU. The leg scale is not estimated.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from coclo_vio.evaluation.consistency import anees, nees
from coclo_vio.filter.config import FilterConfig, InitialConfig, RobustConfig
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.geometry import se3, so3
from coclo_vio.robot.model import RobotModel
from coclo_vio.robot.standstill import StandstillConfig
from coclo_vio.simulation.analytic import AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.keyframes import relative_motion

BODY = BodyMotionConfig(rest_s=0.6, walk_s=4.4, stop_s=0.0, ramp_s=0.6, speed_mps=0.18, curvature_per_m=0.3)
MATCHED = FilterConfig(
    robust=RobustConfig(
        estimates_leg_scale=False,
        estimates_leg_compliance=False,
        slip_share=0.0,
        slip_turn_per_m=0.0,
        foothold_creep=2e-5,
        foot_position_noise_m=1e-5,
        foot_velocity_noise_mps=1e-3,
        step_deflection_s=0.0,
    ),
    initial=InitialConfig(accelerometer_bias_mps2=0.05, camera_rotation_sigma_rad=0.0, stereo_scale_sigma=0.0),
    standstill=StandstillConfig(window_s=0.4, gyroscope_std_radps=0.006, joint_speed_radps=0.065),
)
INTERVAL = 100  # samples: one second


@dataclass
class Nees:
    pose: np.ndarray
    delta: np.ndarray


def nees_of(robot: RobotModel, config: FilterConfig, seed: int) -> Nees:
    """Of the pose in the frame of the first estimate and of the motion since the last keyframe, once a second."""
    trial = generate(AnalyticTrialConfig(body=BODY, substeps=1), robot, seed)
    odometry, keyframe = LegOdometryFilter(robot, config, remembers_frames=True), None
    truth_at = dict(zip(trial.truth.stamps_ns.tolist(), trial.truth.T_world_body, strict=True))
    errors, covariances, delta_errors, delta_covariances = [], [], [], []
    start = np.eye(4)
    count = 0
    for measurement in trial.measurements:
        estimate = odometry.push(measurement)
        if estimate is None:
            continue
        T_true = truth_at[estimate.stamp_ns]
        if keyframe is None:
            start = se3.transform(so3.about_z(float(so3.yaw(T_true[:3, :3]))), T_true[:3, 3])
            keyframe = odometry.mark_frame(estimate.stamp_ns).anchor()
        elif count % INTERVAL == 0:
            T_start_body = se3.inverse(start) @ T_true
            errors.append(se3.log(se3.inverse(estimate.nav.T_world_body) @ T_start_body))
            covariances.append(estimate.covariance[:6, :6])
            pair = keyframe.mark_frame(estimate.stamp_ns)
            delta = relative_motion(pair.poses(), floor_m=0.0)
            T_true_delta = se3.inverse(truth_at[delta.start_ns]) @ T_true
            delta_errors.append(se3.log(se3.inverse(delta.T_start_end) @ T_true_delta))
            delta_covariances.append(delta.covariance)
            keyframe = pair.keep()
        count += 1
    return Nees(
        nees(np.array(errors), np.array(covariances)), nees(np.array(delta_errors), np.array(delta_covariances))
    )


def over_seeds(robot: RobotModel, config: FilterConfig, seeds: range) -> tuple[float, float]:
    """ANEES of pose and of relative motion."""
    runs = [nees_of(robot, config, seed) for seed in seeds]
    pose = anees(np.concatenate([run.pose for run in runs]), dof=6)
    delta = anees(np.concatenate([run.delta for run in runs]), dof=6)
    assert pose is not None
    assert delta is not None
    return pose, delta


@pytest.mark.long
def test_anees_with_the_generators_noise(daisy: RobotModel) -> None:
    pose, delta = over_seeds(daisy, MATCHED, range(4))
    assert 0.5 < pose < 2.0
    assert 0.5 < delta < 2.0


@pytest.mark.slow
def test_anees_with_the_generators_noise_over_fifty_seeds(daisy: RobotModel) -> None:
    pose, delta = over_seeds(daisy, MATCHED, range(100, 150))
    assert 0.5 < pose < 2.0
    assert 0.5 < delta < 2.0

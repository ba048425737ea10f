# SPDX-License-Identifier: BSD-3-Clause
"""GTSAM's legged fixed-lag smoother in the place of its filter: exact sensors, its own rate, and its failure."""

import numpy as np
import pytest

from coclo_vio.backend.config import FootholdNoiseConfig
from coclo_vio.backend.foothold_smoother import STEP_S, FootholdSmoother, SmoothedLegOdometry
from coclo_vio.backend.inekf import InvariantConfig
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrialConfig, SensorNoiseConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.errors import SmootherError


def standing() -> FootholdSmoother:
    """A smoother of two feet that has just started, level and at rest."""
    return FootholdSmoother(
        FootholdNoiseConfig(),
        np.eye(4),
        ("left", "right"),
        rotation_world_body=np.eye(3),
        gyroscope_bias=np.zeros(3),
        tilt_rad=0.02,
        velocity_mps=0.02,
    )


@pytest.mark.long
def test_with_rolling_compensated_perfect_sensors_drift_little() -> None:
    robot = RobotModel(load_robot("go1"))
    walking, perfect = BodyMotionConfig(walk_s=4.0), SensorNoiseConfig(noise_scale=0.0)
    trial = generate(AnalyticTrialConfig(body=walking, sensors=perfect, substeps=1), robot, seed=11)
    estimator = SmoothedLegOdometry(robot, InvariantConfig(rolling_feet=True))
    estimates = [found for sample in trial.measurements if (found := estimator.push(sample)) is not None]
    truth = trial.truth.positions[-len(estimates) :]
    moved = estimates[-1].nav.T_world_body[:3, 3] - estimates[0].nav.T_world_body[:3, 3]
    assert np.linalg.norm(truth[-1] - truth[0]) > 0.5
    assert np.linalg.norm(moved - (truth[-1] - truth[0])) < 0.01 * np.linalg.norm(truth[-1] - truth[0])


def test_feet_correct_it_once_a_step_and_not_in_between() -> None:
    smoother = standing()
    feet, both = np.array([[0.0, 0.1, -0.3], [0.0, -0.1, -0.3]]), np.array([True, True])
    for _ in range(3):
        smoother.predict(0.4 * STEP_S, np.zeros(3), np.array([0.0, 0.0, 9.81]))
        assert not smoother.is_stance.any()
        smoother.correct(feet, both)
    assert smoother.is_stance.all()


def test_its_failure_names_the_next_step() -> None:
    smoother = standing()
    smoother.predict(STEP_S, np.full(3, np.nan), np.full(3, np.nan))
    with pytest.raises(SmootherError, match=r"LeggedFixedLagSmoother failed: .*take the mode inekf"):
        smoother.correct(np.array([[0.0, 0.1, -0.3], [0.0, -0.1, -0.3]]), np.array([True, True]))

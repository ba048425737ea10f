# SPDX-License-Identifier: BSD-3-Clause
"""The measurements of a robot of six legs at its defaults."""

import numpy as np

from coclo_vio.filter import measurement_model
from coclo_vio.filter.config import RobustConfig
from coclo_vio.filter.stance import FootMotion, Reading
from coclo_vio.filter.state import State
from coclo_vio.robot.model import RobotModel


def blocks_of(robot: RobotModel, reading: Reading, motion: FootMotion, mean: State) -> list[measurement_model.Block]:
    """Gyroscope, velocities, positions."""
    noise_radps = robot.description.joint_velocity_noise_radps
    sensing = measurement_model.LegConstants(robot.foot_radii_m, robot.hip_position_body, noise_radps, RobustConfig())
    return measurement_model.blocks(
        sensing,
        reading,
        motion,
        mean,
        foot_noise=np.tile(np.eye(3), (6, 1, 1)),
        foot_velocity_noise_mps=np.full(6, 0.05),
        gyroscope_noise_radps=1e-3,
    )

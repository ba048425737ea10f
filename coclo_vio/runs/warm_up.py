# SPDX-License-Identifier: BSD-3-Clause
"""Kernels loaded before the first message comes: the first samples would wait for them, seconds in a fresh install."""

from contextlib import suppress

import numpy as np

from coclo_vio.robot.description import RobotDescription
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs.equipment import Equipment
from coclo_vio.runs.guarding import guarded
from coclo_vio.runs.modes.registry import mode_of
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.errors import CocloError
from coclo_vio.values.measurements import LEG_SENSORS, FootForceSample, ImuSample, JointSample
from coclo_vio.values.units import NS_PER_S

_STEPS = 60
_STEP_NS = NS_PER_S // 100


def warm_up(config: RunConfig) -> None:
    """Run leg odometry on a robot at rest for 0.6 s, and forget it; nothing without a robot."""
    robot = config.robot
    if robot is None:
        return
    with suppress(CocloError):
        equipment = Equipment(RobotModel(robot), robot.imu, None, None, LEG_SENSORS, "a robot at rest")
        estimator = guarded(mode_of("coclo"), equipment, config)
        for sample in _at_rest(robot):
            estimator.push(sample)


def _at_rest(robot: RobotDescription) -> "list[ImuSample | FootForceSample | JointSample]":
    joints, legs = len(robot.joint_names), len(robot.legs)
    zero, up = np.zeros(3), np.array([0.0, 0.0, 9.81])
    samples: list[ImuSample | FootForceSample | JointSample] = []
    for number in range(_STEPS):
        at_ns = NS_PER_S + number * _STEP_NS
        samples += [
            FootForceSample(at_ns, np.full(legs, 100.0)),
            ImuSample(at_ns, zero, up),
            JointSample(at_ns, np.full(joints, 0.1), np.zeros(joints), np.zeros(joints)),
        ]
    return samples

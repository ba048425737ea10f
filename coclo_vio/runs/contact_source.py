# SPDX-License-Identifier: BSD-3-Clause
"""Contact by the motion of the feet where a recording has neither joint torques nor foot forces."""

import numpy as np

from coclo_vio.datasets.dataset import Dataset
from coclo_vio.robot.description import RobotDescription
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.errors import CocloError
from coclo_vio.values.measurements import FootForceSample, JointSample
from coclo_vio.values.units import NS_PER_S

_SECONDS = 20.0  # of the recording that are searched for a load


def with_contact_source(config: RunConfig, dataset: Dataset) -> RunConfig:
    """The same run, with ``robot.contact.source=kinematic`` where nothing else states which feet stand.

    Args:
        config: resolved configuration.
        dataset: the recording.
    """
    robot = config.robot
    if robot is None or not robot.contact.needs_load or _has_load(dataset):
        return config
    return config.model_copy(update={"robot": by_motion(robot)})


def by_motion(robot: RobotDescription) -> RobotDescription:
    """The same robot, whose contact is by the motion of its feet."""
    return robot.model_copy(update={"contact": robot.contact.model_copy(update={"source": "kinematic"})})


def _has_load(dataset: Dataset) -> bool:
    """Whether the first seconds have any torque or foot force, or no joints at all."""
    first_ns, has_joints = None, False
    try:
        for sample in dataset.measurements(frozenset({JointSample, FootForceSample})):
            first_ns = sample.stamp_ns if first_ns is None else first_ns
            if isinstance(sample, FootForceSample):
                if np.isfinite(sample.force).any():
                    return True
            elif isinstance(sample, JointSample):
                has_joints = True
                if np.isfinite(sample.effort).any():
                    return True
            if sample.stamp_ns - first_ns > _SECONDS * NS_PER_S:
                break
    except CocloError:  # whoever reads it reports the error
        return True
    return not has_joints

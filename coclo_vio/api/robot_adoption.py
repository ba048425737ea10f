# SPDX-License-Identifier: BSD-3-Clause
"""A robot's description from its URDF and a log."""

from collections.abc import Sequence
from pathlib import Path

from coclo_vio.adoption.adopt import adopt as adopt_robot
from coclo_vio.adoption.adoption import Adoption
from coclo_vio.runs.run_config import resolve


def adopt(
    urdf: str | Path, recording: str | Path, output: str | Path | None = None, *, settings: Sequence[str] = ()
) -> Adoption:
    """Find legs, joints, contact and IMU of a robot in its URDF and a log of it; ground truth is not opened.

    Args:
        urdf: the robot's URDF file.
        recording: a log of its joints and IMU, best with a stand, some steps and a turn.
        output: YAML file to write the description to, for ``open(..., robot=output)``.
        settings: how the recording is read, such as ``"dataset.rosbag.clock=received"``.

    Raises:
        RobotModelError: the URDF cannot be read, or has no legs.
        DatasetError: the recording cannot be read, or its joints cannot be matched.
        ConfigError: a setting is wrong, or the YAML cannot be written.
    """
    adoption = adopt_robot(Path(urdf), Path(recording), resolve(settings=settings).dataset)
    if output is not None:
        adoption.write(Path(output))
    return adoption

# SPDX-License-Identifier: BSD-3-Clause
"""The motion capture of a trial: noise, a clock of its own, and dropouts."""

from typing import Annotated

import numpy as np
from pydantic import Field

from coclo_vio.geometry import se3, so3
from coclo_vio.simulation.trial.motion import Motion
from coclo_vio.simulation.trial.sensors import sample_times
from coclo_vio.values.config import StageConfig
from coclo_vio.values.trajectory import GroundTruth, Trajectory
from coclo_vio.values.units import NS_PER_S


class ViconConfig(StageConfig):
    """Optical motion capture with three cameras. Noise is of the order that users of such systems report."""

    rate_hz: Annotated[float, Field(gt=1, le=1000, description="poses a second, Hz")] = 100.0
    position_noise_m: Annotated[float, Field(ge=0, description="white, each axis, m")] = 0.0005
    rotation_noise_rad: Annotated[float, Field(ge=0, description="white, each axis, rad (0.06 deg)")] = 0.001
    clock_offset_s: Annotated[
        float, Field(ge=0, le=10, description="half width of the uniform offset of its clock from the robot's, s")
    ] = 0.3
    dropout_every_s: Annotated[float, Field(gt=0, description="mean time between losses of the markers, s")] = 20.0
    dropout_s: Annotated[float, Field(ge=0, le=10, description="mean length of a loss, s")] = 0.3


def vicon_poses(motion: Motion, config: ViconConfig, generator: np.random.Generator) -> tuple[GroundTruth, float]:
    """The poses of the body as the motion capture measures them, in its own world and on its own clock.

    Its world is turned about z and shifted against that of the terrain, as that of any real motion capture.

    Returns:
        The poses, and the time by which its clock is ahead of the robot's, s.
    """
    offset_s = float(generator.uniform(-config.clock_offset_s, config.clock_offset_s))
    yaw, shift = float(generator.uniform(-np.pi, np.pi)), generator.uniform(-2.0, 2.0, 2)
    T_vicon_world = se3.transform(so3.about_z(yaw), np.array([*shift, 0.0]))
    stamps, offsets = sample_times(float(motion.time_s[-1]), config.rate_hz)
    steps = np.round(offsets / NS_PER_S / (motion.time_s[1] - motion.time_s[0])).astype(np.int64)
    poses = T_vicon_world @ motion.T_world_body[steps]
    poses[:, :3, 3] += config.position_noise_m * generator.standard_normal((len(poses), 3))
    poses[:, :3, :3] = poses[:, :3, :3] @ so3.exp(
        config.rotation_noise_rad * generator.standard_normal((len(poses), 3))
    )
    is_tracked = np.ones(len(poses), dtype=np.bool_)
    time_s = 2.0  # no dropout while the robot stands at the beginning
    while config.dropout_s > 0.0:
        time_s += float(generator.exponential(config.dropout_every_s))
        length_s = float(generator.exponential(config.dropout_s))
        first = int(time_s * config.rate_hz)
        if first >= len(is_tracked):
            break
        is_tracked[first : first + max(1, round(length_s * config.rate_hz))] = False
        time_s += length_s
    shifted = stamps[is_tracked] + round(offset_s * NS_PER_S)
    return GroundTruth(Trajectory(shifted, poses[is_tracked]), has_stamps=True, source="simulated Vicon"), offset_s

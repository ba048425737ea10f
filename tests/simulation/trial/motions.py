# SPDX-License-Identifier: BSD-3-Clause
"""Motions whose readings are known by hand, in the form that the physics records."""

import numpy as np

from coclo_vio.simulation.trial.physics import Motion
from coclo_vio.values.arrays import Array

STEP_S = 0.001
JOINTS, LEGS = 18, 6


def motion(
    seconds: float,
    *,
    rate: Array | float = 0.0,
    specific_force: Array | float = 0.0,
    angle: Array | float = 0.0,
    velocity: Array | float = 0.0,
    torque: Array | float = 0.0,
    poses: Array | None = None,
) -> Motion:
    """At 1 kHz; each signal a number, a vector, or a row for each step."""
    time_s = times(seconds)
    count = len(time_s)

    def rows(signal: Array | float, width: int) -> Array:
        return np.array(np.broadcast_to(signal, (count, width)), dtype=float)

    readings = np.hstack((rows(rate, 3), rows(specific_force, 3)))
    return Motion(
        time_s=time_s,
        qpos=np.zeros((count, 7)),
        qvel=np.zeros((count, 6)),
        joint_position=rows(angle, JOINTS),
        joint_velocity=rows(velocity, JOINTS),
        spring_torque=rows(torque, JOINTS),
        imus={"imu": readings},
        foot_force=np.zeros((count, LEGS)),
        T_world_body=np.tile(np.eye(4), (count, 1, 1)) if poses is None else poses,
        velocity_world=np.zeros((count, 3)),
        angular_velocity_body=np.zeros((count, 3)),
        self_contacts=0,
        ground_contacts=0,
        max_penetration_m=0.0,
    )


def times(seconds: float) -> Array:
    """Steps of the physics from 0 on, s; the last is at ``seconds``."""
    return STEP_S * np.arange(round(seconds / STEP_S) + 1)

# SPDX-License-Identifier: BSD-3-Clause
"""Motions whose readings are known by hand, in the form that the physics records."""

import numpy as np

from coclo_vio.geometry import so3
from coclo_vio.simulation.trial.motion import Motion
from coclo_vio.values.arrays import Array
from coclo_vio.values.units import GRAVITY_MPS2

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
    """At 1 kHz; each signal a number, a vector, or a row for each step. Without ``poses`` the attitude stays zero."""
    time_s = times(seconds)
    count = len(time_s)

    def rows(signal: Array | float, width: int) -> Array:
        return np.array(np.broadcast_to(signal, (count, width)), dtype=float)

    placed = np.tile(np.eye(4), (count, 1, 1)) if poses is None else poses
    quaternions = so3.to_quat_xyzw(placed[:, :3, :3])[:, [3, 0, 1, 2]]
    acceleration = rows(specific_force, 3) - [0.0, 0.0, GRAVITY_MPS2]
    return Motion(
        time_s=time_s,
        qpos=np.hstack((placed[:, :3, 3], quaternions, rows(angle, JOINTS))),
        qvel=np.hstack((np.zeros((count, 3)), rows(rate, 3), rows(velocity, JOINTS))),
        trunk_acceleration=np.hstack((acceleration, np.zeros((count, 3)))),
        joint_columns=np.arange(7, 7 + JOINTS),
        joint_velocity_columns=np.arange(6, 6 + JOINTS),
        spring_torque=rows(torque, JOINTS),
        foot_force=np.zeros((count, LEGS)),
        self_contacts=0,
        ground_contacts=0,
        max_penetration_m=0.0,
    )


def times(seconds: float) -> Array:
    """Steps of the physics from 0 on, s; the last is at ``seconds``."""
    return STEP_S * np.arange(round(seconds / STEP_S) + 1)

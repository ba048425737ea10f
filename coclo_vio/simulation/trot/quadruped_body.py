# SPDX-License-Identifier: BSD-3-Clause
"""What the controller knows of the described robot: mass, inertia, neutral feet, and the angles in which it stands."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.trot.quadruped import Quadruped
from coclo_vio.values.arrays import Array

_BEND_RAD = 0.75  # of the thigh, from which the standing angles are solved
_NEWTON_STEPS = 60
_HALF_EXTENT_M = 0.6  # of the trunk to its length between the hips, for its inertia


@dataclass(frozen=True, slots=True, eq=False)
class QuadrupedBody:
    """The described robot as the controller knows it.

    Attributes:
        mass_kg: of the whole robot.
        inertia: moments about the body's axes, kg m^2, (3,).
        neutral_feet: below the hips, body frame, m; z is zero, (legs, 3).
        foot_radius_m: mean of all feet.
        standing: joint angles in which it stands, rad, (joints,).
    """

    mass_kg: float
    inertia: Array
    neutral_feet: Array
    foot_radius_m: float
    standing: Array

    @classmethod
    def of(cls, robot: RobotModel, parts: Quadruped, height_m: float) -> "QuadrupedBody":
        """From the robot's description, for a height of its trunk."""
        hips, count = robot.hip_position_body, len(robot.leg_names)
        front = np.where(hips[:, 0] > 0.0, 1.0, -1.0) if parts.are_knees_opposed else np.ones(count)
        joints = np.zeros((count, 3))
        straight = robot.feet(joints.ravel(), np.zeros(3 * count)).position_body
        wanted = np.column_stack((hips[:, 0], straight[:, 1], robot.foot_radii_m - height_m))
        joints[:, 1], joints[:, 2] = _BEND_RAD * front, -2.0 * _BEND_RAD * front
        angles = joints.ravel()
        for _ in range(_NEWTON_STEPS):
            feet = robot.feet(angles, np.zeros_like(angles))
            for leg, own in enumerate(robot.leg_joint_slices):
                J = feet.jacobian[leg, 3:, own]
                step = J.T @ np.linalg.solve(J @ J.T + 1e-5 * np.eye(3), wanted[leg] - feet.position_body[leg])
                angles[own] += np.clip(step, -0.2, 0.2)
        half = np.array([np.ptp(hips[:, 0]), np.ptp(straight[:, 1]), height_m]) * _HALF_EXTENT_M
        inertia = robot.mass_kg / 3.0 * (half @ half - half**2)
        neutral = wanted * [1.0, 1.0, 0.0]
        return cls(robot.mass_kg, inertia, neutral, float(robot.foot_radii_m.mean()), angles)

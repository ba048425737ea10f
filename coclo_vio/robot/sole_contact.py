# SPDX-License-Identifier: BSD-3-Clause
"""Where a flat foot touches the ground: its middle while it stands flat, its heel, toe or edge while it rocks.

A foot that rocks on its toe rotates about the toe, and its middle moves although it stands. So the point of a sole that
is taken to be at rest is the mean of its corners, those weighted that are lowest: with ``h_k`` the height of corner
``v_k`` over the lowest one,

    c = sum(w_k v_k) / sum(w_k),  w_k = exp(-h_k / h_0).

On the ground ``c`` is the middle of the sole, on an edge that edge's. It goes from one to the other as the foot
rotates, and the foothold goes with it: by the same displacement, so that no measurement is lost. For a foot of radius
zero it is what rolling is for a sphere. Up is the world's: a foot that stands flat on a slope is taken to stand on its
lower edge, which makes no difference while it does not rotate.
"""

import numpy as np

from coclo_vio.geometry import so3
from coclo_vio.robot.model import FeetKinematics, RobotModel
from coclo_vio.values.arrays import Array

_HEIGHT_M = 0.003


class SoleContact:
    """The feet at the points where they touch the ground; those that are not flat, or of unknown shape, stay.

    Args:
        robot: the legs.
    """

    def __init__(self, robot: RobotModel) -> None:
        self._soles = [(leg, sole) for leg, sole in enumerate(robot.soles) if sole is not None and len(sole)]
        self._point_foot: Array = np.zeros((len(robot.leg_names), 3))
        self._rotation_body_foot: Array = np.tile(np.eye(3), (len(robot.leg_names), 1, 1))

    def __bool__(self) -> bool:
        """Whether there is a foot whose corners are known."""
        return bool(self._soles)

    def moved(self, feet: FeetKinematics, up_body: Array) -> tuple[FeetKinematics, Array]:
        """The kinematics of the points of contact, and how far these went along the foot since the last call.

        Args:
            feet: at their centres.
            up_body: upward direction in the body frame, (3,).

        Returns:
            The feet; and displacements, m, (2, n, 3), in the body axes of the last call and of this one. As the foot
            pivots about the middle of the two points, half of each counts in the world: with one of them alone the
            noise of the encoders, which is in rotation and displacement, would lift the foothold.
        """
        position, velocity, jacobian = feet.position_body.copy(), feet.velocity_body.copy(), feet.jacobian.copy()
        shift = np.zeros((2, *position.shape))
        for leg, sole in self._soles:
            rotation = feet.rotation_body_foot[leg]
            if np.isnan(rotation[0, 0]):
                continue
            heights = sole @ (rotation.T @ up_body)
            weights = np.exp((heights.min() - heights) / _HEIGHT_M)
            point = weights @ sole / weights.sum()
            arm = rotation @ point
            position[leg] += arm
            velocity[leg] += np.cross(feet.angular_velocity_body[leg], arm)
            jacobian[leg, 3:] -= so3.hat(arm) @ jacobian[leg, :3]
            step = point - self._point_foot[leg]
            shift[0, leg], shift[1, leg] = self._rotation_body_foot[leg] @ step, rotation @ step
            self._point_foot[leg], self._rotation_body_foot[leg] = point, rotation
        moved = FeetKinematics(position, velocity, feet.angular_velocity_body, feet.rotation_body_foot, jacobian)
        return moved, shift

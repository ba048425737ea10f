# SPDX-License-Identifier: BSD-3-Clause
"""The frame in which cameras measure poses, with the constant errors that relate it to the world of the filter.

Cameras measure motion from the first frame on, the anchor. Two kinds of error are constant and change coordinates
only: those of the cameras' mounting and stereo scale (``remembered_poses.as_measured``), and the tilt of the anchor.
Cameras cannot measure the tilt, and gravity measures it later and later. A window whose poses turn with every better
estimate of it, while its prior stays linear where it was, takes that turn for information. With the tilt as a state of
its own the poses stay where they are.
"""

from dataclasses import dataclass

import numpy as np

from coclo_vio.filter.remembered_poses import as_measured, as_true
from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array

ERRORS = 6  # mounting (3), stereo scale (1), tilt of the anchor (2)
CAMERA, TILT = slice(0, 4), slice(4, 6)
_HORIZONTAL = np.eye(3)[:, :2]


@dataclass(frozen=True, slots=True, eq=False)
class CameraFrame:
    """Coordinates of poses as cameras measure them.

    Attributes:
        anchor: pose of the body at the first frame as it was estimated then, (4, 4): a fixed choice of coordinates.
        errors: of the cameras, as in ``as_measured``, (4,), and rotation of the anchor about the world's x and y axes
            since then, rad, (2,).
    """

    anchor: Array
    errors: Array

    @property
    def tilted_anchor(self) -> Array:
        """Pose of the anchor as it is estimated now, (4, 4)."""
        tilted = self.anchor.copy()
        tilted[:3, :3] = so3.exp(_HORIZONTAL @ self.errors[TILT]) @ self.anchor[:3, :3]
        return tilted

    def true(self, T_measured: Array) -> Array:
        """The pose of the body in the world, (4, 4), that is measured as ``T_measured``, (4, 4)."""
        return np.asarray(self.tilted_anchor @ as_true(se3.inverse(self.anchor) @ T_measured, self.errors[CAMERA]))

    def measured(self, T_world_body: Array) -> tuple[Array, Array, Array]:
        """A pose of the body as the cameras measure it.

        Returns:
            The pose, (4, 4), the Jacobian of its right/local error by that of ``T_world_body``, (6, 6), and by the
            constant errors, (6, 6).
        """
        anchor = self.tilted_anchor
        from_anchor = se3.inverse(anchor) @ T_world_body
        measured, by_pose, by_camera = as_measured(from_anchor, self.errors[CAMERA])
        turned = np.zeros((6, 2))  # local error of the anchor by its tilt
        turned[:3] = anchor[:3, :3].T @ so3.right_jacobian(-_HORIZONTAL @ self.errors[TILT]) @ _HORIZONTAL
        by_errors = np.concatenate((by_camera, -by_pose @ se3.adjoint(se3.inverse(from_anchor)) @ turned), axis=1)
        return np.asarray(self.anchor @ measured), by_pose, by_errors

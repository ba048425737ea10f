# SPDX-License-Identifier: BSD-3-Clause
"""Axes of a camera that points forward: the body frame of recordings that have cameras and no robot.

Cameras are x right, y down, z forward; bodies x forward, y left, z up (REP 103).
"""

import numpy as np
from scipy.spatial.transform import Rotation

from coclo_vio.values.arrays import Array

_AXIS_ROTATIONS: Array = np.rint(Rotation.create_group("O").as_matrix()) + 0.0

R_BODY_CAMERA: Array = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Maps coordinates of an upright camera that points along the body's x axis to the body's."""


def nearest_body_axes(R_own_camera: Array) -> Array:
    """``R_own_body`` (3, 3): the body whose axes are those of frame ``own``, renamed where necessary.

    Of the 24 rotations that map the axes of a frame onto each other, the one whose x is nearest to the optical axis and
    whose z is nearest to the upward direction of the image; the identity for a frame that is x forward, y left, z up.

    Args:
        R_own_camera: maps camera coordinates to ``own``, (3, 3).
    """
    R_own_forward = R_own_camera @ R_BODY_CAMERA.T
    nearest: Array = _AXIS_ROTATIONS[np.argmax(np.einsum("nij,ij->n", _AXIS_ROTATIONS, R_own_forward))]
    return nearest.copy()

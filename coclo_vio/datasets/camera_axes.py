# SPDX-License-Identifier: BSD-3-Clause
"""Where a camera that looks ahead has its axes: a body for recordings that have cameras and no robot.

Cameras are x right, y down, z forward; bodies x forward, y left, z up (REP 103).
"""

import numpy as np
from scipy.spatial.transform import Rotation

from coclo_vio.values.arrays import Array

_QUARTER_TURNS: Array = np.rint(Rotation.create_group("O").as_matrix()) + 0.0

R_BODY_CAMERA: Array = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Maps the axes of a camera that looks along the body's x axis, upright, to the body's."""


def quarter_turns(R_own_camera: Array) -> Array:
    """``R_own_body`` (3, 3): the body whose axes are those of frame ``own``, by another name where need be.

    Of the 24 ways to turn a frame into itself the one that brings x nearest to where the camera looks and z nearest to
    what is up in its image; the identity for a frame that already is x forward, y left, z up.

    Args:
        R_own_camera: maps camera coordinates to ``own``, (3, 3).
    """
    wanted = R_own_camera @ R_BODY_CAMERA.T
    nearest: Array = _QUARTER_TURNS[np.argmax(np.einsum("nij,ij->n", _QUARTER_TURNS, wanted))]
    return nearest.copy()

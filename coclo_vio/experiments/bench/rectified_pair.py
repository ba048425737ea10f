# SPDX-License-Identifier: BSD-3-Clause
"""The rectified pair of cameras of the benchmark's synthetic worlds, 640 by 480."""

import numpy as np

from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import CameraCalibration, StereoCalibration, matrix4

WIDTH_PX, HEIGHT_PX, FOCAL_PX = 640, 480, 450.0
PRINCIPAL_POINT_PX = (WIDTH_PX / 2, HEIGHT_PX / 2)
LOOKS_AHEAD: Array = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""``R_body_camera`` of a camera that looks along x."""
LOOKS_LEFT: Array = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""``R_body_camera`` of a camera that looks along y."""


def rectified_pair(R_body_camera: Array, baseline_m: float) -> StereoCalibration:
    """Two equal cameras 0.1 m ahead of the body's origin.

    Args:
        R_body_camera: of both, (3, 3).
        baseline_m: from the left to the right one, m.
    """
    camera = CameraCalibration(
        width_px=WIDTH_PX, height_px=HEIGHT_PX, focal_px=(FOCAL_PX, FOCAL_PX), principal_point_px=PRINCIPAL_POINT_PX
    )
    left = se3.transform(R_body_camera, np.array([0.1, 0.0, 0.0]))
    right = left @ se3.transform(np.eye(3), np.array([baseline_m, 0.0, 0.0]))
    return StereoCalibration(
        left=camera, right=camera, body_left_camera=matrix4(left), body_right_camera=matrix4(right)
    )

# SPDX-License-Identifier: BSD-3-Clause
import numpy as np

from coclo_vio.datasets.camera_axes import R_BODY_CAMERA, nearest_body_axes
from coclo_vio.geometry import so3


def test_a_forward_camera_is_x_right_y_down_z_forward_of_its_body():
    forward, left, up = np.eye(3)
    np.testing.assert_array_equal(R_BODY_CAMERA, np.column_stack((-left, -up, forward)))
    assert np.linalg.det(R_BODY_CAMERA) == 1.0


def test_a_body_that_is_x_forward_keeps_its_axes_however_its_camera_is_tilted():
    for tilt in ([0.4, 0.0, 0.0], [0.0, -0.4, 0.3], [-0.2, 0.2, -0.4]):
        np.testing.assert_array_equal(nearest_body_axes(so3.exp(np.array(tilt)) @ R_BODY_CAMERA), np.eye(3))


def test_other_axes_are_renamed_without_moving_the_camera():
    R_own_ahead = np.array([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])  # looks along -x, upside down
    tilt = so3.exp(np.array([0.1, 0.2, -0.1]))
    R_own_body = nearest_body_axes(R_own_ahead @ tilt @ R_BODY_CAMERA)
    np.testing.assert_array_equal(R_own_body, R_own_ahead)
    R_own_body = nearest_body_axes(R_BODY_CAMERA.T @ tilt @ R_BODY_CAMERA)  # a body with the axes of a camera
    np.testing.assert_array_equal(R_own_body, R_BODY_CAMERA.T)

# SPDX-License-Identifier: BSD-3-Clause
"""Dots projected by the lens model into raw images must be where the rectified rig projects them."""

import cv2
import numpy as np
import pytest
from textured_room import LENS, Room, rig

from coclo_vio.frontend.rectification import Rectifier
from coclo_vio.geometry import se3
from coclo_vio.values.calibration import CameraCalibration, StereoCalibration, matrix4
from coclo_vio.values.errors import ConfigError, DatasetError
from coclo_vio.values.measurements import StereoFrame

COLUMNS, ROWS = 640, 480
MOUNTED = np.array([[0.0, 0.0, 1.0, 0.1], [-1.0, 0.0, 0.0, 0.05], [0.0, -1.0, 0.0, 0.2], [0.0, 0.0, 0.0, 1.0]])
RIGHT_OF_LEFT = se3.exp(np.array([0.02, -0.015, 0.01, 0.11, 0.002, -0.001]))
LENSES = {
    "none": (),
    "radtan": (-0.28, 0.07, 0.0002, 0.00002),
    "radtan5": (-0.28, 0.07, 0.0002, 0.00002, 0.01),
    "radtan8": (-0.28, 0.07, 0.0002, 0.00002, 0.01, 0.02, 0.01, 0.005),
    "equidistant": (0.01, -0.004, 0.002, -0.0005),
}
POINTS = np.array([[0.2, 0.1, 2.0], [-0.4, -0.2, 1.5], [0.5, 0.3, 3.0], [-0.1, 0.25, 1.2], [0.05, -0.35, 2.5]])


def lens(name: str, focal_px: float = 450.0) -> CameraCalibration:
    return CameraCalibration(
        width_px=COLUMNS,
        height_px=ROWS,
        focal_px=(focal_px, focal_px + 2.0),
        principal_point_px=(325.0, 236.0),
        distortion=name.rstrip("58"),
        distortion_coefficients=LENSES[name],
    )


def pair(name: str) -> StereoCalibration:
    return StereoCalibration(
        left=lens(name),
        right=lens(name, 455.0),
        body_left_camera=matrix4(MOUNTED),
        body_right_camera=matrix4(MOUNTED @ RIGHT_OF_LEFT),
    )


def projected(points_camera: np.ndarray, camera: CameraCalibration) -> np.ndarray:
    """Raw pixels (N, 2) of points (N, 3) in the camera's frame."""
    none, coefficients = np.zeros(3), np.array(camera.distortion_coefficients)
    if camera.distortion == "equidistant":
        pixels, _ = cv2.fisheye.projectPoints(points_camera[:, None], none, none, camera.camera_matrix, coefficients)
    else:
        pixels, _ = cv2.projectPoints(points_camera, none, none, camera.camera_matrix, coefficients)
    return np.asarray(pixels).reshape(-1, 2)


def dots(pixels: np.ndarray) -> np.ndarray:
    columns, rows = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS))
    light = sum(np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * 2.5**2)) for x, y in pixels)
    return np.rint(220.0 * light).astype(np.uint8)


def centroid(image: np.ndarray, about: np.ndarray) -> np.ndarray:
    column, row = np.rint(about).astype(int) - 12
    patch = image[row : row + 25, column : column + 25].astype(float)
    steps = np.arange(25)
    return np.array([column + patch.sum(axis=0) @ steps / patch.sum(), row + patch.sum(axis=1) @ steps / patch.sum()])


@pytest.mark.parametrize("name", LENSES)
def test_points_are_where_the_rectified_rig_projects_them(name: str) -> None:
    calibration = pair(name)
    rectifier = Rectifier(calibration)
    in_right = se3.apply(se3.inverse(RIGHT_OF_LEFT), POINTS)
    images = (dots(projected(POINTS, calibration.left)), dots(projected(in_right, calibration.right)))
    rectified = rectifier.rectify(StereoFrame(0, *images))
    in_body = se3.apply(calibration.T_body_left_camera, POINTS)
    left_px, disparity = rectifier.rig.pixels(se3.apply(se3.inverse(rectifier.rig.T_body_camera), in_body))
    right_px = left_px - np.column_stack((disparity, np.zeros(len(disparity))))
    assert (disparity > 5.0).all()
    for image, expected in ((rectified.left, left_px), (rectified.right, right_px)):
        found = np.array([centroid(image, pixel) for pixel in expected])
        np.testing.assert_allclose(found, expected, rtol=0, atol=0.05)


@pytest.mark.parametrize("name", LENSES)
def test_the_images_keep_their_size_and_are_not_enlarged(name: str) -> None:
    rectifier = Rectifier(pair(name))
    image = np.full((ROWS, COLUMNS), 100, dtype=np.uint8)
    rectified = rectifier.rectify(StereoFrame(0, image, image))
    assert rectified.left.shape == rectified.right.shape == (ROWS, COLUMNS)
    assert max(rectifier.rig.focal_px) <= 450.0
    assert rectifier.rig.baseline_m == pytest.approx(np.linalg.norm(RIGHT_OF_LEFT[:3, 3]), rel=1e-9)


def test_pixels_without_a_source_are_masked() -> None:
    rectifier = Rectifier(pair("none"))
    image = np.full((ROWS, COLUMNS), 100, dtype=np.uint8)
    rectified = rectifier.rectify(StereoFrame(0, image, image))
    for valid, picture in ((rectifier.valid_left, rectified.left), (rectifier.valid_right, rectified.right)):
        assert 0.8 < (valid > 0).mean() < 1.0
        assert (picture[valid > 0] == 100).all()


def test_a_rectified_pair_is_passed_on_unchanged(room: Room) -> None:
    calibration = rig()
    rectifier = Rectifier(calibration)
    frame = room.frame(0, np.eye(4))
    rectified = rectifier.rectify(frame)
    assert np.shares_memory(rectified.left, frame.left)
    assert np.shares_memory(rectified.right, frame.right)
    assert rectifier.rig.focal_px == LENS.focal_px
    assert rectifier.rig.principal_point_px == LENS.principal_point_px
    np.testing.assert_allclose(rectifier.rig.T_body_camera, calibration.T_body_left_camera)
    assert (rectifier.valid_left == 255).all()


def test_images_of_another_size_are_refused() -> None:
    image = np.zeros((ROWS // 2, COLUMNS), dtype=np.uint8)
    with pytest.raises(DatasetError, match=r"have 640 x 240 px.*calibrated with 640 x 480"):
        Rectifier(pair("none")).rectify(StereoFrame(5, image, image))


def test_cameras_of_two_sizes_are_refused() -> None:
    small = lens("none").model_copy(update={"width_px": 320})
    with pytest.raises(ConfigError, match="320 x 480"):
        Rectifier(pair("none").model_copy(update={"right": small}))


def test_swapped_cameras_are_refused() -> None:
    right = pair("radtan")
    swapped = right.model_copy(
        update={"body_left_camera": right.body_right_camera, "body_right_camera": right.body_left_camera}
    )
    with pytest.raises(ConfigError, match="left and right are not swapped"):
        Rectifier(swapped)


def test_cameras_one_above_the_other_are_refused() -> None:
    above = se3.transform(np.eye(3), np.array([0.0, -0.1, 0.0]))
    with pytest.raises(ConfigError, match="must be to the right"):
        Rectifier(pair("none").model_copy(update={"body_right_camera": matrix4(MOUNTED @ above)}))

# SPDX-License-Identifier: BSD-3-Clause
"""Rectification of raw stereo images: parallel axes, one pinhole model, rows that agree. The first step of a frame.

The rotations are those of Bouguet's method: each camera turns by half of their relative rotation (OpenCV's
stereoRectify). The pinhole model keeps the size of the images and has the shortest focal length of the two, so nothing
is enlarged; pixels without a source stay black, and a mask marks them. A pair that is rectified already is passed on
without resampling.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array, ByteImage, FloatImage
from coclo_vio.values.calibration import CameraCalibration, RectifiedStereo, StereoCalibration
from coclo_vio.values.errors import ConfigError, DatasetError
from coclo_vio.values.measurements import StereoFrame

# OpenCV's own log messages would mix with the command line's output.
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)

_SHORTEST_M = 1e-4
_AXIS_TOLERANCE = 1e-6  # of the rectified baseline's direction


@dataclass(frozen=True, slots=True, eq=False)
class RectifiedPair:
    """Two rectified images, grey.

    Attributes:
        left: of the left camera, (rows, columns), uint8.
        right: of the right camera, the same shape.
    """

    left: ByteImage
    right: ByteImage


class Rectifier:
    """Rectifies the frames of one stereo pair.

    Attributes:
        rig: the pair after rectification.
        valid_left: 255 where a pixel of the rectified left image has a source in the raw one, (rows, columns), uint8.
        valid_right: the same of the right image.

    Raises:
        ConfigError: cameras of different image size, or a right camera that is not to the right of the left one.
    """

    def __init__(self, calibration: StereoCalibration) -> None:
        left, right = calibration.left, calibration.right
        self._shape = (left.height_px, left.width_px)
        if self._shape != (right.height_px, right.width_px):
            raise ConfigError(
                f"the left camera has {left.width_px} x {left.height_px} px, the right one {right.width_px} x "
                f"{right.height_px}; a stereo pair needs images of one size: check the calibration"
            )
        T_left_right = se3.inverse(calibration.T_body_left_camera) @ calibration.T_body_right_camera
        self._maps: tuple[tuple[FloatImage, FloatImage], ...] = ()
        if not calibration.rectification_defects():
            self.rig = RectifiedStereo(
                left.focal_px, left.principal_point_px, float(T_left_right[0, 3]), calibration.T_body_left_camera
            )
            self.valid_left = self.valid_right = np.full(self._shape, 255, dtype=np.uint8)
            return
        rotations, baseline_m = _parallel_rotations(T_left_right, self._shape)
        matrix = _shared_pinhole((left, right), rotations)
        self._maps = tuple(
            _map(lens, rotation, matrix) for lens, rotation in zip((left, right), rotations, strict=True)
        )
        self.valid_left, self.valid_right = (self._valid(maps) for maps in self._maps)
        self.rig = RectifiedStereo(
            (float(matrix[0, 0]), float(matrix[1, 1])),
            (float(matrix[0, 2]), float(matrix[1, 2])),
            baseline_m,
            calibration.T_body_left_camera @ se3.transform(rotations[0].T, np.zeros(3)),
        )

    def rectify(self, frame: StereoFrame) -> RectifiedPair:
        """The frame's images, rectified.

        Raises:
            DatasetError: they are not of the size that was calibrated.
        """
        fault = self.size_fault(frame)
        if fault:
            raise DatasetError(f"{fault}; scale the images or the calibration")
        if not self._maps:
            return RectifiedPair(frame.left, frame.right)
        left, right = (
            np.asarray(cv2.remap(image, *maps, cv2.INTER_LINEAR), dtype=np.uint8)
            for image, maps in zip((frame.left, frame.right), self._maps, strict=True)
        )
        return RectifiedPair(left, right)

    def size_fault(self, frame: StereoFrame) -> str:
        """Why the images of a frame cannot be rectified: their size; empty where they can."""
        if frame.left.shape == self._shape:
            return ""
        rows, columns = frame.left.shape
        return (
            f"the images at {frame.stamp_ns} ns have {columns} x {rows} px, the cameras were calibrated with "
            f"{self._shape[1]} x {self._shape[0]}"
        )

    def _valid(self, maps: tuple[FloatImage, FloatImage]) -> ByteImage:
        """255 where a map points into the raw image, (rows, columns)."""
        rows, columns = self._shape
        inside = (maps[0] >= 0) & (maps[0] <= columns - 1) & (maps[1] >= 0) & (maps[1] <= rows - 1)
        return np.where(inside, 255, 0).astype(np.uint8)


def _parallel_rotations(T_left_right: Array, shape: tuple[int, int]) -> tuple[tuple[Array, Array], float]:
    """Rotations (3, 3) from each camera's frame to its rectified one, and the baseline, m."""
    if np.linalg.norm(T_left_right[:3, 3]) < _SHORTEST_M:
        raise ConfigError(
            f"the baseline of the cameras is {np.linalg.norm(T_left_right[:3, 3]):.4g} m: both have the same mounting; "
            "correct the transform from the left to the right camera in the calibration"
        )
    T_right_left = se3.inverse(T_left_right)
    pinhole = np.diag([float(shape[1]), float(shape[1]), 1.0])
    no_distortion = np.zeros(4)
    size = (shape[1], shape[0])
    R_left, R_right, *_ = cv2.stereoRectify(  # the rotations do not depend on the lenses
        pinhole, no_distortion, pinhole, no_distortion, size, T_right_left[:3, :3], T_right_left[:3, 3:]
    )
    baseline = R_left @ T_left_right[:3, 3]
    if baseline[0] <= 0.0 or np.abs(baseline[1:]).max() > _AXIS_TOLERANCE * baseline[0]:
        raise ConfigError(
            f"the right camera is at {np.round(T_left_right[:3, 3], 4).tolist()} m in the left camera's frame "
            "(x right, y down, z forward); it must be to the right: check that left and right are not swapped, "
            "and that body_left_camera and body_right_camera map camera coordinates to body"
        )
    return (np.asarray(R_left), np.asarray(R_right)), float(baseline[0])


def _shared_pinhole(lenses: tuple[CameraCalibration, CameraCalibration], rotations: tuple[Array, Array]) -> Array:
    """Camera matrix (3, 3), px, of the pinhole model that both rectified images share.

    Its focal length is the shortest of the two cameras'. Its principal point keeps the centres of both images, on
    average, where they are.
    """
    focal = min(min(lens.focal_px) for lens in lenses)
    middle = np.array([0.5 * (lenses[0].width_px - 1), 0.5 * (lenses[0].height_px - 1)])
    ahead = [rotation @ _ray(lens, middle) for lens, rotation in zip(lenses, rotations, strict=True)]
    centre = middle - focal * np.mean([ray[:2] / ray[2] for ray in ahead], axis=0)
    return np.array([[focal, 0.0, centre[0]], [0.0, focal, centre[1]], [0.0, 0.0, 1.0]])


def _ray(lens: CameraCalibration, pixel: Array) -> Array:
    """Direction (3,) in the camera's frame, z = 1, of a raw pixel (2,)."""
    coefficients = np.array(lens.distortion_coefficients)
    point = pixel.reshape(1, 1, 2)
    if lens.distortion == "equidistant":
        undistorted = cv2.fisheye.undistortPoints(point, lens.camera_matrix, coefficients)
    else:
        undistorted = cv2.undistortPoints(point, lens.camera_matrix, coefficients if len(coefficients) else None)
    return np.append(np.asarray(undistorted, dtype=np.float64).ravel(), 1.0)


def _map(lens: CameraCalibration, rotation: Array, matrix: Array) -> tuple[FloatImage, FloatImage]:
    """Column and row of the raw image for each pixel of the rectified one, both (rows, columns)."""
    size = (lens.width_px, lens.height_px)
    coefficients = np.array(lens.distortion_coefficients)
    if lens.distortion == "equidistant":
        maps = cv2.fisheye.initUndistortRectifyMap(
            lens.camera_matrix, coefficients, rotation, matrix, size, cv2.CV_32FC1
        )
    else:
        maps = cv2.initUndistortRectifyMap(
            lens.camera_matrix,
            coefficients if len(coefficients) else np.zeros(4),
            rotation,
            matrix,
            size,
            cv2.CV_32FC1,
        )
    return np.asarray(maps[0], dtype=np.float32), np.asarray(maps[1], dtype=np.float32)

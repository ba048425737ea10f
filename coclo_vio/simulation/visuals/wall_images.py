# SPDX-License-Identifier: BSD-3-Clause
"""Stereo images of a textured wall beside a walking robot: frames at any rate that fit the motion of its legs.

The wall is a plane, so that an image of it is a homography of its texture.
"""

from collections.abc import Iterator

import cv2
import numpy as np

from coclo_vio.geometry import se3
from coclo_vio.simulation.body_motion import BodyStates
from coclo_vio.values.arrays import Array, ByteImage, FloatImage, IntArray
from coclo_vio.values.calibration import CameraCalibration, StereoCalibration
from coclo_vio.values.measurements import StereoFrame

_DISTANCE_M = 2.5
_HALF_LENGTH_M, _HALF_HEIGHT_M, _PX_PER_M = 8.0, 3.0, 160.0


def frames_along_wall(
    rig: StereoCalibration, stamps_ns: IntArray, body: BodyStates, seed: int = 1
) -> Iterator[StereoFrame]:
    """A frame at each stamp.

    Args:
        rig: rectified cameras that look along y of the body, the same intrinsics in both.
        stamps_ns: of the frames, (M,).
        body: the true motion at these stamps.
        seed: of texture and image noise.
    """
    random = np.random.default_rng(seed)
    texture = _texture(random)
    for index, stamp_ns in enumerate(stamps_ns):
        T_world_body = se3.transform(body.rotation[index], body.position[index])
        left, right = (
            _image(texture, rig.left, T_world_body @ T_body_camera, random)
            for T_body_camera in (rig.T_body_left_camera, rig.T_body_right_camera)
        )
        yield StereoFrame(int(stamp_ns), left, right)


def _texture(random: np.random.Generator) -> FloatImage:
    """Blotches of several sizes, grey levels, one pixel a 1 / _PX_PER_M of the wall."""
    shape = round(2 * _HALF_HEIGHT_M * _PX_PER_M), round(2 * _HALF_LENGTH_M * _PX_PER_M)
    total = np.zeros(shape, dtype=np.float32)
    for sigma_px in (1.5, 4.0, 10.0):
        blotches = cv2.GaussianBlur(random.normal(size=shape).astype(np.float32), (0, 0), sigma_px)
        total += np.asarray(blotches / blotches.std())
    return np.asarray(np.clip(128.0 + 30.0 * total, 0.0, 255.0), dtype=np.float32)


def _image(
    texture: FloatImage, camera: CameraCalibration, T_world_camera: Array, random: np.random.Generator
) -> ByteImage:
    """The wall ``y = _DISTANCE_M`` seen by a camera."""
    wall = np.array(
        [
            [1.0 / _PX_PER_M, 0.0, -_HALF_LENGTH_M],
            [0.0, 0.0, _DISTANCE_M],
            [0.0, -1.0 / _PX_PER_M, _HALF_HEIGHT_M],
        ]
    )  # texture px (u, v, 1) to the world
    shape = camera.width_px, camera.height_px
    R, position = T_world_camera[:3, :3], T_world_camera[:3, 3]
    wall[:, 2] -= position
    image = cv2.warpPerspective(texture, camera.camera_matrix @ R.T @ wall, shape, borderMode=cv2.BORDER_REFLECT)
    noisy = np.asarray(image) + 2.0 * random.standard_normal(shape[::-1])
    return np.clip(noisy, 0.0, 255.0).astype(np.uint8)

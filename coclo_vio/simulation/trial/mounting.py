# SPDX-License-Identifier: BSD-3-Clause
"""Extrinsics of the stereo camera and the IMUs: as described, and the true ones."""

from typing import Annotated

import numpy as np
from pydantic import Field

from coclo_vio.geometry import se3, so3
from coclo_vio.simulation.trial.imperfection import Imperfection
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import CameraCalibration, StereoCalibration, Triple, matrix4
from coclo_vio.values.config import StageConfig

_BODY_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


class MountingConfig(StageConfig):
    """A RealSense D435i on top of the robot, looking forward and a little down.

    Baseline and image size are the maker's; the focal length is that of its infrared imagers at 640x480 (about 383 px
    by their factory calibration); the IMU sits beside the left imager (Intel's reported extrinsics, rounded).
    """

    camera_position_m: Annotated[Triple, Field(description="left camera, body frame, m")] = (0.23, 0.025, 0.16)
    camera_pitch_rad: Annotated[float, Field(ge=-1.5, le=1.5, description="downwards, rad")] = 0.26
    baseline_m: Annotated[float, Field(gt=0, le=1, description="from the left to the right camera, m")] = 0.05
    width_px: Annotated[int, Field(gt=15, le=4096, description="image width, px")] = 640
    height_px: Annotated[int, Field(gt=15, le=4096, description="image height, px")] = 480
    focal_px: Annotated[float, Field(gt=1, description="focal length, px")] = 383.0
    camera_imu_position_m: Annotated[Triple, Field(description="of the camera's IMU in the left camera's frame, m")] = (
        0.0055,
        -0.0051,
        -0.0117,
    )
    imu_position_m: Annotated[Triple, Field(description="of the body's IMU, body frame, m")] = (0.0, 0.0, 0.05)
    imu_rotation_rpy_rad: Annotated[
        Triple, Field(description="roll, pitch, yaw of the body's IMU on the body (R = Rz Ry Rx), rad")
    ] = (0.0, 0.0, 0.0)

    @property
    def T_body_imu(self) -> Array:
        """The body's IMU, (4, 4)."""
        roll, pitch, yaw = self.imu_rotation_rpy_rad
        rotation = so3.about_z(yaw) @ so3.exp(np.array([0.0, pitch, 0.0])) @ so3.exp(np.array([roll, 0.0, 0.0]))
        return se3.transform(rotation, np.array(self.imu_position_m))

    @property
    def T_left_camera_imu(self) -> Array:
        """The camera's IMU in the left camera's frame, axes along the camera's, (4, 4)."""
        return se3.transform(np.eye(3), np.array(self.camera_imu_position_m))

    def stereo(self) -> StereoCalibration:
        """The cameras as described."""
        rotation = so3.exp(np.array([0.0, self.camera_pitch_rad, 0.0])) @ _BODY_FROM_OPTICAL
        left = se3.transform(rotation, np.array(self.camera_position_m))
        right = left @ se3.transform(np.eye(3), np.array([self.baseline_m, 0.0, 0.0]))
        lens = CameraCalibration(
            width_px=self.width_px,
            height_px=self.height_px,
            focal_px=(self.focal_px, self.focal_px),
            principal_point_px=((self.width_px - 1) / 2.0, (self.height_px - 1) / 2.0),
        )
        return StereoCalibration(
            left=lens, right=lens, body_left_camera=matrix4(left), body_right_camera=matrix4(right)
        )


def perturbed(nominal: StereoCalibration, imperfection: Imperfection) -> StereoCalibration:
    """The true extrinsics of the cameras."""
    left_right = se3.inverse(nominal.T_body_left_camera) @ nominal.T_body_right_camera
    left = nominal.T_body_left_camera @ se3.exp(imperfection.camera_move)
    right = left @ left_right @ se3.exp(imperfection.baseline_move)
    return nominal.model_copy(update={"body_left_camera": matrix4(left), "body_right_camera": matrix4(right)})

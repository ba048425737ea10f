# SPDX-License-Identifier: BSD-3-Clause
"""What is known of the sensors before a recording starts: noise and mounting of the IMU."""

from typing import Annotated

import numpy as np
from pydantic import Field

from coclo_vio.arrays import Array
from coclo_vio.config import StageConfig
from coclo_vio.geometry import se3, so3

Triple = tuple[float, float, float]
Angle = Annotated[float, Field(ge=-6.3, le=6.3)]


class ImuCalibration(StageConfig):
    """Mounting and noise of an IMU. The defaults are those of a cheap MEMS part (Bosch BMI055 class).

    The filter uses the rotation, the gyroscope's noise and the bias walks; the lever arm and the accelerometer's noise
    serve the IMU-centric baseline: the filter asks the accelerometer for gravity only, while the robot stands.
    """

    position_body_m: Annotated[Triple, Field(description="origin of the imu frame, body frame, m")] = (0.0, 0.0, 0.0)
    rotation_body_imu_rpy_rad: Annotated[
        tuple[Angle, Angle, Angle], Field(description="roll, pitch, yaw of R_body_imu (URDF order: R = Rz Ry Rx), rad")
    ] = (0.0, 0.0, 0.0)
    gyroscope_noise_density: Annotated[float, Field(gt=0, description="white noise, rad/s/sqrt(Hz)")] = 2e-4
    gyroscope_bias_walk: Annotated[float, Field(ge=0, description="bias random walk, rad/s^2/sqrt(Hz)")] = 2e-5
    accelerometer_noise_density: Annotated[float, Field(gt=0, description="white noise, m/s^2/sqrt(Hz)")] = 2e-3
    accelerometer_bias_walk: Annotated[float, Field(ge=0, description="bias random walk, m/s^3/sqrt(Hz)")] = 3e-4

    @property
    def T_body_imu(self) -> Array:  # noqa: N802
        """Maps imu coordinates to body, (4, 4)."""
        roll, pitch, yaw = self.rotation_body_imu_rpy_rad
        rotation = so3.about_z(yaw) @ so3.exp(np.array([0.0, pitch, 0.0])) @ so3.exp(np.array([roll, 0.0, 0.0]))
        return se3.transform(rotation, np.array(self.position_body_m))

# SPDX-License-Identifier: BSD-3-Clause
"""Calibration of the sensors: IMUs (noise, mounting) and cameras (lenses, mounting)."""

from dataclasses import dataclass, replace
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array, checked, frozen
from coclo_vio.values.config import StageConfig
from coclo_vio.values.errors import CalibrationMissing
from coclo_vio.values.imu_grades import ERRORS_OF_GRADE, ImuGrade

Triple = tuple[float, float, float]
Row = tuple[float, float, float, float]
Matrix4 = tuple[Row, Row, Row, Row]
Angle = Annotated[float, Field(ge=-6.3, le=6.3)]


class ImuCalibration(StageConfig):
    """Mounting and errors of an IMU. What is not given of its errors is that of its grade (``imu_grades``).

    The filter uses the mounting, the gyroscope's noise and scale, the walks and the sigmas of the biases. The
    accelerometer's noise is for the IMU-centric baseline and the smoother: the filter uses the accelerometer only as
    the direction of gravity.
    """

    grade: Annotated[
        ImuGrade, Field(description="tactical, calibrated_mems or cheap_mems: what is not given of its errors")
    ] = "cheap_mems"
    position_body_m: Annotated[Triple, Field(description="origin of the imu frame, body frame, m")] = (0.0, 0.0, 0.0)
    rotation_body_imu_rpy_rad: Annotated[
        tuple[Angle, Angle, Angle], Field(description="roll, pitch, yaw of R_body_imu (URDF order: R = Rz Ry Rx), rad")
    ] = (0.0, 0.0, 0.0)
    gyroscope_noise_density: Annotated[float, Field(gt=0, description="white noise, rad/s/sqrt(Hz)")] = 2e-4
    gyroscope_bias_walk: Annotated[float, Field(ge=0, description="bias random walk, rad/s^2/sqrt(Hz)")] = 2e-5
    gyroscope_bias: Annotated[float, Field(gt=0, description="one sigma of the bias at switch-on, rad/s")] = 0.02
    gyroscope_scale: Annotated[
        float, Field(ge=0, lt=0.2, description="one sigma of the relative error of the gyroscope's scale, each axis")
    ] = 0.01
    accelerometer_noise_density: Annotated[float, Field(gt=0, description="white noise, m/s^2/sqrt(Hz)")] = 2e-3
    accelerometer_bias_walk: Annotated[float, Field(ge=0, description="bias random walk, m/s^3/sqrt(Hz)")] = 3e-4
    accelerometer_bias: Annotated[float, Field(gt=0, description="one sigma of the bias at switch-on, m/s^2")] = 0.1

    @model_validator(mode="after")
    def _errors_by_grade(self) -> Self:
        """Fill in what is not given; it counts as not given still, so that another grade may replace it."""
        for name, value in ERRORS_OF_GRADE[self.grade]._asdict().items():
            if name not in self.model_fields_set:
                self.__dict__[name] = value
        return self

    def with_grade_of(self, other: "ImuCalibration") -> "ImuCalibration":
        """This calibration; where it gives no grade, grade and sigmas of the biases are the other's if not given."""
        if "grade" in self.model_fields_set:
            return self
        kept = {"grade", "gyroscope_bias", "gyroscope_scale", "accelerometer_bias"} - self.model_fields_set
        return ImuCalibration(**(other.model_dump(include=kept) | self.model_dump(exclude_unset=True)))

    @property
    def T_body_imu(self) -> Array:
        """Maps imu coordinates to body, (4, 4)."""
        roll, pitch, yaw = self.rotation_body_imu_rpy_rad
        rotation = so3.about_z(yaw) @ so3.exp(np.array([0.0, pitch, 0.0])) @ so3.exp(np.array([roll, 0.0, 0.0]))
        return se3.transform(rotation, np.array(self.position_body_m))

    def moved(self, T: Array) -> Self:
        """The same IMU with the mounting ``T @ T_body_imu``, T (4, 4)."""
        T_body_imu = T @ self.T_body_imu
        R = T_body_imu[:3, :3]
        roll, pitch = float(np.arctan2(R[2, 1], R[2, 2])), float(np.arcsin(np.clip(-R[2, 0], -1.0, 1.0)))
        yaw = float(np.arctan2(R[1, 0], R[0, 0]))
        x, y, z = (float(each) for each in T_body_imu[:3, 3])
        return self.model_copy(update={"position_body_m": (x, y, z), "rotation_body_imu_rpy_rad": (roll, pitch, yaw)})


_SAME_PX = 1e-3
_PARALLEL_RAD = 1e-5
_DISTORTION_COEFFICIENTS = {"none": (0,), "radtan": (4, 5, 8), "equidistant": (4,)}


class CameraCalibration(StageConfig):
    """Intrinsics of one camera: a pinhole model with distortion.

    ``radtan`` is OpenCV's model k1 k2 p1 p2 [k3 [k4 k5 k6]], ``equidistant`` its fisheye model k1 k2 k3 k4 (Kannala and
    Brandt 2006). Pixel (0, 0) is the centre of the upper left pixel.
    """

    width_px: Annotated[int, Field(gt=0, le=65535, description="image width, px")]
    height_px: Annotated[int, Field(gt=0, le=65535, description="image height, px")]
    focal_px: Annotated[tuple[float, float], Field(description="focal lengths fx, fy, px")]
    principal_point_px: Annotated[tuple[float, float], Field(description="principal point cx, cy, px")]
    distortion: Annotated[Literal["none", "radtan", "equidistant"], Field(description="distortion model")] = "none"
    distortion_coefficients: Annotated[tuple[float, ...], Field(description="coefficients of that model")] = ()

    @model_validator(mode="after")
    def _coefficients_fit_the_model(self) -> Self:
        allowed = _DISTORTION_COEFFICIENTS[self.distortion]
        if len(self.distortion_coefficients) not in allowed:
            raise ValueError(
                f"{self.distortion} distortion takes {' or '.join(map(str, allowed))} coefficients, "
                f"got {len(self.distortion_coefficients)}"
            )
        if min(self.focal_px) <= 0.0:
            raise ValueError(f"focal_px = {self.focal_px} must be positive")
        return self

    @property
    def camera_matrix(self) -> Array:
        """Camera matrix K (3, 3), px."""
        return _camera_matrix(self.focal_px, self.principal_point_px)


class StereoCalibration(StageConfig):
    """A stereo pair on the robot. Camera frames are x right, y down, z forward (REP 103's optical frames)."""

    left: Annotated[CameraCalibration, Field(description="intrinsics of the left camera")]
    right: Annotated[CameraCalibration, Field(description="intrinsics of the right camera")]
    body_left_camera: Annotated[Matrix4, Field(description="T_body_left_camera, rows of a 4 x 4 matrix")]
    body_right_camera: Annotated[Matrix4, Field(description="T_body_right_camera, rows of a 4 x 4 matrix")]
    time_offset_s: Annotated[
        float,
        Field(ge=-1, le=1, description="stamp of an image plus this is the time of the body's IMU clock, s"),
    ] = 0.0

    @model_validator(mode="after")
    def _mountings_are_rigid(self) -> Self:
        for side in ("left", "right"):
            T = np.array(getattr(self, f"body_{side}_camera"))
            is_rotation = np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-3) and np.linalg.det(T[:3, :3]) > 0
            if not is_rotation or not np.array_equal(T[3], [0.0, 0.0, 0.0, 1.0]):
                raise ValueError(f"body_{side}_camera is not a rigid transform: check its rotation and its last row")
        return self

    @property
    def T_body_left_camera(self) -> Array:
        """Maps left camera coordinates to body, (4, 4)."""
        return np.array(self.body_left_camera)

    @property
    def T_body_right_camera(self) -> Array:
        """Maps right camera coordinates to body, (4, 4)."""
        return np.array(self.body_right_camera)

    @property
    def baseline_m(self) -> float:
        """Distance of the two cameras, m."""
        return float(np.linalg.norm(self.T_body_right_camera[:3, 3] - self.T_body_left_camera[:3, 3]))

    def rectification_defects(self) -> list[str]:
        """What distinguishes this pair from a rectified one; empty if its images, or tracks, are rectified already."""
        T_left_right = np.linalg.solve(self.T_body_left_camera, self.T_body_right_camera)
        baseline_m = float(T_left_right[0, 3])
        coefficients = self.left.distortion_coefficients + self.right.distortion_coefficients
        is_fisheye = "equidistant" in (self.left.distortion, self.right.distortion)  # even with zero coefficients
        defects = {
            "lens distortion": is_fisheye or any(coefficients),
            "different camera matrices": np.abs(self.left.camera_matrix - self.right.camera_matrix).max() > _SAME_PX,
            "axes that are not parallel": np.abs(T_left_right[:3, :3] - np.eye(3)).max() > _PARALLEL_RAD,
            "a baseline that is not along x": not np.abs(T_left_right[1:3, 3]).max() < _PARALLEL_RAD * baseline_m,
        }
        return [name for name, is_present in defects.items() if is_present]


@dataclass(frozen=True, slots=True, eq=False)
class RectifiedStereo:
    """A rectified stereo pair: parallel axes, one pinhole model, and a baseline along x.

    A point (x, y, z) of the left camera's frame projects to column ``fx x / z + cx`` and row ``fy y / z + cy`` of the
    left image and at column ``fx (x - baseline) / z + cx`` of the right one.

    Attributes:
        focal_px: fx, fy, px.
        principal_point_px: cx, cy, px.
        baseline_m: distance of the cameras, m.
        T_body_camera: maps coordinates of the rectified left camera to body, (4, 4).

    Raises:
        ValueError: a length that is not positive, or a wrong shape.
    """

    focal_px: tuple[float, float]
    principal_point_px: tuple[float, float]
    baseline_m: float
    T_body_camera: Array

    def __post_init__(self) -> None:
        frozen(self, "T_body_camera", checked("RectifiedStereo.T_body_camera", self.T_body_camera, (4, 4)))
        if min(*self.focal_px, self.baseline_m) <= 0.0:
            raise ValueError(f"focal_px = {self.focal_px} and baseline_m = {self.baseline_m} must be positive")

    @classmethod
    def of(cls, stereo: StereoCalibration) -> Self:
        """The rectified pair of a calibration whose images, or tracks, are rectified already.

        Raises:
            CalibrationMissing: they are not rectified.
        """
        defects = stereo.rectification_defects()
        if defects:
            raise CalibrationMissing(
                f"these cameras are not rectified, they have {', '.join(defects)}; tracks need the calibration of "
                "rectified images: one pinhole model, no distortion, the right camera along the left one's x axis"
            )
        baseline_m = float(np.linalg.solve(stereo.T_body_left_camera, stereo.T_body_right_camera)[0, 3])
        return cls(stereo.left.focal_px, stereo.left.principal_point_px, baseline_m, stereo.T_body_left_camera)

    def moved(self, T: Array) -> Self:
        """The same cameras with the mounting ``T @ T_body_camera``, T (4, 4)."""
        return replace(self, T_body_camera=T @ self.T_body_camera)

    @property
    def camera_matrix(self) -> Array:
        """Camera matrix K (3, 3), px."""
        return _camera_matrix(self.focal_px, self.principal_point_px)

    def points(self, left_px: Array, disparity_px: Array) -> Array:
        """Points (N, 3), m, in the left camera's frame, of columns and rows (N, 2) and disparities (N,)."""
        depth = self.focal_px[0] * self.baseline_m / disparity_px
        normalised = (left_px - np.array(self.principal_point_px)) / np.array(self.focal_px)
        return np.column_stack((normalised * depth[:, None], depth))

    def pixels(self, points: Array) -> tuple[Array, Array]:
        """Columns and rows (N, 2) in the left image, and disparities (N,), of points (N, 3) in front of it."""
        left_px = points[:, :2] / points[:, 2:] * np.array(self.focal_px) + np.array(self.principal_point_px)
        return left_px, self.focal_px[0] * self.baseline_m / points[:, 2]


@dataclass(frozen=True, slots=True)
class SensorCalibrations:
    """What is known of a recording's sensors; None where nothing is.

    Attributes:
        stereo: the two cameras.
        imu: mounting and noise of the body's IMU.
        camera_imu: the same of the IMU inside the camera.
    """

    stereo: StereoCalibration | None = None
    imu: ImuCalibration | None = None
    camera_imu: ImuCalibration | None = None


def _camera_matrix(focal_px: tuple[float, float], principal_point_px: tuple[float, float]) -> Array:
    (fx, fy), (cx, cy) = focal_px, principal_point_px
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def matrix4(T: Array) -> Matrix4:
    """A transform (4, 4) as the nested rows of a calibration."""
    return tuple(tuple(row) for row in T.tolist())  # type: ignore[return-value]

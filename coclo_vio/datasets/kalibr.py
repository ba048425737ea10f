# SPDX-License-Identifier: BSD-3-Clause
"""Calibration files of Kalibr: a camchain (intrinsics, mountings, time shift) and an IMU's noise.

Formats: github.com/ethz-asl/kalibr/wiki/yaml-formats. Directions follow from the keys:
``T_cam_imu`` maps imu coordinates to the camera, ``T_imu_cam`` is its inverse, ``T_cn_cnm1`` maps coordinates of the
previous camera to this one; ``timeshift_cam_imu`` is s in ``t_imu = t_cam + s``.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import CameraCalibration
from coclo_vio.values.config import StageConfig, read_yaml
from coclo_vio.values.errors import CalibrationMissing, ConfigError, listing, shortened

_DISTORTIONS = ("radtan", "equidistant", "none")
_TOLERANCE_M = 1e-3
_FARTHEST_M = 1e6
_TOLERANCE_RAD = 1e-3
_NOISE_KEYS = {
    "gyroscope_noise_density": "gyroscope_noise_density",
    "gyroscope_random_walk": "gyroscope_bias_walk",
    "accelerometer_noise_density": "accelerometer_noise_density",
    "accelerometer_random_walk": "accelerometer_bias_walk",
}


class KalibrConfig(StageConfig):
    """Calibration files of Kalibr, which take precedence over the calibration in a bag."""

    camchain: Annotated[Path | None, Field(description="camchain-imucam YAML: intrinsics, mountings, time shift")] = (
        None
    )
    imu: Annotated[Path | None, Field(description="IMU YAML: noise densities and random walks")] = None
    calibrated_imu: Annotated[
        Literal["imu", "camera_imu"], Field(description="the IMU of both files: the body's or the camera's")
    ] = "imu"


@dataclass(frozen=True, slots=True, eq=False)
class KalibrCamera:
    """One camera of a camchain.

    Attributes:
        intrinsics: size, pinhole and distortion.
        T_camera_imu: maps imu coordinates to the camera, (4, 4).
        time_shift_s: added to the stamp of an image gives the clock of the IMU, s.
        topic: the topic it was calibrated on, or empty.
    """

    intrinsics: CameraCalibration
    T_camera_imu: Array
    time_shift_s: float
    topic: str


@dataclass(frozen=True, slots=True)
class KalibrImu:
    """An IMU's noise, by the fields of ``ImuCalibration``, and the topic it was measured on, or empty."""

    noise: dict[str, float]
    topic: str


def read_camchain(path: Path) -> tuple[KalibrCamera, ...]:
    """The cameras of a camchain, cam0 first.

    Raises:
        CalibrationMissing: a mounting that is absent, contradictory or not rigid, or an unsupported camera model.
        ConfigError: no such file, or not YAML.
    """
    values = read_yaml(path)
    names = sorted((name for name in values if name.startswith("cam")), key=lambda name: (len(name), name))
    if not names:
        raise CalibrationMissing(f"{path} has no camera: its keys are {listing(map(str, values))}, not cam0, cam1")
    cameras: list[KalibrCamera] = []
    for name in names:
        source, camera = f"{path}, {name}", values[name]
        if not isinstance(camera, dict):
            raise CalibrationMissing(f"{source} must hold a mapping of keys, it holds a {type(camera).__name__}")
        T = _mounting(source, camera, cameras[-1].T_camera_imu if cameras else None)
        shift_s = _number(source, "timeshift_cam_imu", camera.get("timeshift_cam_imu", 0.0))
        cameras.append(KalibrCamera(_intrinsics(source, camera), T, shift_s, str(camera.get("rostopic", ""))))
    return tuple(cameras)


def read_imu(path: Path) -> KalibrImu:
    """The noise in an IMU YAML, whose keys are at the top level or below ``imu0``.

    Raises:
        CalibrationMissing: none of the four noise keys, or one that is not a number.
        ConfigError: no such file, or not YAML.
    """
    values = read_yaml(path)
    inner = values.get("imu0", values)
    values = inner if isinstance(inner, dict) else {}
    noise = {field: _number(str(path), key, values[key]) for key, field in _NOISE_KEYS.items() if key in values}
    if not noise:
        raise CalibrationMissing(
            f"{path} holds no IMU noise: none of {listing(_NOISE_KEYS)} is among its keys {listing(map(str, values))}"
        )
    return KalibrImu(noise, str(values.get("rostopic", "")))


def _mounting(source: str, camera: dict[str, Any], T_previous_imu: Array | None) -> Array:
    """``T_camera_imu`` from ``T_cam_imu``, ``T_imu_cam`` or the chain; where the file has several they must agree."""
    found: dict[str, Array] = {}
    if "T_cam_imu" in camera:
        found["T_cam_imu"] = _transform(source, "T_cam_imu", camera)
    if "T_imu_cam" in camera:
        found["T_imu_cam"] = se3.inverse(_transform(source, "T_imu_cam", camera))
    if "T_cn_cnm1" in camera and T_previous_imu is not None:
        found["T_cn_cnm1"] = _transform(source, "T_cn_cnm1", camera) @ T_previous_imu
    if not found:
        raise CalibrationMissing(
            f"{source} has no mounting: it needs T_cam_imu (imu to camera), T_imu_cam (camera to "
            f"imu) or, after another camera, T_cn_cnm1; its keys are {listing(map(str, camera))}"
        )
    (first, T), *others = found.items()
    for key, other in others:
        apart = np.abs(se3.log(se3.inverse(T) @ other))
        if apart[:3].max() > _TOLERANCE_RAD or apart[3:].max() > _TOLERANCE_M:
            raise CalibrationMissing(
                f"{source}: {first} and {key} contradict each other by {np.rad2deg(np.linalg.norm(apart[:3])):.3g} deg "
                f"and {np.linalg.norm(apart[3:]):.3g} m; "
                "T_cam_imu maps imu to camera, T_imu_cam camera to imu; keep one of them"
            )
    return T


def _intrinsics(source: str, camera: dict[str, Any]) -> CameraCalibration:
    model, distortion = camera.get("camera_model", "pinhole"), camera.get("distortion_model", "none")
    if model != "pinhole" or distortion not in _DISTORTIONS:
        raise CalibrationMissing(
            f"{source}: camera_model {shortened(model)} with distortion_model {shortened(distortion)} is not "
            f"supported; calibrate it as pinhole with {' or '.join(_DISTORTIONS)}"
        )
    coefficients = _numbers(source, "distortion_coeffs", camera.get("distortion_coeffs", []))
    fx, fy, cx, cy = _numbers(source, "intrinsics", camera.get("intrinsics"), 4)
    width, height = _numbers(source, "resolution", camera.get("resolution"), 2)
    values = {
        "width_px": int(width),
        "height_px": int(height),
        "focal_px": (fx, fy),
        "principal_point_px": (cx, cy),
        "distortion": distortion,
        "distortion_coefficients": coefficients if distortion != "none" else (),
    }
    try:
        return CameraCalibration.parse(values, source)
    except ConfigError as error:
        raise CalibrationMissing(str(error)) from error


def _transform(source: str, key: str, camera: dict[str, Any]) -> Array:
    try:
        T = np.array(camera[key], dtype=np.float64).reshape(4, 4)
    except (TypeError, ValueError, OverflowError) as error:
        raise CalibrationMissing(f"{source}: {key} must be 4 rows of 4 numbers ({shortened(error)})") from error
    rotation = T[:3, :3]
    if not (np.abs(T) < _FARTHEST_M).all():
        raise CalibrationMissing(f"{source}: {key} must be finite, with a position below {_FARTHEST_M:g} m")
    is_rigid = np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3) and np.linalg.det(rotation) > 0
    if not is_rigid or not np.allclose(T[3], [0.0, 0.0, 0.0, 1.0]):
        raise CalibrationMissing(f"{source}: {key} is not a rigid transform: its rotation or its last row is wrong")
    return T


def _number(source: str, key: str, value: Any) -> float:
    return _numbers(source, key, [value], 1)[0]


def _numbers(source: str, key: str, value: Any, count: int | None = None) -> tuple[float, ...]:
    try:
        numbers = tuple(float(number) for number in value)
    except (TypeError, ValueError, OverflowError) as error:
        raise CalibrationMissing(f"{source}: {key} = {shortened(repr(value))} must be numbers") from error
    if (count is not None and len(numbers) != count) or not np.isfinite(numbers).all():
        how_many = "" if count is None else f"{count} "
        raise CalibrationMissing(f"{source}: {key} = {shortened(repr(value))} must be {how_many}finite numbers")
    return numbers

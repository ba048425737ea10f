# SPDX-License-Identifier: BSD-3-Clause
"""Calibration files of Kalibr: a camchain (lenses, mountings, time shift) and an IMU's noise.

Formats: github.com/ethz-asl/kalibr/wiki/yaml-formats. Directions are read from the keys and never guessed:
``T_cam_imu`` maps imu coordinates to the camera, ``T_imu_cam`` the other way round, ``T_cn_cnm1`` those of the camera
before to this one; ``timeshift_cam_imu`` is s in ``t_imu = t_cam + s``.
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
from coclo_vio.values.errors import CalibrationMissing, ConfigError, listing

_DISTORTIONS = ("radtan", "equidistant", "none")
_AGREE_M = 1e-3
_AGREE_RAD = 1e-3
_NOISE_KEYS = {
    "gyroscope_noise_density": "gyroscope_noise_density",
    "gyroscope_random_walk": "gyroscope_bias_walk",
    "accelerometer_noise_density": "accelerometer_noise_density",
    "accelerometer_random_walk": "accelerometer_bias_walk",
}


class KalibrConfig(StageConfig):
    """Calibration files of Kalibr that are taken in place of what a bag says."""

    camchain: Annotated[Path | None, Field(description="camchain-imucam YAML: lenses, mountings, time shift")] = None
    imu: Annotated[Path | None, Field(description="IMU YAML: noise densities and random walks")] = None
    calibrated_imu: Annotated[
        Literal["imu", "camera_imu"], Field(description="whose IMU both files speak of: the body's or the camera's")
    ] = "imu"


@dataclass(frozen=True, slots=True, eq=False)
class KalibrCamera:
    """One camera of a camchain.

    Attributes:
        lens: its intrinsics.
        T_camera_imu: maps imu coordinates to the camera, (4, 4).
        time_shift_s: stamp of an image plus this is the clock of the IMU, s.
        topic: the topic it was calibrated on, empty where the file does not say.
    """

    lens: CameraCalibration
    T_camera_imu: Array
    time_shift_s: float
    topic: str


@dataclass(frozen=True, slots=True)
class KalibrImu:
    """An IMU's noise, by the fields of ``ImuCalibration``, and the topic it was measured on (or empty)."""

    noise: dict[str, float]
    topic: str


def read_camchain(path: Path) -> tuple[KalibrCamera, ...]:
    """The cameras of a camchain, cam0 first.

    Raises:
        CalibrationMissing: a mounting that is absent, contradictory or no rigid transform, or a lens that is not read.
        ConfigError: no such file, or not YAML.
    """
    values = read_yaml(path)
    names = sorted((name for name in values if name.startswith("cam")), key=lambda name: (len(name), name))
    if not names:
        raise CalibrationMissing(f"{path} has no camera: the keys are {listing(map(str, values))}, not cam0, cam1")
    cameras: list[KalibrCamera] = []
    for name in names:
        where, camera = f"{path}, {name}", values[name]
        if not isinstance(camera, dict):
            raise CalibrationMissing(f"{where} must hold a mapping of keys, it holds a {type(camera).__name__}")
        T = _mounting(where, camera, cameras[-1].T_camera_imu if cameras else None)
        shift_s = _number(where, "timeshift_cam_imu", camera.get("timeshift_cam_imu", 0.0))
        cameras.append(KalibrCamera(_lens(where, camera), T, shift_s, str(camera.get("rostopic", ""))))
    return tuple(cameras)


def read_imu(path: Path) -> KalibrImu:
    """The noise in an IMU YAML, whose keys stand at the top or below ``imu0``.

    Raises:
        CalibrationMissing: none of the four noise keys, or one that is no number.
        ConfigError: no such file, or not YAML.
    """
    values = read_yaml(path)
    inner = values.get("imu0", values)
    values = inner if isinstance(inner, dict) else {}
    noise = {ours: _number(str(path), key, values[key]) for key, ours in _NOISE_KEYS.items() if key in values}
    if not noise:
        raise CalibrationMissing(
            f"{path} holds no noise of an IMU: none of {listing(_NOISE_KEYS)} "
            f"among its keys {listing(map(str, values))}"
        )
    return KalibrImu(noise, str(values.get("rostopic", "")))


def _mounting(where: str, camera: dict[str, Any], T_before_imu: Array | None) -> Array:
    """``T_camera_imu`` from ``T_cam_imu``, ``T_imu_cam`` or the chain; where several are there they must agree."""
    found: dict[str, Array] = {}
    if "T_cam_imu" in camera:
        found["T_cam_imu"] = _transform(where, "T_cam_imu", camera)
    if "T_imu_cam" in camera:
        found["T_imu_cam"] = se3.inverse(_transform(where, "T_imu_cam", camera))
    if "T_cn_cnm1" in camera and T_before_imu is not None:
        found["T_cn_cnm1"] = _transform(where, "T_cn_cnm1", camera) @ T_before_imu
    if not found:
        raise CalibrationMissing(
            f"{where} does not say where the camera is: it has none of T_cam_imu (imu to camera), T_imu_cam (camera to "
            f"imu) and, behind another camera, T_cn_cnm1; its keys are {listing(map(str, camera))}"
        )
    (first, T), *others = found.items()
    for key, other in others:
        apart = np.abs(se3.log(se3.inverse(T) @ other))
        if apart[:3].max() > _AGREE_RAD or apart[3:].max() > _AGREE_M:
            raise CalibrationMissing(
                f"{where}: {first} and {key} contradict each other by {np.rad2deg(np.linalg.norm(apart[:3])):.3g} deg "
                f"and {np.linalg.norm(apart[3:]):.3g} m; "
                "T_cam_imu maps imu to camera, T_imu_cam camera to imu; keep one"
            )
    return T


def _lens(where: str, camera: dict[str, Any]) -> CameraCalibration:
    model, distortion = camera.get("camera_model", "pinhole"), camera.get("distortion_model", "none")
    if model != "pinhole" or distortion not in _DISTORTIONS:
        raise CalibrationMissing(
            f"{where}: camera_model {model} with distortion_model {distortion} is not read; "
            f"calibrate it as pinhole with {' or '.join(_DISTORTIONS)}"
        )
    coefficients = _numbers(where, "distortion_coeffs", camera.get("distortion_coeffs", []))
    fx, fy, cx, cy = _numbers(where, "intrinsics", camera.get("intrinsics"), 4)
    width, height = _numbers(where, "resolution", camera.get("resolution"), 2)
    values = {
        "width_px": int(width),
        "height_px": int(height),
        "focal_px": (fx, fy),
        "principal_point_px": (cx, cy),
        "distortion": distortion,
        "distortion_coefficients": coefficients if distortion != "none" else (),
    }
    try:
        return CameraCalibration.parse(values, where)
    except ConfigError as error:
        raise CalibrationMissing(str(error)) from error


def _transform(where: str, key: str, camera: dict[str, Any]) -> Array:
    try:
        T = np.array(camera[key], dtype=np.float64).reshape(4, 4)
    except (TypeError, ValueError) as error:
        raise CalibrationMissing(f"{where}: {key} must be 4 rows of 4 numbers ({error})") from error
    rotation = T[:3, :3]
    is_rigid = np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3) and np.linalg.det(rotation) > 0
    if not is_rigid or not np.allclose(T[3], [0.0, 0.0, 0.0, 1.0]):
        raise CalibrationMissing(f"{where}: {key} is no rigid transform: its rotation or its last row is wrong")
    return T


def _number(where: str, key: str, value: Any) -> float:
    return _numbers(where, key, [value], 1)[0]


def _numbers(where: str, key: str, value: Any, count: int | None = None) -> tuple[float, ...]:
    try:
        numbers = tuple(float(number) for number in value)
    except (TypeError, ValueError) as error:
        raise CalibrationMissing(f"{where}: {key} = {value!r} must be numbers") from error
    if (count is not None and len(numbers) != count) or not np.isfinite(numbers).all():
        wanted = "" if count is None else f"{count} "
        raise CalibrationMissing(f"{where}: {key} = {value!r} must be {wanted}finite numbers")
    return numbers

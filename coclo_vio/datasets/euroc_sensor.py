# SPDX-License-Identifier: BSD-3-Clause
"""``sensor.yaml`` of the EuRoC layout, read and written: mounting, noise of an IMU, intrinsics of a camera.

``T_BS`` is ``T_body_sensor``, as rows of a 4 x 4 matrix. Of a camera: ``intrinsics`` fx, fy, cx, cy (px),
``resolution`` width, height (px), ``distortion_model`` radial-tangential or equidistant with its
``distortion_coefficients``. ``timeshift_cam_imu`` is Kalibr's: the stamp of an image plus this is the IMU's clock, s.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import CameraCalibration, ImuCalibration, StereoCalibration, matrix4
from coclo_vio.values.config import read_yaml
from coclo_vio.values.errors import CalibrationMissing, ConfigError, DatasetError, listing, shortened

SENSOR_YAML = "sensor.yaml"

_NOISE_KEYS = {
    "gyroscope_noise_density": "gyroscope_noise_density",
    "gyroscope_random_walk": "gyroscope_bias_walk",
    "accelerometer_noise_density": "accelerometer_noise_density",
    "accelerometer_random_walk": "accelerometer_bias_walk",
}
_BIAS_KEYS = (
    "grade",
    "gyroscope_bias",
    "gyroscope_scale",
    "accelerometer_bias",
)  # of this project, not of EuRoC: as in ImuCalibration
_DISTORTION_MODELS = {
    "radial-tangential": "radtan",
    "radtan": "radtan",
    "plumb_bob": "radtan",
    "equidistant": "equidistant",
    "none": "none",
}
_TIME_SHIFT = "timeshift_cam_imu"
_FARTHEST_M = 1e6


def read_sensor_yaml(path: Path) -> dict[str, Any]:
    """The mapping in a ``sensor.yaml``; its ``%YAML:1.0`` line and OpenCV tags are no obstacle.

    Raises:
        DatasetError: it cannot be read.
    """
    try:
        values = read_yaml(path)
    except ConfigError as error:
        raise DatasetError(str(error)) from error
    if not values:
        raise DatasetError(f"{path} must hold a mapping of keys to values, it is empty")
    return values


def mounting(path: Path, sensor: Mapping[str, Any]) -> Array | None:
    """``T_body_sensor`` (4, 4) from the key ``T_BS``, an OpenCV matrix or nested lists; None without it.

    Raises:
        DatasetError: it is not a rigid transform.
    """
    value = sensor.get("T_BS")
    if value is None:
        return None
    try:
        matrix = np.array(value["data"] if isinstance(value, dict) else value, dtype=np.float64).reshape(4, 4)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise DatasetError(f"{path}: T_BS must be a matrix of 4 x 4 numbers ({shortened(error)})") from error
    rotation = matrix[:3, :3]
    if not (np.abs(matrix) < _FARTHEST_M).all():
        raise DatasetError(f"{path}: T_BS must be finite, with a position below {_FARTHEST_M:g} m; correct the matrix")
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3) or np.linalg.det(rotation) < 0:
        raise DatasetError(f"{path}: the rotation of T_BS is not orthonormal; correct the matrix")
    return matrix


def read_imu(path: Path) -> ImuCalibration:
    """Mounting and noise of an IMU; the defaults for keys that the file lacks.

    Raises:
        DatasetError: the file is malformed.
        ConfigError: a noise density is out of bounds.
    """
    sensor = read_sensor_yaml(path)
    values: dict[str, Any] = {field: sensor[key] for key, field in _NOISE_KEYS.items() if key in sensor}
    values |= {key: sensor[key] for key in _BIAS_KEYS if key in sensor}
    T_body_imu = mounting(path, sensor)
    if T_body_imu is not None:
        values["position_body_m"] = tuple(T_body_imu[:3, 3].tolist())
        values["rotation_body_imu_rpy_rad"] = tuple(Rotation.from_matrix(T_body_imu[:3, :3]).as_euler("xyz").tolist())
    return ImuCalibration.parse(values, str(path))


def write_imu(folder: Path, imu: ImuCalibration) -> None:
    """Write ``sensor.yaml`` of an IMU into its folder."""
    noise = {key: getattr(imu, field) for key, field in _NOISE_KEYS.items()}
    noise |= {key: getattr(imu, key) for key in _BIAS_KEYS if key in imu.model_fields_set}
    _write(folder, {"sensor_type": "imu", "T_BS": _opencv_matrix(imu.T_body_imu), **noise})


def read_stereo(left: Path, right: Path) -> StereoCalibration:
    """Intrinsics and mountings of two cameras, from the ``sensor.yaml`` of each.

    Raises:
        CalibrationMissing: a file lacks a key; lists those it has.
        DatasetError: a file is malformed.
    """
    sensors = [read_sensor_yaml(path) for path in (left, right)]
    mountings = [_camera_mounting(path, sensor) for path, sensor in zip((left, right), sensors, strict=True)]
    values = {
        "left": _intrinsics(left, sensors[0]),
        "right": _intrinsics(right, sensors[1]),
        "body_left_camera": matrix4(mountings[0]),
        "body_right_camera": matrix4(mountings[1]),
        "time_offset_s": sensors[0].get(_TIME_SHIFT, 0.0),
    }
    try:
        return StereoCalibration.parse(values, f"the cameras of {left.parent.parent}")
    except ConfigError as error:
        raise DatasetError(str(error)) from error


def write_camera(folder: Path, intrinsics: CameraCalibration, T_body_camera: Array, time_offset_s: float) -> None:
    """Write ``sensor.yaml`` of a camera into its folder.

    A camera without distortion is written as radial-tangential with zeros, which every reader of the layout accepts.
    """
    is_undistorted = intrinsics.distortion == "none"
    values: dict[str, Any] = {
        "sensor_type": "camera",
        "T_BS": _opencv_matrix(T_body_camera),
        "resolution": [intrinsics.width_px, intrinsics.height_px],
        "camera_model": "pinhole",
        "intrinsics": [*intrinsics.focal_px, *intrinsics.principal_point_px],
        "distortion_model": "equidistant" if intrinsics.distortion == "equidistant" else "radial-tangential",
        "distortion_coefficients": [0.0] * 4 if is_undistorted else list(intrinsics.distortion_coefficients),
    }
    if time_offset_s:
        values[_TIME_SHIFT] = time_offset_s
    _write(folder, values)


def _camera_mounting(path: Path, sensor: Mapping[str, Any]) -> Array:
    T_body_camera = mounting(path, sensor)
    if T_body_camera is None:
        raise CalibrationMissing(f"{path} has no T_BS (T_body_camera); its keys are: {listing(sensor)}")
    return T_body_camera


def _intrinsics(path: Path, sensor: Mapping[str, Any]) -> CameraCalibration:
    missing = {"intrinsics", "resolution"} - set(sensor)
    if missing:
        raise CalibrationMissing(f"{path} has no {listing(missing)}; its keys are: {listing(sensor)}")
    intrinsics, resolution = sensor["intrinsics"], sensor["resolution"]
    if not isinstance(intrinsics, list) or len(intrinsics) != 4:
        raise DatasetError(f"{path}: intrinsics = {shortened(intrinsics)} must be the four numbers fx, fy, cx, cy, px")
    if not isinstance(resolution, list) or len(resolution) != 2:
        raise DatasetError(f"{path}: resolution = {shortened(resolution)} must be width and height in pixels")
    camera_model = sensor.get("camera_model", "pinhole")
    if camera_model != "pinhole":
        raise CalibrationMissing(
            f"{path}: camera_model {shortened(camera_model)} is not supported; calibrate the camera as pinhole with "
            f"{listing(_DISTORTION_MODELS)}"
        )
    model, coefficients = _distortion(path, sensor)
    values = {
        "width_px": resolution[0],
        "height_px": resolution[1],
        "focal_px": intrinsics[:2],
        "principal_point_px": intrinsics[2:],
        "distortion": model,
        "distortion_coefficients": coefficients,
    }
    try:
        return CameraCalibration.parse(values, str(path))
    except ConfigError as error:
        raise DatasetError(str(error)) from error


def _distortion(path: Path, sensor: Mapping[str, Any]) -> tuple[str, list[float]]:
    """The model and its coefficients; radial-tangential with zeros only means no distortion."""
    name = str(sensor.get("distortion_model", "none"))
    if name not in _DISTORTION_MODELS:
        raise DatasetError(
            f"{path}: distortion_model {shortened(name)!r} is not supported; "
            f"supported are {listing(_DISTORTION_MODELS)}"
        )
    model = _DISTORTION_MODELS[name]
    coefficients = sensor.get("distortion_coefficients") or []
    if not isinstance(coefficients, list):
        raise DatasetError(f"{path}: distortion_coefficients = {shortened(coefficients)} must be a list of numbers")
    is_undistorted = model == "none" or (model == "radtan" and not any(coefficients))
    return ("none", []) if is_undistorted else (model, coefficients)


def _opencv_matrix(T: Array) -> dict[str, Any]:
    return {"cols": 4, "rows": 4, "data": T.ravel().tolist()}


def _write(folder: Path, values: Mapping[str, Any]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    text = yaml.safe_dump(dict(values), sort_keys=False, default_flow_style=None)
    (folder / SENSOR_YAML).write_text(text, encoding="ascii")

# SPDX-License-Identifier: BSD-3-Clause
"""Intrinsics and the baseline of a rectified pair from ``sensor_msgs/CameraInfo`` (REP 104)."""

from typing import Any

import numpy as np

from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import CameraCalibration
from coclo_vio.values.errors import CalibrationMissing, ConfigError, shortened

_MODELS = {
    "": "radtan",
    "none": "radtan",
    "plumb_bob": "radtan",
    "radtan": "radtan",
    "rational_polynomial": "radtan",
    "equidistant": "equidistant",
    "fisheye": "equidistant",
    "kannala_brandt4": "equidistant",
}
_COEFFICIENTS = {"radtan": (4, 5, 8), "equidistant": (4,)}


def intrinsics_of(info: Any, topic: str, *, is_rectified: bool) -> CameraCalibration | None:
    """The intrinsics in a CameraInfo, or None where the camera is not calibrated (K is zero).

    Args:
        info: the message.
        topic: its topic, for error messages.
        is_rectified: whether the images are rectified: then P holds their focal lengths and there is no distortion.

    Raises:
        CalibrationMissing: a distortion model that is not supported.
    """
    K, P, D = _matrix(info, "k", (3, 3)), _matrix(info, "p", (3, 4)), np.asarray(_field(info, "d"), dtype=np.float64)
    pinhole = P if is_rectified and P[0, 0] > 0 else K
    if not (pinhole[0, 0] > 0 and pinhole[1, 1] > 0 and info.width and info.height):
        return None
    has_model = not is_rectified and (D.any() or _model_of(info) is None)
    model, coefficients = _distortion(info, D, topic) if has_model else ("none", ())
    values = {
        "width_px": int(info.width),
        "height_px": int(info.height),
        "focal_px": (float(pinhole[0, 0]), float(pinhole[1, 1])),
        "principal_point_px": (float(pinhole[0, 2]), float(pinhole[1, 2])),
        "distortion": model,
        "distortion_coefficients": coefficients,
    }
    try:
        return CameraCalibration.parse(values, topic)
    except ConfigError as error:
        raise CalibrationMissing(f"{error}; name a camchain in dataset.rosbag.kalibr") from error


def baseline_m(right: Any) -> float | None:
    """Position of a rectified pair's right camera on the left one's x axis, m: -Tx / fx of its P, or None."""
    P = _matrix(right, "p", (3, 4))
    return float(-P[0, 3] / P[0, 0]) if P[0, 0] > 0 and P[0, 3] != 0 else None


def T_camera_rectified(info: Any) -> Array:
    """Maps coordinates of the rectified camera to the real one, (4, 4): the inverse of R of the message."""
    T = np.eye(4)
    R = _matrix(info, "r", (3, 3))
    if np.allclose(R @ R.T, np.eye(3), atol=1e-3):
        T[:3, :3] = R.T
    return T


def _distortion(info: Any, D: Array, topic: str) -> tuple[str, tuple[float, ...]]:
    model = _model_of(info)
    longest = 0 if model is None else max(_COEFFICIENTS[model])
    coefficients = D[:longest] if not D[longest:].any() else D
    if model is None or len(coefficients) not in _COEFFICIENTS[model]:
        raise CalibrationMissing(
            f"{topic}: distortion {shortened(info.distortion_model)!r} with {len(D)} coefficients is not supported; "
            "supported are plumb_bob (4 or 5), rational_polynomial (8), equidistant (4); "
            "name a camchain in dataset.rosbag.kalibr"
        )
    return model, tuple(coefficients.tolist())


def _model_of(info: Any) -> str | None:
    """The package's name of the message's distortion model; None where it is not supported."""
    return _MODELS.get(info.distortion_model.lower())


def _field(info: Any, name: str) -> Any:
    """A field whose name is lower case in ROS 2 and upper case in ROS 1."""
    return getattr(info, name) if hasattr(info, name) else getattr(info, name.upper())


def _matrix(info: Any, name: str, shape: tuple[int, int]) -> Array:
    return np.asarray(_field(info, name), dtype=np.float64).reshape(shape)

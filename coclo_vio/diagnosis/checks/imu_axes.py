# SPDX-License-Identifier: BSD-3-Clause
"""An IMU's axes and signs: gyroscope against standing feet, accelerometer against the legs, the two IMUs together."""

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import uniform_filter1d

from coclo_vio.datasets.corrections import ImuCorrections, axes_matrix, axes_name
from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.feet import FeetRecord
from coclo_vio.diagnosis.finding import Finding, Stage, error, warning
from coclo_vio.diagnosis.rate_fit import AxesFit, RateFit, axes_of_feet, fit_rates
from coclo_vio.diagnosis.records import InertialRecord
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import ImuCalibration
from coclo_vio.values.units import NS_PER_S

_EXPLAINS = 0.85  # with other axes or another unit
_BETTER, _FAR_BETTER = 1.4, 2.0  # times less is left, where gravity agrees and where it does not
_TILT_DEG, _OTHER_AXES_DEG = 40.0, 60.0  # between gravity and the legs' up: slopes and stairs stay below 40
_SAME_AXES_DEG = 12.0  # from a rotation that turns axes into axes
_LEAST_CORRELATION = 0.8  # of two gyroscopes, so that their difference is one of axes
_SMALL_TURN_DEG, _OF_SMALL_TURN = 30.0, 0.97  # a delay between the two looks like a small turn, with less correlation
_MOUNTING_DEG = 8.0
_SCALE = 0.2
_SMOOTHED_S = 0.1


def find_body_axes(evidence: Evidence) -> Iterator[Finding]:
    """The body's IMU against the legs."""
    imu, feet, mounting = evidence.imu, evidence.feet, evidence.robot_imu
    if imu is None or feet is None or mounting is None:
        return
    fit = axes_of_feet(feet, imu.stamps_ns, imu.rate @ mounting.T_body_imu[:3, :3].T)
    turned = contradiction(fit)
    if turned is not None and turned.best_unit != "rad/s":
        yield error(
            "imu_rate_unit",
            Stage.IMU,
            "imu",
            f"the body's gyroscope turns {np.rad2deg(1.0):.0f} times as fast as the standing feet: its unit is "
            f"{turned.best_unit}; set dataset.corrections.imu.rate_unit={turned.best_unit}",
            f"dataset.corrections.imu.rate_unit={turned.best_unit}",
            is_certain=True,
        )
    axes = "x y z" if turned is None else turned.best_axes
    if turned is not None and axes != "x y z":
        yield _turned_axes(turned, mounting, imu, feet, evidence.corrections.imu)
    else:
        yield from _gravity(evidence, imu, feet, mounting, is_seen_by_feet=_is_good(fit))


def contradiction(fit: AxesFit | None) -> AxesFit | None:
    """The fit, if it says that readings are in another unit or other axes."""
    if fit is None or fit.best_residual > _EXPLAINS:
        return None
    return fit if fit.residual > _BETTER * fit.best_residual else None


def _is_good(fit: AxesFit | None) -> bool:
    return fit is not None and fit.residual < _EXPLAINS


def _turned_axes(
    fit: AxesFit, mounting: ImuCalibration, imu: InertialRecord, feet: FeetRecord, before: ImuCorrections
) -> Finding:
    """The gyroscope fits the feet with other axes: those of the recording, or another mounting."""
    axes = fit.best_axes
    R_body_imu = mounting.T_body_imu[:3, :3]
    own = R_body_imu.T @ axes_matrix(axes) @ R_body_imu
    up = feet.up_body
    force = axes_matrix(axes) @ R_body_imu @ np.median(imu.force, axis=0)
    agrees = up is not None and _angle_deg(force, up) < _TILT_DEG
    make = error if agrees or fit.residual > _FAR_BETTER * fit.best_residual else warning
    said = "and so gravity points up" if agrees else "though gravity then does not point up"
    start = f"the body's gyroscope contradicts the standing feet; with its body axes taken as '{axes}' it fits, {said}"
    if _angle_to_axes_deg(own) < _SAME_AXES_DEG:
        setting = f"dataset.corrections.imu.axes={axes_name(own @ before.rotation)}"
        return make("imu_axes", Stage.IMU, "imu", f"{start}; set {setting}", setting, is_certain=agrees)
    rpy = ", ".join(f"{value:.4f}" for value in _rpy(axes_matrix(axes) @ R_body_imu))
    setting = f"robot.imu.rotation_body_imu_rpy_rad=[{rpy}]"
    return make("imu_axes", Stage.IMU, "imu", f"{start}; set {setting}", setting)


def _gravity(
    evidence: Evidence, imu: InertialRecord, feet: FeetRecord, mounting: ImuCalibration, *, is_seen_by_feet: bool
) -> Iterator[Finding]:
    """The mean specific force against the direction from the feet to the body."""
    up = feet.up_body
    if up is None:
        return
    force = mounting.T_body_imu[:3, :3] @ np.median(imu.force, axis=0)
    angle_deg = _angle_deg(force, up)
    if angle_deg < _TILT_DEG:
        return
    start = (
        f"gravity by the body's accelerometer is {angle_deg:.0f} deg from the direction in which feet carry the body"
    )
    if _angle_deg(-force, up) < _TILT_DEG:
        setting = f"dataset.corrections.imu.acceleration_sign={-evidence.corrections.imu.acceleration_sign}"
        fits = (
            "its gyroscope fits the feet, so the sign of the accelerometer is the other one"
            if is_seen_by_feet
            else ("its sign is the other one, or its axes are upside down (NED: dataset.corrections.imu.axes=x -y -z)")
        )
        yield error(
            "imu_acceleration_sign",
            Stage.IMU,
            "imu",
            f"{start}: {fits}; set {setting}",
            setting,
            is_certain=is_seen_by_feet,
        )
        return
    sentence = (
        f"{start} (at most {_TILT_DEG:.0f} on slopes and stairs): axes or mounting are others; check "
        "robot.imu.rotation_body_imu_rpy_rad and dataset.corrections.imu.axes"
    )
    make = error if angle_deg > _OTHER_AXES_DEG else warning
    yield make("imu_mounting", Stage.IMU, "imu", sentence)


def find_camera_imu_axes(evidence: Evidence) -> Iterator[Finding]:
    """The camera's IMU against the body's: unit, axes, mounting and gravity; not where the body's contradicts feet."""
    body, camera, of_body = evidence.imu, evidence.camera_imu, evidence.robot_imu
    mounting, before = evidence.calibrations.camera_imu, evidence.corrections.camera_imu
    if body is None or camera is None or of_body is None or mounting is None:
        return
    R_body, R_camera = of_body.T_body_imu[:3, :3], mounting.T_body_imu[:3, :3]
    if evidence.feet is not None and contradiction(axes_of_feet(evidence.feet, body.stamps_ns, body.rate @ R_body.T)):
        return
    times_ns = _common_times(body, camera)
    if len(times_ns) < 2:
        return
    fit = fit_rates(_smoothed(body, R_body, times_ns), _smoothed(camera, R_camera, times_ns))
    if fit is None or fit.correlation < _LEAST_CORRELATION:
        return
    yield from _camera_scale(fit)
    is_clear = fit.angle_deg > _SMALL_TURN_DEG or fit.correlation > _OF_SMALL_TURN
    if fit.is_determined and fit.angle_deg > _MOUNTING_DEG and is_clear:
        yield _camera_mounting(fit, R_camera, body, camera, R_body, before)
        return
    force, up = R_camera @ np.median(camera.force, axis=0), R_body @ np.median(body.force, axis=0)
    if _angle_deg(-force, up) < _TILT_DEG:
        setting = f"dataset.corrections.camera_imu.acceleration_sign={-before.acceleration_sign}"
        yield error(
            "camera_imu_acceleration_sign",
            Stage.IMU,
            "camera_imu",
            f"gravity by the camera's accelerometer is {_angle_deg(force, up):.0f} deg from that by the body's while "
            f"their gyroscopes agree: its sign is the other one; set {setting}",
            setting,
            is_certain=True,
        )
    elif _angle_deg(force, up) > _SAME_AXES_DEG and min(np.linalg.norm(force), np.linalg.norm(up)) > 1e-6:
        yield warning(
            "imus_disagree_on_gravity",
            Stage.IMU,
            "camera_imu imu",
            f"gravity by the two IMUs is {_angle_deg(force, up):.0f} deg apart in body axes while their gyroscopes "
            "agree; calibrate both accelerometers, one has a large bias or other axes",
        )


def _camera_scale(fit: RateFit) -> Iterator[Finding]:
    for unit, factor in (("deg/s", np.pi / 180.0), ("rpm", 2.0 * np.pi / 60.0)):
        if abs(fit.scale / factor - 1.0) < _SCALE:
            setting = f"dataset.corrections.camera_imu.rate_unit={unit}"
            yield error(
                "camera_imu_rate_unit",
                Stage.IMU,
                "camera_imu",
                f"the camera's gyroscope reads {1.0 / fit.scale:.1f} times the body's; its unit is {unit}: set "
                f"{setting}",
                setting,
                is_certain=True,
            )
            return
    for unit, factor in (("deg/s", np.pi / 180.0), ("rpm", 2.0 * np.pi / 60.0)):
        if abs(fit.scale * factor - 1.0) < _SCALE:
            setting = f"dataset.corrections.imu.rate_unit={unit}"
            yield error(
                "imu_rate_unit",
                Stage.IMU,
                "imu",
                f"the body's gyroscope reads {fit.scale:.1f} times the camera's: its unit is {unit}; set {setting}",
                setting,
            )
            return
    if abs(fit.scale - 1.0) > _SCALE:
        yield error(
            "imus_disagree_on_rate",
            Stage.IMU,
            "camera_imu imu",
            f"the camera's gyroscope reads {1.0 / fit.scale:.2f} times the body's; one of them is in another unit: "
            "convert it to rad/s",
        )


def _camera_mounting(
    fit: RateFit,
    R_camera: Array,
    body: InertialRecord,
    camera: InertialRecord,
    R_body: Array,
    before: ImuCorrections,
) -> Finding:
    own = R_camera.T @ fit.rotation @ R_camera
    force, up = fit.rotation @ R_camera @ np.median(camera.force, axis=0), R_body @ np.median(body.force, axis=0)
    agrees = _angle_deg(force, up) < _TILT_DEG
    start = (
        f"the camera's gyroscope turns about axes {fit.angle_deg:.0f} deg from those of the body's, by its mounting "
        f"(correlation {fit.correlation:.2f} without that turn)"
    )
    if _angle_to_axes_deg(own) < _SAME_AXES_DEG and axes_name(own) != "x y z":
        setting = f"dataset.corrections.camera_imu.axes={axes_name(own @ before.rotation)}"
        return error("camera_imu_axes", Stage.IMU, "camera_imu", f"{start}; set {setting}", setting, is_certain=agrees)
    make = error if fit.angle_deg > _SMALL_TURN_DEG else warning  # a fusion estimates a small turn
    return make(
        "camera_imu_mounting",
        Stage.MOUNTING,
        "camera_imu",
        f"{start}; correct T_body_camera_imu of the calibration (left of its rotation, rotation vector "
        f"{np.round(so3.log(fit.rotation), 3).tolist()} rad)",
    )


def _common_times(one: InertialRecord, other: InertialRecord) -> Array:
    """Times every 20 ms at which both have readings, ns."""
    start_ns, end_ns = max(one.stamps_ns[0], other.stamps_ns[0]), min(one.stamps_ns[-1], other.stamps_ns[-1])
    return np.arange(start_ns, end_ns, NS_PER_S // 50)


def _smoothed(record: InertialRecord, rotation_body_imu: Array, times_ns: Array) -> Array:
    """Rates in body axes, rad/s, as means over 0.1 s at times (N,), (N, 3)."""
    step_s = float(np.median(np.diff(record.stamps_ns))) / NS_PER_S
    width = max(1, round(_SMOOTHED_S / max(step_s, 1e-4)))
    rates = uniform_filter1d(record.rate @ rotation_body_imu.T, width, axis=0)
    own_s, times_s = ((stamps - record.stamps_ns[0]) / NS_PER_S for stamps in (record.stamps_ns, times_ns))
    return np.column_stack([np.interp(times_s, own_s, column) for column in rates.T])


def _angle_deg(one: Array, other: Array) -> float:
    sizes = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(np.degrees(np.arccos(np.clip(one @ other / max(sizes, 1e-12), -1.0, 1.0))))


def _angle_to_axes_deg(rotation: Array) -> float:
    """Angle between a rotation and the nearest one that turns axes into axes, degrees."""
    nearest = axes_matrix(axes_name(rotation))
    if abs(np.linalg.det(nearest) - 1.0) > 0.5:
        return 180.0
    return float(np.degrees(np.linalg.norm(so3.log(nearest.T @ rotation))))


def _rpy(rotation: Array) -> tuple[float, float, float]:
    """Roll, pitch and yaw (R = Rz Ry Rx), rad."""
    pitch = float(np.arcsin(np.clip(-rotation[2, 0], -1.0, 1.0)))
    return float(np.arctan2(rotation[2, 1], rotation[2, 2])), pitch, float(np.arctan2(rotation[1, 0], rotation[0, 0]))

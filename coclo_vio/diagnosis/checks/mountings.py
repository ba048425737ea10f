# SPDX-License-Identifier: BSD-3-Clause
"""Mountings by angular velocities against those of the calibration: IMU on the legs' body, cameras on the IMU's."""

from collections.abc import Iterator

import numpy as np

from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.finding import Finding, Stage, note, warning
from coclo_vio.diagnosis.rate_fit import RateFit, fit_rates, turn_of_feet
from coclo_vio.diagnosis.rates import clock_offset, smoothed_rates
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.trajectory import Trajectory
from coclo_vio.values.units import NS_PER_S

_OF_LEGS_DEG, _OF_CAMERAS_DEG = 6.0, 2.0  # legs bend and slip, so that they measure it worse
_SIGMAS = 4.0
_LEAST_CORRELATION = 0.9
_WINDOW_S = 0.15
_PARTS = 3


def find_mountings(evidence: Evidence) -> Iterator[Finding]:
    """Mountings of the body's IMU and of the cameras that motion contradicts."""
    imu, mounting, feet = evidence.imu, evidence.robot_imu, evidence.feet
    if imu is not None and mounting is not None and feet is not None:
        found = turn_of_feet(feet, imu.stamps_ns, imu.rate @ mounting.T_body_imu[:3, :3].T)
        if found is not None:
            yield from _judged("imu_mounting", "imu", "the body's IMU turns", "the legs", *found, _OF_LEGS_DEG)
    reference, name = evidence.attitudes_by_imu, "the body's IMU"
    if reference is None:
        reference, name = evidence.attitudes_by_camera_imu, "the camera's IMU"
    seen = evidence.attitudes_by_cameras
    if reference is not None and seen is not None:
        turn = _turn_of_cameras(reference, seen)
        if turn is not None:
            yield from _judged("camera_mounting", "stereo", "the cameras turn", name, *turn, _OF_CAMERAS_DEG)


def _turn_of_cameras(reference: Trajectory, seen: Trajectory) -> tuple[Array, Array] | None:
    """Rotation from the cameras' claimed axes to the IMU's and its sigma, rad, (3,) each; None where not determined."""
    offset = clock_offset(reference, seen)
    if offset is None:
        return None
    moved = seen.restamped(seen.stamps_ns + round(offset.seconds * NS_PER_S))
    start_ns, duration_s = int(moved.stamps_ns[0]), moved.duration_s
    _, true = smoothed_rates(reference, start_ns, duration_s, _WINDOW_S)
    _, measured = smoothed_rates(moved, start_ns, duration_s, _WINDOW_S)
    whole = fit_rates(true, measured)
    parts = [
        fit_rates(*pair) for pair in zip(*(np.array_split(each, _PARTS) for each in (true, measured)), strict=True)
    ]
    if whole is None or not _is_good(whole) or not all(part is not None and part.is_determined for part in parts):
        return None
    turns = np.array([so3.log(part.rotation) for part in parts if part is not None])
    return np.asarray(so3.log(whole.rotation)), np.asarray(turns.std(axis=0, ddof=1) / np.sqrt(_PARTS))


def _is_good(fit: RateFit) -> bool:
    return fit.is_determined and fit.correlation > _LEAST_CORRELATION


def _judged(
    kind: str, stream: str, whose: str, reference: str, turn: Array, sigma: Array, limit_deg: float
) -> Iterator[Finding]:
    """A warning where a mounting is off by more than the limit and by four sigmas, otherwise a note if it is known."""
    angle_deg, sigma_deg = (float(np.degrees(np.linalg.norm(each))) for each in (turn, sigma))
    x, y, z = np.degrees(turn)
    measured = f"({x:.1f}, {y:.1f}, {z:.1f}) +- {sigma_deg:.1f} deg"
    if angle_deg > max(limit_deg, _SIGMAS * sigma_deg):
        yield warning(
            kind,
            Stage.MOUNTING,
            stream,
            f"{whose} about axes that are {measured} (rotation vector in the body) from those of {reference}, at most "
            f"{limit_deg:g} deg is expected: correct the rotation of its mounting by that, from the left",
        )
    elif sigma_deg < limit_deg:
        yield note(kind, Stage.MOUNTING, stream, f"{whose} {measured} from {reference}")

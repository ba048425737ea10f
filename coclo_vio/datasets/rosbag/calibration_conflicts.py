# SPDX-License-Identifier: BSD-3-Clause
"""Where two sources have different numbers for the same cameras, and which of them counts."""

from collections.abc import Iterator

import numpy as np

from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import CameraCalibration, StereoCalibration

_FOCAL, _BASELINE = 0.02, 0.03  # relative
_PRINCIPAL_PX = 5.0
_PAIR_DEG, _MOUNTING_DEG, _MOUNTING_M = 1.0, 3.0, 0.03


def stereo_conflicts(used: StereoCalibration, source: str, other: StereoCalibration, rival: str) -> Iterator[str]:
    """What the calibration that is used and another one contradict, a sentence each.

    Args:
        used: the calibration that counts.
        source: where it comes from.
        other: another calibration of the same cameras.
        rival: where that comes from.
    """
    for side in ("left", "right"):
        yield from _lens_conflicts(side, getattr(used, side), source, getattr(other, side), rival)
    if abs(used.baseline_m / max(other.baseline_m, 1e-9) - 1.0) > _BASELINE:
        yield baseline_conflict(used.baseline_m, source, other.baseline_m, rival)
    pairs = [se3.inverse(each.T_body_left_camera) @ each.T_body_right_camera for each in (used, other)]
    apart_deg = _apart_deg(*pairs)
    if apart_deg > _PAIR_DEG:
        yield (
            f"the rotation between the two cameras differs by {apart_deg:.1f} deg between {source} and {rival}: "
            f"{source} is used; correct the one that is wrong"
        )
    mountings = used.T_body_left_camera, other.T_body_left_camera
    apart_deg, apart_m = _apart_deg(*mountings), float(np.linalg.norm(mountings[0][:3, 3] - mountings[1][:3, 3]))
    if apart_deg > _MOUNTING_DEG or apart_m > _MOUNTING_M:
        yield (
            f"the mounting of the left camera differs by {apart_deg:.1f} deg and {apart_m:.3f} m between {source} and "
            f"{rival}: {source} is used; correct the one that is wrong"
        )


def baseline_conflict(used_m: float, source: str, other_m: float, rival: str) -> str:
    """The sentence on two baselines."""
    return (
        f"the baseline of the cameras is {used_m:.4g} m by {source} and {other_m:.4g} m by {rival}: {source} is used, "
        "and every distance scales with it; correct the one that is wrong"
    )


def _lens_conflicts(
    side: str, used: CameraCalibration, source: str, other: CameraCalibration, rival: str
) -> Iterator[str]:
    if (used.width_px, used.height_px) != (other.width_px, other.height_px):
        yield (
            f"the {side} image has {used.width_px} x {used.height_px} px by {source} and {other.width_px} x "
            f"{other.height_px} by {rival}: {source} is used; scale the calibration to the images' size"
        )
        return
    if abs(used.focal_px[0] / other.focal_px[0] - 1.0) > _FOCAL:
        yield (
            f"the focal length of the {side} camera is {used.focal_px[0]:.1f} px by {source} and "
            f"{other.focal_px[0]:.1f} "
            f"by {rival}: {source} is used; correct the one that is wrong"
        )
    centres = np.array(used.principal_point_px), np.array(other.principal_point_px)
    if float(np.abs(centres[0] - centres[1]).max()) > _PRINCIPAL_PX:
        (x, y), (u, v) = centres
        yield (
            f"the principal point of the {side} camera is ({x:.1f}, {y:.1f}) px by {source} and ({u:.1f}, {v:.1f}) by "
            f"{rival}: {source} is used; correct the one that is wrong"
        )


def _apart_deg(one: Array, other: Array) -> float:
    return float(np.degrees(np.linalg.norm(so3.log(one[:3, :3].T @ other[:3, :3]))))

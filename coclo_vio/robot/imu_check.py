# SPDX-License-Identifier: BSD-3-Clause
"""The mounting of the IMU in a description against that of the IMU links of its URDF."""

import re
from collections.abc import Iterator

import numpy as np

from coclo_vio.geometry import so3
from coclo_vio.robot.description import RobotDescription
from coclo_vio.robot.description_finding import DescriptionFinding
from coclo_vio.robot.urdf_tree import UrdfTree
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import listing

_IMU_WORDS = re.compile(r"(?i)(?<![a-z])imu(?![a-z])|inertial_unit|gyro")
_CAMERA_WORDS = re.compile(r"(?i)cam|optical|d435|d455|t265|realsense|lidar|accel(?:erometer)?_")
_PLACE_M = 5e-3
_TURN_RAD = 0.035


def imu_links(tree: UrdfTree, body: str) -> dict[str, Array]:
    """``T_body_imu`` (4, 4) of each IMU of the URDF that is fixed to a link, cameras' IMUs left out."""
    placed = tree.placements()
    rigid = set(tree.rigid_with(body)) if body in tree.links else set()
    return {
        link: np.linalg.inv(placed[body]) @ placed[link]
        for link in tree.links
        if link in rigid and _IMU_WORDS.search(link) and not _CAMERA_WORDS.search(link)
    }


def imu_findings(tree: UrdfTree, description: RobotDescription, body: str) -> Iterator[DescriptionFinding]:
    """A mounting on the link of the body that is none of those that the URDF gives, or that the description omits."""
    given = description.imu.T_body_imu
    found = imu_links(tree, body)
    if not found or any(_apart(given, mounting) is None for mounting in found.values()):
        return
    link, mounting = min(found.items(), key=lambda item: _difference(given, item[1]))
    x, y, z = (round(float(value), 6) + 0.0 for value in mounting[:3, 3])
    roll, pitch, yaw = (round(angle, 6) + 0.0 for angle in roll_pitch_yaw(mounting[:3, :3]))
    settings = (
        f"imu.position_body_m: [{x:g}, {y:g}, {z:g}]",
        f"imu.rotation_body_imu_rpy_rad: [{roll:g}, {pitch:g}, {yaw:g}]",
    )
    set_fields = description.imu.model_fields_set & {"position_body_m", "rotation_body_imu_rpy_rad"}
    others = f" (of {listing(found)} the nearest)" if len(found) > 1 else ""
    yield DescriptionFinding(
        "imu_mounting_differs" if set_fields else "imu_mounting_left_out",
        False,
        f"the URDF has an IMU {link!r}{others} at {x:g}, {y:g}, {z:g} m with roll, pitch, yaw {roll:g}, {pitch:g}, "
        f"{yaw:g} rad, {_apart(given, mounting)} from the description; if the log is of this IMU, in its own axes, set "
        "imu.position_body_m and imu.rotation_body_imu_rpy_rad to these",
        settings,
    )


def roll_pitch_yaw(rotation: Array) -> tuple[float, float, float]:
    """Roll, pitch and yaw of a rotation (3, 3) in URDF's order, R = Rz Ry Rx, rad."""
    pitch = float(np.arcsin(np.clip(-rotation[2, 0], -1.0, 1.0)))
    return float(np.arctan2(rotation[2, 1], rotation[2, 2])), pitch, float(np.arctan2(rotation[1, 0], rotation[0, 0]))


def _turn_rad(given: Array, mounting: Array) -> float:
    return float(np.linalg.norm(so3.log(given[:3, :3].T @ mounting[:3, :3])))


def _difference(given: Array, mounting: Array) -> float:
    return _turn_rad(given, mounting) + float(np.linalg.norm(given[:3, 3] - mounting[:3, 3]))


def _apart(given: Array, mounting: Array) -> str | None:
    """How far two mountings are apart; None where they agree."""
    away_m, turn_rad = float(np.linalg.norm(given[:3, 3] - mounting[:3, 3])), _turn_rad(given, mounting)
    if away_m <= _PLACE_M and turn_rad <= _TURN_RAD:
        return None
    return f"{away_m:.3f} m and {np.degrees(turn_rad):.1f} degrees away"

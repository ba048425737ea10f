# SPDX-License-Identifier: BSD-3-Clause
"""Robots with any number of equal legs of three joints, spread around a disc, for costs that grow with the legs."""

import math
from pathlib import Path

from coclo_vio.robot.contact import ContactConfig
from coclo_vio.robot.description import LegDescription, RobotDescription

_BODY_RADIUS_M = 0.25
_FOOT_RADIUS_M = 0.02
_STANDING_RAD = (0.0, -0.5, 1.4)
_MASS_PER_LEG_KG = 3.0

_LINK = """<link name="{name}"><inertial><origin xyz="{half} 0 0"/><mass value="0.3"/>
<inertia ixx="1e-4" iyy="2e-3" izz="2e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
_JOINT = """<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{x} {y} 0" rpy="0 0 {yaw}"/><axis xyz="{axis}"/>
<limit lower="-3" upper="3" effort="60" velocity="20"/></joint>"""
_FOOT = """<link name="{leg}_foot"/><joint name="{leg}_ankle" type="fixed"><parent link="{leg}_lower"/>
<child link="{leg}_foot"/><origin xyz="0.32 0 0"/></joint>"""


def robot_with_legs(legs: int, folder: Path) -> RobotDescription:
    """The robot; contact from foot forces.

    Args:
        legs: number of legs, 1 or more.
        folder: where its URDF is written.
    """
    names = [f"leg{index + 1}" for index in range(legs)]
    path = folder / f"robot_with_{legs}_legs.urdf"
    path.write_text(_urdf(names), encoding="utf-8")
    return RobotDescription(
        name=path.stem,
        urdf=str(path),
        legs=tuple(
            LegDescription(
                name=leg,
                joints=(f"{leg}_base", f"{leg}_shoulder", f"{leg}_elbow"),
                foot_frame=f"{leg}_foot",
                foot_radius_m=_FOOT_RADIUS_M,
            )
            for leg in names
        ),
        contact=ContactConfig(source="force_sensor", on_force=10.0, off_force=5.0),
        filter={},
    )


def standing_rad(legs: int) -> tuple[float, ...]:
    """Joint angles of a stand of this robot, rad, leg by leg."""
    return _STANDING_RAD * legs


def _urdf(legs: list[str]) -> str:
    mass_kg = _MASS_PER_LEG_KG * len(legs)
    body = (
        f'<link name="body"><inertial><mass value="{mass_kg}"/>'
        '<inertia ixx="0.2" iyy="0.2" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    parts = [_leg(leg, math.pi * (2 * index + 1) / len(legs)) for index, leg in enumerate(legs)]
    return f'<robot name="bench">{body}{"".join(parts)}</robot>'


def _leg(leg: str, angle_rad: float) -> str:
    """Base about z at the rim of the body, shoulder and elbow about y, the foot at the end."""
    x, y = _BODY_RADIUS_M * math.cos(angle_rad), _BODY_RADIUS_M * math.sin(angle_rad)
    joints = (
        ("base", "body", "hip", x, y, angle_rad, "0 0 1"),
        ("shoulder", "hip", "upper", 0.06, 0.0, 0.0, "0 1 0"),
        ("elbow", "upper", "lower", 0.28, 0.0, 0.0, "0 1 0"),
    )
    text = "".join(
        _JOINT.format(
            name=f"{leg}_{name}",
            parent=parent if parent == "body" else f"{leg}_{parent}",
            child=f"{leg}_{child}",
            x=at_x,
            y=at_y,
            yaw=yaw,
            axis=axis,
        )
        for name, parent, child, at_x, at_y, yaw, axis in joints
    )
    links = "".join(
        _LINK.format(name=f"{leg}_{link}", half=half)
        for link, half in (("hip", 0.03), ("upper", 0.14), ("lower", 0.16))
    )
    return f"{links}{text}{_FOOT.format(leg=leg)}"

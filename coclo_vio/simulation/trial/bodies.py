# SPDX-License-Identifier: BSD-3-Clause
"""What the specifications of all robots share: the URDF's links, the settings of the physics, ground, soles of feet."""

from collections.abc import Iterable
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from coclo_vio.robot.description import RobotDescription, urdf_path
from coclo_vio.simulation.trial.terrain import Box
from coclo_vio.values.units import GRAVITY_MPS2

COLLISION_GROUP = 3  # not rendered
TRUNK, LEG, FOOT, GROUND = 1, 2, 4, 8  # bits of contype: which geoms collide
_PLACEHOLDER_KG = 1e-4
_NO_TORSION, _WITH_TORSION = 3, 4  # MuJoCo's dimension of a contact


def urdf_with_own_links(description: RobotDescription, *, with_shapes: bool = True) -> str:
    """The URDF's text with the options that make MuJoCo keep every link and every inertia unchanged.

    Args:
        description: names the URDF.
        with_shapes: keep its visual and collision shapes; without them no mesh file is read, and placeholder masses
            below 0.1 g, whose inertia may be impossible, are left out too.
    """
    root = ElementTree.parse(urdf_path(description)).getroot()
    if not with_shapes:
        for link in root.findall("link"):
            for shape in [*link.findall("visual"), *link.findall("collision")]:
                link.remove(shape)
            mass = link.find("inertial/mass")
            if mass is not None and float(mass.attrib["value"]) < _PLACEHOLDER_KG:
                link.remove(link.find("inertial"))  # type: ignore[arg-type]  # it has a mass
    extension = ElementTree.SubElement(root, "mujoco")
    ElementTree.SubElement(extension, "compiler", {"fusestatic": "false", "balanceinertia": "false"})
    return ElementTree.tostring(root, encoding="unicode")


def set_physics(spec: mujoco.MjSpec, time_step_s: float) -> None:
    """Settings of FIELD_NOTES' recipe: stiff contacts, elliptic cones, implicit damping."""
    option = spec.option
    option.timestep = time_step_s
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = 100.0  # at 10 a standing foot creeps down the ramp at 2 mm/s: an artefact of soft friction
    option.gravity = np.array([0.0, 0.0, -GRAVITY_MPS2])


def add_ground(spec: mujoco.MjSpec, boxes: Iterable[Box], friction: float) -> None:
    """Solid boxes, named ``ground0`` and so on, on which feet, legs and trunk stand."""
    for index, box in enumerate(boxes):
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, np.ascontiguousarray(box.rotation).ravel())
        spec.worldbody.add_geom(
            name=f"ground{index}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=box.centre,
            quat=quat,
            size=box.half_size,
            contype=GROUND,
            conaffinity=TRUNK | LEG | FOOT,
            **contact_settings(friction),
            group=COLLISION_GROUP,
        )


def contact_settings(friction: float, torsion_m: float = 0.0) -> dict[str, Any]:
    """Coulomb friction of a geom, and its torsional friction (a length, m) where there is one."""
    dimension = _WITH_TORSION if torsion_m > 0.0 else _NO_TORSION
    return {"friction": [friction, torsion_m or 0.005, 0.0001], "condim": dimension, "solref": [0.005, 1.0]}


def add_sole(
    foot: Any, name: str, radius_m: float, contact: dict[str, Any], centre_m: tuple[float, float, float] = (0.0,) * 3
) -> None:
    """The sphere of a foot, named as the foot, and the site of its touch sensor."""
    foot.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        pos=centre_m,
        size=[radius_m, 0.0, 0.0],
        contype=FOOT,
        conaffinity=GROUND | LEG,
        **contact,
        mass=0.0,
        group=1,
        rgba=[0.05, 0.05, 0.05, 1.0],
    )
    foot.add_site(name=f"{name}_sole", pos=centre_m, size=[radius_m * 1.05, 0.0, 0.0], group=4)


def add_touch_sensor(spec: mujoco.MjSpec, name: str) -> None:
    """The normal force on the sole of ``add_sole``."""
    spec.add_sensor(
        name=f"{name}_touch",
        type=mujoco.mjtSensor.mjSENS_TOUCH,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname=f"{name}_sole",
    )

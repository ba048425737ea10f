# SPDX-License-Identifier: BSD-3-Clause
"""The robot as a view draws it: the parts of its links, where its joints place them, its feet and their forces."""

import logging
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

import numpy as np

from coclo_vio.geometry import se3
from coclo_vio.robot.description import RobotDescription, urdf_path
from coclo_vio.robot.model import RobotModel
from coclo_vio.robot.urdf_tree import placement_of, read_urdf_tree
from coclo_vio.values.arrays import Array
from coclo_vio.values.measurements import JointSample
from coclo_vio.values.units import GRAVITY_MPS2
from coclo_vio.views.canvas import Shape

_log = logging.getLogger(__name__)
_LEAST_FOOT_M = 0.02
_MESHES = {".stl", ".obj", ".dae", ".glb", ".gltf"}


class DrawnRobot:
    """Kinematics of all links by the URDF; joints without a reading stay where they were."""

    def __init__(self, description: RobotDescription) -> None:
        """Read the URDF.

        Raises:
            RobotModelError: it cannot be read, or lacks what the description names.
        """
        path = urdf_path(description)
        self._tree = read_urdf_tree(path)
        self._model = RobotModel(description)
        self._names = description.joint_names
        self._angles = dict.fromkeys(self._names, 0.0)
        self._body = description.body_frame or self._tree.root
        self.leg_names = description.leg_names
        self.shapes = (*_shapes(path), *self._skeleton())

    def place(self, joints: JointSample) -> Mapping[str, Array]:
        """``T_body_link`` (4, 4) of every link at a reading of the joints."""
        for name, angle in zip(self._names, joints.position.tolist(), strict=True):
            if np.isfinite(angle):
                self._angles[name] = angle
        placed = self._tree.placements(self._angles)
        T_body_root = se3.inverse(placed[self._body])
        return {link: np.asarray(T_body_root @ T_root_link) for link, T_root_link in placed.items()}

    def feet(self, joints: JointSample) -> Array:
        """Foot centres, m, body frame, (legs, 3); NaN of a leg with a joint that is not known."""
        return self._model.feet(joints.position, joints.velocity).position_body

    def forces(self, joints: JointSample, R_world_body: Array) -> Array:
        """Forces of the ground on the feet from the joints' torques, N, body frame, (legs, 3); NaN where unknown.

        The weight of the legs is compensated, their motion is not.
        """
        up = GRAVITY_MPS2 * R_world_body[2]
        return self._model.foot_forces(joints.position, joints.velocity, joints.effort, specific_force_body=up)

    @property
    def foot_m(self) -> float:
        """Radius with which a foot is drawn, m: half as much again as its own, so that its colour shows."""
        return max(_LEAST_FOOT_M, 1.5 * float(self._model.foot_radii_m.max()))

    @property
    def weight_n(self) -> float:
        """Of the whole robot, N."""
        return self._model.mass_kg * GRAVITY_MPS2

    def _skeleton(self) -> Iterator[Shape]:
        """A line from each joint to the next ones of its link, which shows a robot without any shape too."""
        for joint in self._tree.joints.values():
            end = joint.T_parent_joint[:3, 3]
            if np.linalg.norm(end) > 0.0:
                yield Shape(joint.parent, "line", np.eye(4), end)


def _shapes(path: Path) -> Iterator[Shape]:
    """The visual shapes of a URDF file, those for collisions where it has no visual ones."""
    root = ElementTree.parse(path).getroot()
    kind = "visual" if root.find("link/visual/geometry/*") is not None else "collision"
    for link in root.findall("link"):
        for part in link.findall(kind):
            for geometry in part.findall("geometry/*"):
                shape = _shape(str(link.get("name")), placement_of(part.find("origin")), geometry, path)
                if shape is not None:
                    yield shape


def _shape(link: str, placed: Array, geometry: ElementTree.Element, urdf: Path) -> Shape | None:
    """One shape; None of a kind that is not drawn, or of a mesh that is not there."""

    def made(kind: Literal["box", "sphere", "cylinder"], *size: float) -> Shape:
        return Shape(link, kind, placed, np.array(size))

    diameter = 2.0 * float(geometry.get("radius", "0"))
    match geometry.tag:
        case "box":
            return made("box", *map(float, geometry.get("size", "0 0 0").split()))
        case "sphere":
            return made("sphere", diameter, diameter, diameter)
        case "cylinder" | "capsule":
            return made("cylinder", diameter, diameter, float(geometry.get("length", "0")))
        case "mesh":
            file = mesh_path(geometry.get("filename", ""), urdf)
            if file is not None:
                scale = np.array([float(factor) for factor in geometry.get("scale", "1 1 1").split()])
                return Shape(link, "mesh", placed, scale, file)
    return None


def mesh_path(name: str, urdf: Path) -> Path | None:
    """The file of a mesh: beside the URDF, or of a ``package://`` whose folder is above the URDF; None if none is."""
    package, _, inside = name.removeprefix("package://").partition("/")
    candidates = [urdf.parent / name.removeprefix("file://")]
    if name.startswith("package://"):
        candidates = [
            folder / inner for folder in urdf.parents for inner in (Path(package) / inside, Path(inside)) if inside
        ]
    found = next((file for file in candidates if file.suffix.lower() in _MESHES and file.is_file()), None)
    if found is None:
        _log.debug("no mesh %s near %s", name, urdf)
    return found

# SPDX-License-Identifier: BSD-3-Clause
"""A URDF as it is written: links with masses and collision shapes, joints of every kind, and where they are.

``PinocchioLegs`` computes; this reads what it leaves out, for the check of a description and for finding legs.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import RobotModelError, listing

MOVING_KINDS = ("revolute", "continuous", "prismatic")
"""Kinds of joint with one degree of freedom: those of which a leg is made."""


@dataclass(frozen=True, slots=True, eq=False)
class CollisionShape:
    """A collision shape of a link.

    Attributes:
        kind: sphere, box, cylinder, capsule or mesh.
        position_link: its centre, m, link frame, (3,).
        radius_m: of a sphere, otherwise None.
        size_m: of a box along its own axes, otherwise None.
        rotation_link: from its own axes to those of the link, (3, 3).
    """

    kind: str
    position_link: Array
    radius_m: float | None
    size_m: tuple[float, float, float] | None = None
    rotation_link: Array = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True, slots=True, eq=False)
class UrdfLink:
    """A link: its mass in kg, 0 where the URDF gives none, and its collision shapes."""

    name: str
    mass_kg: float
    shapes: tuple[CollisionShape, ...]


@dataclass(frozen=True, slots=True, eq=False)
class UrdfJoint:
    """A joint.

    Attributes:
        name: its name.
        kind: revolute, continuous, prismatic, fixed, floating or planar.
        parent: name of the link that it hangs on.
        child: name of the link that it carries.
        T_parent_joint: placement at angle zero, (4, 4).
        axis: unit vector in the joint's frame, (3,).
        lower: limit, rad or m; minus infinity where there is none.
        upper: limit, rad or m; infinity where there is none.
        is_mimic: whether it follows another joint.
    """

    name: str
    kind: str
    parent: str
    child: str
    T_parent_joint: Array
    axis: Array
    lower: float
    upper: float
    is_mimic: bool

    @property
    def is_moving(self) -> bool:
        """Whether it is of any kind but fixed."""
        return self.kind != "fixed"

    def moved(self, angle: float) -> Array:
        """``T_parent_child`` (4, 4) at an angle in rad, or at a way in m of a prismatic joint."""
        rotation, translation = np.eye(3), np.zeros(3)
        if self.kind in {"revolute", "continuous"}:
            rotation = so3.exp(self.axis * angle)
        elif self.kind == "prismatic":
            translation = self.axis * angle
        return np.asarray(self.T_parent_joint @ se3.transform(rotation, translation))


class UrdfTree:
    """Links and joints of a URDF by name, in the order of the file; one root."""

    def __init__(
        self, path: Path, links: Mapping[str, UrdfLink], joints: Mapping[str, UrdfJoint], name: str = ""
    ) -> None:
        """Order the joints.

        Raises:
            RobotModelError: a joint names a link that does not exist, or there is not one root.
        """
        self.path, self.links, self.joints, self.name = path, links, joints, name
        self._above = {joint.child: joint for joint in joints.values()}
        self._below: dict[str, list[UrdfJoint]] = {name: [] for name in links}
        for joint in joints.values():
            for end in (joint.parent, joint.child):
                if end not in links:
                    raise RobotModelError(
                        f"{path}: joint {joint.name!r} names the link {end!r}, which it does not have"
                    )
            self._below[joint.parent].append(joint)
        roots = [name for name in links if name not in self._above]
        if len(roots) != 1:
            raise RobotModelError(f"{path}: a robot hangs on one root link, but this has: {listing(roots)}")
        self.root = roots[0]

    @property
    def mass_kg(self) -> float:
        """Mass of all links, kg."""
        return sum(link.mass_kg for link in self.links.values())

    def joint_above(self, link: str) -> UrdfJoint | None:
        """The joint that carries a link; None of the root."""
        return self._above.get(link)

    def joints_below(self, link: str) -> tuple[UrdfJoint, ...]:
        """The joints that hang on a link."""
        return tuple(self._below[link])

    def chain(self, link: str) -> tuple[UrdfJoint, ...]:
        """All joints from the root to a link, the one nearest to the root first."""
        joints: list[UrdfJoint] = []
        while (above := self._above.get(link)) is not None:
            joints.insert(0, above)
            link = above.parent
        return tuple(joints)

    def moving_chain(self, link: str) -> tuple[UrdfJoint, ...]:
        """The joints from the root to a link that are not fixed."""
        return tuple(joint for joint in self.chain(link) if joint.is_moving)

    def descendants(self, link: str, *, only_fixed: bool = False) -> tuple[str, ...]:
        """The links below a link; only those that do not move against it if asked."""
        found: list[str] = []
        for joint in self._below[link]:
            if not (only_fixed and joint.is_moving):
                found += [joint.child, *self.descendants(joint.child, only_fixed=only_fixed)]
        return tuple(found)

    def rigid_with(self, link: str) -> tuple[str, ...]:
        """The link and all links that do not move against it, from the one nearest to the root on."""
        while (above := self._above.get(link)) is not None and not above.is_moving:
            link = above.parent
        return link, *self.descendants(link, only_fixed=True)

    def placements(self, angles: Mapping[str, float] | None = None) -> dict[str, Array]:
        """``T_root_link`` (4, 4) of every link, at joint angles in rad by name; joints that are not named are at 0."""
        placed = {self.root: np.eye(4)}
        links = [self.root]
        while links:
            link = links.pop()
            for joint in self._below[link]:
                placed[joint.child] = placed[link] @ joint.moved((angles or {}).get(joint.name, 0.0))
                links.append(joint.child)
        return placed


def read_urdf_tree(path: Path) -> UrdfTree:
    """Read a URDF file.

    Raises:
        RobotModelError: it cannot be read, or is no tree of links.
    """
    try:
        root = ElementTree.parse(path).getroot()
        links = {str(link.get("name")): _link(link) for link in root.findall("link")}
        joints = {str(joint.get("name")): _joint(joint) for joint in root.findall("joint")}
    except (ElementTree.ParseError, OSError, ValueError) as error:
        raise RobotModelError(f"{path} is not a URDF that can be read: {error}; correct the URDF") from error
    if not links:
        raise RobotModelError(f"{path} is not a URDF that can be read: it has no link; pass the robot's URDF file")
    return UrdfTree(path, links, joints, str(root.get("name") or path.stem))


def _link(element: ElementTree.Element) -> UrdfLink:
    mass = element.find("inertial/mass")
    shapes = [shape for collision in element.findall("collision") for shape in _shapes(collision)]
    return UrdfLink(str(element.get("name")), 0.0 if mass is None else float(mass.get("value", "0")), tuple(shapes))


def _shapes(collision: ElementTree.Element) -> list[CollisionShape]:
    placed = placement_of(collision.find("origin"))
    return [
        CollisionShape(
            shape.tag,
            placed[:3, 3],
            float(shape.get("radius", "0")) if shape.tag == "sphere" else None,
            tuple(_vector(shape.get("size", "0 0 0")).tolist()) if shape.tag == "box" else None,
            placed[:3, :3],
        )
        for shape in collision.findall("geometry/*")
    ]


def _joint(element: ElementTree.Element) -> UrdfJoint:
    axis_element, limit, kind = element.find("axis"), element.find("limit"), str(element.get("type"))
    axis = np.array([1.0, 0.0, 0.0]) if axis_element is None else _vector(axis_element.get("xyz", "1 0 0"))
    lower, upper = -np.inf, np.inf
    if kind in {"revolute", "prismatic"} and limit is not None:
        lower, upper = (float(limit.get(end, "0")) for end in ("lower", "upper"))
    ends = [element.find(end) for end in ("parent", "child")]
    parent, child = ("" if end is None else str(end.get("link")) for end in ends)
    norm = float(np.linalg.norm(axis))
    return UrdfJoint(
        name=str(element.get("name")),
        kind=kind,
        parent=parent,
        child=child,
        T_parent_joint=placement_of(element.find("origin")),
        axis=axis / norm if norm > 0.0 else axis,
        lower=lower,
        upper=upper,
        is_mimic=element.find("mimic") is not None,
    )


def placement_of(origin: ElementTree.Element | None) -> Array:
    """The transform (4, 4) of an ``<origin>`` element; identity without one."""
    if origin is None:
        return np.eye(4)
    roll, pitch, yaw = _vector(origin.get("rpy", "0 0 0"))
    rotation = so3.about_z(yaw) @ so3.exp(np.array([0.0, pitch, 0.0])) @ so3.exp(np.array([roll, 0.0, 0.0]))
    return se3.transform(rotation, _vector(origin.get("xyz", "0 0 0")))


def _vector(text: str) -> Array:
    values = np.array([float(word) for word in text.split()])
    if values.shape != (3,):
        raise ValueError(f"{text!r} must hold three numbers")
    return values

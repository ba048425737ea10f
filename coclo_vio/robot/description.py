# SPDX-License-Identifier: BSD-3-Clause
"""The description of a robot: which joints make a leg, where its foot is, how contact is sensed.

A description is a YAML file beside a URDF. Those of this package (``robot_names``) serve as examples.
"""

from functools import cache
from importlib import metadata, resources
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from coclo_vio.robot.contact import ContactConfig
from coclo_vio.values.calibration import ImuCalibration, Triple
from coclo_vio.values.config import StageConfig, read_yaml
from coclo_vio.values.errors import ConfigError, RobotModelError, listing, shortened

EXTRA_SCHEME = "example-robot-data:"
_PRESETS = Path(str(resources.files("coclo_vio.robot") / "presets"))
_LEAST_SOLE_M = 0.005
_SOLE_JOINTS = 5
_EXTRA_DISTRIBUTION = "example-robot-data"
_EXTRA_FOLDER = "/example-robot-data/robots/"


class LegDescription(StageConfig):
    """One leg: the joints that move its foot, and the foot."""

    name: Annotated[str, Field(min_length=1, description="short name of the leg, such as FL")]
    joints: Annotated[
        tuple[str, ...], Field(min_length=1, description="URDF joint names from the body to the foot, in log order")
    ]
    foot_frame: Annotated[str, Field(min_length=1, description="URDF link or frame at the centre of the foot")]
    foot_centre_m: Annotated[
        Triple, Field(description="centre of the foot in the axes of foot_frame, where that is not at the centre, m")
    ] = (0.0, 0.0, 0.0)
    foot_radius_m: Annotated[float, Field(ge=0, lt=1, description="radius of a spherical foot, 0 for a point, m")] = 0.0
    contact_points_m: Annotated[
        tuple[Triple, ...],
        Field(
            description="corners of a flat sole, heel and toe, in the axes of foot_frame, m; by default those of the "
            "URDF's collision shapes where the foot is flat: foot_radius_m is 0 and the leg has five joints or more"
        ),
    ] = ()

    @model_validator(mode="after")
    def _sole_is_a_surface(self) -> Self:
        points = self.contact_points_m
        if not points:
            return self
        if self.foot_radius_m > 0.0:
            raise ValueError(
                f"foot_radius_m = {self.foot_radius_m} is that of a sphere, contact_points_m are those of a flat sole; "
                "give one of the two"
            )
        edges = np.array(points) - points[0]
        if len(points) < 3 or np.linalg.matrix_rank(edges, tol=_LEAST_SOLE_M) < 2:
            raise ValueError(
                f"contact_points_m has {len(points)} points, which span no surface; give three corners of the sole or "
                "more that do not lie on a line"
            )
        return self

    @property
    def is_flat(self) -> bool:
        """Whether the foot stands on a surface, not on a point or a sphere, so that it holds its orientation too.

        A leg of five joints or more sets the orientation of its foot; where that is no sphere it is a sole.
        """
        return bool(self.contact_points_m) or (self.foot_radius_m == 0.0 and len(self.joints) >= _SOLE_JOINTS)


class RobotDescription(StageConfig):
    """A robot: its URDF, legs, contact sensing and IMU. Names of joints and legs are unique."""

    name: Annotated[str, Field(min_length=1, description="name of the robot")]
    urdf: Annotated[
        str, Field(min_length=1, description="URDF file: relative to the YAML, absolute, or example-robot-data:<path>")
    ]
    body_frame: Annotated[
        str | None, Field(description="URDF link that is the body frame; null takes the root link")
    ] = None
    legs: Annotated[tuple[LegDescription, ...], Field(min_length=1, description="the legs, in log order")]
    contact: Annotated[ContactConfig, Field(description="how a foot's load becomes contact")] = ContactConfig()
    imu: Annotated[ImuCalibration, Field(description="mounting and noise of the body IMU")] = ImuCalibration()
    joint_aliases: dict[str, str] = Field(
        default_factory=dict, description="names that logs use for joints, each with its URDF joint name"
    )
    inferred_from: Annotated[
        Literal["joints", "path"],
        Field(
            description="what a known robot is inferred from where none is named: joints, its joint names in the "
            "recording; path, its own name in the recording's path too, for a robot that shares its joint names"
        ),
    ] = "joints"
    filter: Annotated[
        dict[str, Any],
        Field(default_factory=dict, description="filter parameters that differ for this robot (see FilterConfig)"),
    ]
    encoder_noise_rad: Annotated[float, Field(gt=0, lt=1, description="one sigma of a joint position, rad")] = 1e-3
    joint_velocity_noise_radps: Annotated[
        float, Field(gt=0, lt=10, description="one sigma of a joint velocity, rad/s")
    ] = 0.05

    @model_validator(mode="after")
    def _names_are_unique(self) -> Self:
        joints = self.joint_names
        for kind, names in (("leg", self.leg_names), ("joint", joints)):
            repeated = {name for name in names if names.count(name) > 1}
            if repeated:
                raise ValueError(f"{kind} {listing(repeated)} is listed twice; list each {kind} once")
        unknown = set(self.joint_aliases.values()) - set(joints)
        if unknown:
            raise ValueError(
                f"joint_aliases lead to {listing(unknown)}, no joint of a leg; the joints are: {listing(joints)}"
            )
        return self

    @property
    def leg_names(self) -> tuple[str, ...]:
        """Leg names, in the order of every per-leg array."""
        return tuple(leg.name for leg in self.legs)

    @property
    def has_flat_feet(self) -> bool:
        """Whether any foot is flat."""
        return any(leg.is_flat for leg in self.legs)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """URDF joint names leg by leg, in the order of the arrays of ``JointSample``."""
        return tuple(joint for leg in self.legs for joint in leg.joints)


def robot_names() -> tuple[str, ...]:
    """The names of the robots that come with the package, in alphabetical order."""
    return tuple(sorted(path.stem for path in _PRESETS.glob("*.yaml")))


def load_robot(name_or_path: str | Path) -> RobotDescription:
    """The description of a packaged robot (``"go1"``) or of a YAML file (``"my_robot.yaml"``).

    A relative ``urdf`` is relative to the folder of the YAML and is returned absolute.

    Raises:
        ConfigError: no such robot or file, or a key or value that is wrong.
    """
    path = _yaml_path(str(name_or_path))
    if path.parent == _PRESETS:
        return _packaged(path)
    return _read(path)


@cache
def _packaged(path: Path) -> RobotDescription:
    """Read once: the robot of a recording is inferred from the joints of all of them."""
    return _read(path)


def _read(path: Path) -> RobotDescription:
    description = RobotDescription.parse(read_yaml(path), str(path))
    if description.urdf.startswith(EXTRA_SCHEME):
        return description
    return description.model_copy(update={"urdf": str(path.parent.resolve() / description.urdf)})


def _yaml_path(name_or_path: str) -> Path:
    path = Path(name_or_path)
    if path.suffix in {".yaml", ".yml"}:
        return path
    if name_or_path not in robot_names():
        raise ConfigError(
            f"no robot {shortened(name_or_path)!r}; the known robots are: {listing(robot_names())}; "
            "for an own robot use the path of a file ending in .yaml"
        )
    return _PRESETS / f"{name_or_path}.yaml"


def urdf_path(description: RobotDescription) -> Path:
    """The URDF file of a description.

    Raises:
        RobotModelError: there is no such file, or it needs the ``robots`` extra that is not installed.
    """
    if not description.urdf.startswith(EXTRA_SCHEME):
        path = Path(description.urdf)
    else:
        path = _path_in_extra(description.name, description.urdf.removeprefix(EXTRA_SCHEME))
    try:
        is_file = path.is_file()
    except OSError:  # a name that is too long
        is_file = False
    if not is_file:
        raise RobotModelError(
            f"robot {shortened(description.name)!r}: there is no URDF file {shortened(path)}; "
            "correct `urdf` in its YAML"
        )
    return path


def _path_in_extra(robot: str, relative: str) -> Path:
    try:
        files = metadata.files(_EXTRA_DISTRIBUTION) or []
    except metadata.PackageNotFoundError as error:
        raise RobotModelError(
            f"robot {robot!r} has its URDF in the package {_EXTRA_DISTRIBUTION}, which is not installed; "
            "pip install coclo-vio[robots]"
        ) from error
    urdfs = {str(file).partition(_EXTRA_FOLDER)[2]: file for file in files if str(file).endswith(".urdf")}
    if relative not in urdfs:
        raise RobotModelError(
            f"robot {robot!r}: {_EXTRA_DISTRIBUTION} has no {relative!r}; it has: {listing(urdfs)}; "
            "correct `urdf` in its YAML"
        )
    return Path(str(urdfs[relative].locate()))

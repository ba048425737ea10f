# SPDX-License-Identifier: BSD-3-Clause
"""Corrections of what a recording says in other units, axes or clocks than it should, for every format alike.

A reader passes on what the file holds; ``CorrectedDataset`` changes it as configured under ``dataset.corrections``.
Nothing is corrected that is not configured.
"""

import re
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator

from coclo_vio.values.arrays import Array
from coclo_vio.values.config import StageConfig
from coclo_vio.values.units import GRAVITY_MPS2

ACCELERATION_UNITS = {"m/s^2": 1.0, "g": GRAVITY_MPS2, "mg": 1e-3 * GRAVITY_MPS2, "mm/s^2": 1e-3}
ANGLE_UNITS = {"rad": 1.0, "deg": np.pi / 180.0}
RATE_UNITS = {"rad/s": 1.0, "deg/s": np.pi / 180.0, "rpm": 2.0 * np.pi / 60.0}
LENGTH_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
STAMP_UNITS_NS = {"ns": 1, "us": 1_000, "ms": 1_000_000, "s": 1_000_000_000}

_SAME_AXES = "x y z"
_AXIS = re.compile(r"[+-]?[xyz]")
_Delay = Annotated[float, Field(ge=-1e11, le=1e11, description="is subtracted from the stamps: how late they are, s")]


class ImuCorrections(StageConfig):
    """Units, axes and delay of an IMU's readings."""

    acceleration_unit: Annotated[
        Literal["m/s^2", "g", "mg", "mm/s^2"], Field(description="unit of the accelerometer in the recording")
    ] = "m/s^2"
    rate_unit: Annotated[
        Literal["rad/s", "deg/s", "rpm"], Field(description="unit of the gyroscope in the recording")
    ] = "rad/s"
    axes: Annotated[
        str,
        Field(
            description="the recording's axes that are x, y and z of the imu frame, each with its sign: 'x -y -z' "
            "where the recording has x ahead, y right, z down (NED) and the imu frame z up"
        ),
    ] = _SAME_AXES
    acceleration_sign: Annotated[
        Literal[-1, 1], Field(description="-1 where the accelerometer reads gravity's direction: down at rest")
    ] = 1
    delay_s: _Delay = 0.0

    @field_validator("axes")
    @classmethod
    def _is_a_rotation(cls, axes: str) -> str:
        names = axes.split()
        if len(names) != 3 or not all(_AXIS.fullmatch(name) for name in names):
            raise ValueError("must name three signed axes, such as 'x -y -z'")
        if np.linalg.det(axes_matrix(axes)) < 0.5:
            raise ValueError("must be a rotation: each axis once, and an even number of reflections ('x -y -z')")
        return axes

    @property
    def rotation(self) -> Array:
        """Maps readings of the recording to the imu frame, (3, 3)."""
        return axes_matrix(self.axes)


class JointCorrections(StageConfig):
    """Order, signs, units and delay of the joints' readings."""

    position_unit: Annotated[Literal["rad", "deg"], Field(description="unit of the angles in the recording")] = "rad"
    velocity_unit: Annotated[
        Literal["rad/s", "deg/s", "rpm"] | None,
        Field(description="unit of the velocities in the recording; null: that of the angles, a second"),
    ] = None
    effort_factor: Annotated[
        float, Field(description="is multiplied with the torques: -1 for another sign, a motor's constant for currents")
    ] = 1.0
    velocity: Annotated[
        Literal["recorded", "from_position"],
        Field(description="from_position: the recorded velocities are replaced by estimates from the angles"),
    ] = "recorded"
    order: dict[str, str] = Field(
        default_factory=dict, description="joint: the joint under whose name the recording has its readings"
    )
    signs: dict[str, Literal[-1, 1]] = Field(
        default_factory=dict, description="joint: -1 where angle, velocity and torque have the opposite sign"
    )
    left_out: Annotated[
        tuple[str, ...], Field(description="joints whose readings are not used; their legs are unknown")
    ] = ()
    delay_s: _Delay = 0.0

    @property
    def velocity_factor(self) -> float:
        """What the velocities are multiplied with."""
        unit = self.velocity_unit or ("deg/s" if self.position_unit == "deg" else "rad/s")
        return float(RATE_UNITS[unit])


class ForceCorrections(StageConfig):
    """Order, sign or unit, and delay of the foot forces."""

    order: dict[str, str] = Field(
        default_factory=dict, description="leg: the leg under whose name the recording has the force of its foot"
    )

    factor: Annotated[float, Field(description="is multiplied with the forces: -1 where a load is negative")] = 1.0
    delay_s: _Delay = 0.0


class StereoCorrections(StageConfig):
    """Order and delay of the images."""

    is_swapped: Annotated[bool, Field(description="the image that is called left is the right one")] = False
    delay_s: _Delay = 0.0


class TruthCorrections(StageConfig):
    """Units and conventions of the ground truth."""

    length_unit: Annotated[Literal["m", "cm", "mm"], Field(description="unit of the positions")] = "m"
    quaternion: Annotated[Literal["xyzw", "wxyz"], Field(description="order of a quaternion's four columns")] = "xyzw"
    up: Annotated[
        Literal["x", "-x", "y", "-y", "z", "-z"], Field(description="the axis of its world that points up")
    ] = "z"
    stamp_factor: Annotated[
        float,
        Field(gt=0, description="is multiplied with the stamps: 0.001 for milliseconds read as seconds"),
    ] = 1.0
    drops_jumps: Annotated[
        bool, Field(description="leave out poses that no body reaches at 10 m/s from the poses around them")
    ] = False
    is_read: Annotated[bool, Field(description="whether it is read at all")] = True


class Corrections(StageConfig):
    """What is changed in the readings of a recording; by default nothing."""

    imu: Annotated[ImuCorrections, Field(description="the body's IMU")] = ImuCorrections()
    camera_imu: Annotated[ImuCorrections, Field(description="the camera's IMU")] = ImuCorrections()
    joints: Annotated[JointCorrections, Field(description="the joints")] = JointCorrections()
    foot_force: Annotated[ForceCorrections, Field(description="the foot forces")] = ForceCorrections()
    stereo: Annotated[StereoCorrections, Field(description="the cameras")] = StereoCorrections()
    ground_truth: Annotated[TruthCorrections, Field(description="the reference trajectory")] = TruthCorrections()
    stamp_unit: Annotated[
        Literal["ns", "us", "ms", "s"],
        Field(description="unit of stamps that were read as nanoseconds, in all streams but the ground truth"),
    ] = "ns"

    @property
    def is_none(self) -> bool:
        """Whether nothing is changed."""
        return self == Corrections()


def axes_matrix(axes: str) -> Array:
    """The matrix (3, 3) whose rows select the three signed axes of ``axes``, such as ``"x -y -z"``."""
    matrix = np.zeros((3, 3))
    for row, name in enumerate(axes.split()):
        matrix[row, "xyz".index(name[-1])] = -1.0 if name.startswith("-") else 1.0
    return matrix


def axes_name(matrix: Array) -> str:
    """The three signed axes nearest to a rotation (3, 3): the inverse of ``axes_matrix``."""
    names = []
    for row in matrix:
        column = int(np.argmax(np.abs(row)))
        names.append(("-" if row[column] < 0.0 else "") + "xyz"[column])
    return " ".join(names)


def upright(up: str) -> Array:
    """The rotation (3, 3) from a world whose axis ``up``, such as ``"-y"``, points up, to one that is z up."""
    axis = np.zeros(3)
    axis["xyz".index(up[-1])] = -1.0 if up.startswith("-") else 1.0
    other = np.array([1.0, 0.0, 0.0]) if up[-1] != "x" else np.array([0.0, 1.0, 0.0])
    return np.array([other, np.cross(axis, other), axis])

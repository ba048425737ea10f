# SPDX-License-Identifier: BSD-3-Clause
"""The columns of a log: name patterns as configuration, matched against a header for a robot's joints and legs."""

import re
import string
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, field_validator

from coclo_vio.datasets.csv_table import CsvRow
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.config import StageConfig
from coclo_vio.values.errors import DatasetError, TopicNotFound, listing

Patterns = tuple[str, ...]


class ColumnNames(StageConfig):
    """Patterns of column names; ``{joint}``, ``{leg}``, ``{axis}`` stand for a name. The first match is used.

    A joint is matched by its URDF name and by its aliases in the robot's description.
    """

    stamp_ns: Annotated[Patterns, Field(description="time in integer nanoseconds")] = ("stamp_ns", "timestamp")
    stamp_s: Annotated[Patterns, Field(description="time in decimal seconds")] = ("time_s", "Time(s)")
    gyroscope: Annotated[Patterns, Field(description="rad/s, imu frame; {axis} is x, y, z")] = (
        "gyro_{axis}_radps",
        "BaseW{axis}",
        "w_RS_S_{axis}",
    )
    accelerometer: Annotated[Patterns, Field(description="specific force, m/s^2, imu frame; {axis} is x, y, z")] = (
        "accel_{axis}_mps2",
        "BaseA{axis}",
        "a_RS_S_{axis}",
    )
    position: Annotated[Patterns, Field(description="joint angle, rad")] = ("{joint}.position", "JointPos{joint}")
    velocity: Annotated[Patterns, Field(description="joint velocity, rad/s")] = ("{joint}.velocity", "JointVel{joint}")
    effort: Annotated[Patterns, Field(description="joint torque, Nm")] = ("{joint}.effort", "JointTau{joint}")
    force: Annotated[Patterns, Field(description="foot force, in the unit of the robot's thresholds")] = (
        "{leg}.force",
        "{leg}_Force",
    )

    @field_validator("gyroscope", "accelerometer")
    @classmethod
    def _has_axis(cls, patterns: Patterns) -> Patterns:
        return _checked_patterns(patterns, "axis")

    @field_validator("position", "velocity", "effort")
    @classmethod
    def _has_joint(cls, patterns: Patterns) -> Patterns:
        return _checked_patterns(patterns, "joint")

    @field_validator("force")
    @classmethod
    def _has_leg(cls, patterns: Patterns) -> Patterns:
        return _checked_patterns(patterns, "leg")


def _checked_patterns(patterns: Patterns, placeholder: str) -> Patterns:
    for pattern in patterns:
        names = [name for _, name, _, _ in string.Formatter().parse(pattern) if name is not None]
        if names != [placeholder]:
            raise ValueError(f"the pattern {pattern!r} must hold {{{placeholder}}} once and no other braces")
    return patterns


@dataclass(frozen=True, slots=True)
class StampColumn:
    """The time column: its index, and whether it is in decimal seconds."""

    index: int
    in_seconds: bool

    def read(self, row: CsvRow) -> int | None:
        """The row's stamp in nanoseconds, or None."""
        return row.stamp_ns(self.index, in_seconds=self.in_seconds)


@dataclass(frozen=True, slots=True, eq=False)
class OptionalColumns:
    """Columns of a vector; an entry may have no column.

    Attributes:
        indices: the column of every entry that has one, in order.
        is_present: which entries have a column, (entries,).
    """

    indices: tuple[int, ...]
    is_present: BoolArray

    @classmethod
    def of(cls, found: Sequence[int | None]) -> "OptionalColumns":
        """From an index or None for each entry."""
        return cls(tuple(i for i in found if i is not None), np.array([i is not None for i in found], dtype=np.bool_))

    def read(self, row: CsvRow) -> Array:
        """The entries, (entries,), NaN where there is no column or no number."""
        if len(self.indices) == len(self.is_present):
            return np.array(row.numbers(self.indices))
        values = np.full(len(self.is_present), np.nan)
        if self.indices:
            values[self.is_present] = row.numbers(self.indices)
        return values


@dataclass(frozen=True, slots=True, eq=False)
class JointColumns:
    """Columns of the joints' angles, velocities and torques, in the order of ``RobotModel.joint_names``."""

    names: tuple[str, ...]
    position: OptionalColumns
    velocity: OptionalColumns
    effort: OptionalColumns

    @property
    def all_indices(self) -> tuple[int, ...]:
        """All columns of the joints."""
        return self.position.indices + self.velocity.indices + self.effort.indices


class Header:
    """A file's column names, and the lookup of columns among them."""

    def __init__(self, path: Path, names: Sequence[str], patterns: ColumnNames) -> None:
        self._path = path
        self._names = tuple(names)
        self._patterns = patterns
        self._index = {name: i for i, name in reversed(list(enumerate(names)))}
        self._repeated = {name for name, count in Counter(names).items() if count > 1}

    def find_stamp(self) -> StampColumn | None:
        """The time column, nanoseconds before seconds, or None."""
        for patterns, in_seconds in ((self._patterns.stamp_ns, False), (self._patterns.stamp_s, True)):
            index = self._first(patterns)
            if index is not None:
                return StampColumn(index, in_seconds)
        return None

    def stamp(self) -> StampColumn:
        """The time column.

        Raises:
            TopicNotFound: there is none; lists the names that are accepted.
        """
        found = self.find_stamp()
        if found is None:
            accepted = listing(self._patterns.stamp_ns + self._patterns.stamp_s)
            raise TopicNotFound(
                f"{self._path} has no time column: none of {accepted} is among {listing(self._names)}; "
                "name yours in dataset.columns.stamp_ns or stamp_s"
            )
        return found

    def imu(self) -> tuple[int, ...] | None:
        """Columns of gyroscope x, y, z and accelerometer x, y, z, or None where all six are missing.

        Raises:
            TopicNotFound: some but not all of the six are missing.
        """
        patterns = (self._patterns.gyroscope, self._patterns.accelerometer)
        found = [self._first(_filled(group, "axis", ("xyz"[axis],))) for group in patterns for axis in range(3)]
        indices = tuple(i for i in found if i is not None)
        if 0 < len(indices) < 6:
            raise TopicNotFound(
                f"{self._path} has {len(indices)} of the 6 IMU columns, {listing(self._names[i] for i in indices)}; "
                f"name the rest in dataset.columns.gyroscope and accelerometer; the columns are {listing(self._names)}"
            )
        return indices or None

    def required_imu(self) -> tuple[int, ...]:
        """Columns of gyroscope x, y, z and accelerometer x, y, z.

        Raises:
            TopicNotFound: one of them is missing; lists the columns that exist.
        """
        indices = self.imu()
        if indices is None:
            raise TopicNotFound(
                f"{self._path} has no IMU column among {listing(self._names)}; name yours in "
                "dataset.columns.gyroscope and accelerometer, or name the robot to read its joints"
            )
        return indices

    def joint_names(self) -> tuple[str, ...]:
        """The names of all joints whose angles have a column, of any robot."""
        patterns = [re.escape(pattern).replace(r"\{joint\}", "(.+)") for pattern in self._patterns.position]
        found = (re.fullmatch(pattern, name) for name in self._names for pattern in patterns)
        return tuple(dict.fromkeys(match[1] for match in found if match))

    def find_joints(self, robot: RobotDescription) -> tuple[int | None, ...]:
        """The column of every joint's angle, or None."""
        return self._of_joints(self._patterns.position, robot)

    def joints(self, robot: RobotDescription) -> JointColumns:
        """The columns of all joints of ``robot``.

        Raises:
            TopicNotFound: a joint without a column for its angle; lists the columns and the joints.
        """
        names = robot.joint_names
        position = self.find_joints(robot)
        missing = [name for name, index in zip(names, position, strict=True) if index is None]
        if missing:
            raise TopicNotFound(
                f"{self._path} has no angle of {listing(missing)}: the robot has the joints {listing(names)}, the "
                f"columns are {listing(self._names)}; add joint_aliases to the robot's description, patterns to "
                "dataset.columns.position, or name another robot"
            )
        velocity = self._of_joints(self._patterns.velocity, robot)
        effort = self._of_joints(self._patterns.effort, robot)
        return JointColumns(names, *(OptionalColumns.of(found) for found in (position, velocity, effort)))

    def forces(self, robot: RobotDescription) -> OptionalColumns | None:
        """The columns of the legs' foot force, or None where no leg has a column."""
        found = [self._first(_filled(self._patterns.force, "leg", (leg.name,))) for leg in robot.legs]
        return OptionalColumns.of(found) if any(index is not None for index in found) else None

    def unused(self, used: Iterable[int]) -> tuple[str, ...]:
        """The names of the other columns."""
        indices = set(used)
        return tuple(name for i, name in enumerate(self._names) if i not in indices)

    def _of_joints(self, patterns: Patterns, robot: RobotDescription) -> tuple[int | None, ...]:
        spellings = {name: [name] for name in robot.joint_names}
        for alias, name in robot.joint_aliases.items():
            spellings.setdefault(name, []).append(alias)
        return tuple(self._first(_filled(patterns, "joint", spellings[name])) for name in robot.joint_names)

    def _first(self, names: Iterable[str]) -> int | None:
        for name in names:
            if name in self._repeated:
                raise DatasetError(f"{self._path} has more than one column {name}; rename or delete the others")
            if name in self._index:
                return self._index[name]
        return None


def _filled(patterns: Patterns, placeholder: str, names: Sequence[str]) -> list[str]:
    return [pattern.replace(f"{{{placeholder}}}", name) for pattern in patterns for name in names]

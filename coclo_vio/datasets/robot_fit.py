# SPDX-License-Identifier: BSD-3-Clause
"""Which of the known robots a recording fits, by the names of its joints."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from coclo_vio.robot.description import RobotDescription, load_robot, robot_names
from coclo_vio.values.errors import CocloError, ConfigError, TopicNotFound, listing

_LEAST_SHARE = 0.5  # of a robot's joints, for it to be the nearest robot


@dataclass(frozen=True, slots=True)
class RobotFit:
    """How well the joints of a recording fit the known robots.

    Attributes:
        joints: the joint names in the recording.
        absent: by known robot, those of its joints that the recording lacks.
        totals: by known robot, its number of joints.
    """

    joints: tuple[str, ...]
    absent: Mapping[str, tuple[str, ...]]
    totals: Mapping[str, int]

    @property
    def fitting(self) -> tuple[str, ...]:
        """The robots all of whose joints are in the recording, if no other robot has more of its joints there."""
        most = max(map(self._present, self.absent), default=0)
        return tuple(name for name, absent in self.absent.items() if not absent and self._present(name) == most)

    @property
    def nearest(self) -> str | None:
        """The robot with the most joints present, at least half of its own; None where one fits or two tie."""
        if self.fitting:
            return None
        near = [name for name in self.absent if self._present(name) >= _LEAST_SHARE * self.totals[name]]
        most = max(map(self._present, near), default=0)
        best = _inferred_from_joints([name for name in near if self._present(name) == most])
        return best[0] if len(best) == 1 else None

    def _present(self, name: str) -> int:
        return self.totals[name] - len(self.absent[name])

    def matched(self, robot: RobotDescription) -> tuple[str, ...]:
        """The joints of a robot that the recording has under their own name or an alias."""
        return _matched(robot, self.joints)

    def foreign_joints(self, name: str) -> tuple[str, ...]:
        """The joints of the recording that the known robot does not have."""
        robot = load_robot(name)
        known = {*robot.joint_names, *robot.joint_aliases}
        return tuple(joint for joint in self.joints if joint not in known)

    def guess(self, names: str, *, takes_nearest: bool) -> str | None:
        """The robot of the recording, or None where it is ambiguous.

        Args:
            names: names of folder and file; they decide among robots that share their joint names.
            takes_nearest: accept a robot some of whose joints are absent.
        """
        if not self.fitting:
            return self.nearest if takes_nearest else None
        named = [
            name for name in self.fitting if re.search(rf"(?<![a-z0-9]){re.escape(name)}(?![a-z0-9])", names.lower())
        ]
        best = named or _inferred_from_joints(self.fitting)
        return best[0] if len(best) == 1 else None

    def unknown_robot_error(self, path: Path) -> CocloError:
        """The error to raise where no robot was named and none can be inferred."""
        if not self.joints:
            return TopicNotFound(
                f"{path} has no joint, so there is no leg odometry; coclo-vio inspect lists its contents"
            )
        if self.nearest is not None:
            absent, others = listing(self.absent[self.nearest]), listing(self.foreign_joints(self.nearest))
            return TopicNotFound(
                f"{path} has the joints of {self.nearest} except {absent}; its other joints are {others}; "
                "--allow-partial (dataset.allow_partial) runs without them, dataset.rosbag.joint_names or the robot's "
                "joint_aliases map names, --robot names another robot"
            )
        joints = f"those of {listing(self.fitting)}" if self.fitting else listing(self.joints)
        return ConfigError(
            f"which robot is it? Give --robot NAME or a YAML file; known robots are: {listing(robot_names())}; "
            f"the joints of {path} are {joints}"
        )


def _inferred_from_joints(names: Sequence[str]) -> list[str]:
    return [name for name in names if load_robot(name).inferred_from == "joints"]


def fit_of(joints: Sequence[str]) -> RobotFit:
    """Compare a recording's joints with those of all known robots."""
    absent, totals = {}, {}
    for name, robot in _packaged().items():
        matched = _matched(robot, joints)
        absent[name] = tuple(joint for joint in robot.joint_names if joint not in matched)
        totals[name] = len(robot.joint_names)
    return RobotFit(tuple(joints), absent, totals)


@lru_cache(maxsize=1)
def _packaged() -> dict[str, RobotDescription]:
    """The robots of the package by name, read once."""
    return {name: load_robot(name) for name in robot_names()}


def _matched(robot: RobotDescription, joints: Sequence[str]) -> tuple[str, ...]:
    resolved = {robot.joint_aliases.get(joint, joint) for joint in joints}
    return tuple(joint for joint in robot.joint_names if joint in resolved or joint in joints)

# SPDX-License-Identifier: BSD-3-Clause
"""Which of the known robots a recording can be of, by the names of its joints."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from coclo_vio.robot.description import RobotDescription, load_robot, robot_names
from coclo_vio.values.errors import CocloError, ConfigError, TopicNotFound, listing

_ENOUGH = 0.5  # of a robot's joints, for it to be the one that is meant


@dataclass(frozen=True, slots=True)
class RobotFit:
    """How far the joints of a recording are those of the known robots.

    Attributes:
        joints: the joints of the recording, by its own names.
        absent: by known robot, those of its joints that the recording does not have.
        totals: by known robot, how many joints it has.
    """

    joints: tuple[str, ...]
    absent: Mapping[str, tuple[str, ...]]
    totals: Mapping[str, int]

    @property
    def fitting(self) -> tuple[str, ...]:
        """The robots all of whose joints are there."""
        return tuple(name for name, absent in self.absent.items() if not absent)

    @property
    def nearest(self) -> str | None:
        """The one robot most of whose joints are there, though not all; None where one fits or none comes near."""
        if self.fitting:
            return None
        shares = {name: 1.0 - len(absent) / self.totals[name] for name, absent in self.absent.items()}
        best = [name for name, share in shares.items() if share >= _ENOUGH and share == max(shares.values())]
        return best[0] if len(best) == 1 else None

    def matched(self, robot: RobotDescription) -> tuple[str, ...]:
        """The joints of a robot that are there under their own name or an alias."""
        return _matched(robot, self.joints)

    def strangers(self, name: str) -> tuple[str, ...]:
        """The joints of the recording that are none of the known robot's."""
        robot = load_robot(name)
        known = {*robot.joint_names, *robot.joint_aliases}
        return tuple(joint for joint in self.joints if joint not in known)

    def guess(self, spoken: str, *, takes_nearest: bool) -> str | None:
        """The robot that is meant, or None where that is not clear.

        Args:
            spoken: names of folder and file; decide among robots that share their joints.
            takes_nearest: whether a robot may be meant some of whose joints are absent.
        """
        if not self.fitting:
            return self.nearest if takes_nearest else None
        most = max(self.totals[name] for name in self.fitting)
        best = [name for name in self.fitting if self.totals[name] == most]
        if len(best) == 1:
            return best[0]
        named = [name for name in best if re.search(rf"(?<![a-z0-9]){re.escape(name)}(?![a-z0-9])", spoken.lower())]
        return named[0] if len(named) == 1 else None

    def why_unknown(self, path: Path) -> CocloError:
        """What to say where nobody names the robot: the recording's fault where its joints are, else a question."""
        if not self.joints:
            return TopicNotFound(f"{path} has no joint, so no leg can be followed; coclo-vio inspect says what it has")
        if self.nearest is not None:
            absent, there = listing(self.absent[self.nearest]), listing(self.strangers(self.nearest))
            return TopicNotFound(
                f"{path} has the joints of {self.nearest} but for {absent}; the others it has are {there}; "
                "--allow-partial (dataset.allow_partial) does without, dataset.rosbag.joint_names or the robot's "
                "joint_aliases map names, --robot names another robot"
            )
        whose = f"those of {listing(self.fitting)}" if self.fitting else listing(self.joints)
        return ConfigError(
            f"which robot is it? Give --robot NAME or a YAML file; known robots are: {listing(robot_names())}; "
            f"the joints of {path} are {whose}"
        )


def fit_of(joints: Sequence[str]) -> RobotFit:
    """Compare a recording's joints with those of all known robots."""
    absent, totals = {}, {}
    for name in robot_names():
        robot = load_robot(name)
        matched = _matched(robot, joints)
        absent[name] = tuple(joint for joint in robot.joint_names if joint not in matched)
        totals[name] = len(robot.joint_names)
    return RobotFit(tuple(joints), absent, totals)


def _matched(robot: RobotDescription, joints: Sequence[str]) -> tuple[str, ...]:
    meant = {robot.joint_aliases.get(joint, joint) for joint in joints}
    return tuple(joint for joint in robot.joint_names if joint in meant or joint in joints)

# SPDX-License-Identifier: BSD-3-Clause
"""Readings of all joints and all feet from JointState and WrenchStamped messages, in any order, over several topics."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from coclo_vio.datasets.rosbag.bag_preview import BagPreview, entry_names
from coclo_vio.datasets.rosbag.config import RosbagConfig
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.errors import DatasetError, listing

_FIELDS = ("position", "velocity", "effort")
_ENTRY = re.compile(r"(?:(?P<field>position|velocity|effort)\[(?P<inner>[^\]]+)\])|(?P<name>[^\[\]]+)")
_RANGE = re.compile(r"(?P<field>position|velocity|effort)\[(?P<start>\d+):(?P<stop>\d+)\]")
_FOOT_PATTERNS = ("{leg}_foot", "{leg}_foot_force", "{leg}_force", "foot_{leg}")


@dataclass(frozen=True, slots=True)
class FootEntry:
    """The place of a foot force in a JointState: its field, and the name or index of the entry."""

    field: str
    key: str | int


class JointEntries:
    """Finds a robot's joints among the entries of JointState messages.

    Attributes:
        joint_names: the robot's joints, in the order of every reading.
    """

    def __init__(self, robot: RobotDescription, config: RosbagConfig) -> None:
        """Set the names and signs of the joints.

        Raises:
            DatasetError: the configuration names a joint that the robot does not have.
        """
        self.joint_names = robot.joint_names
        for key in ("joint_names", "joint_signs"):
            unknown = set(getattr(config, key)) - set(self.joint_names)
            if unknown:
                raise DatasetError(
                    f"dataset.rosbag.{key} names {listing(unknown)}, which {robot.name} does not have; "
                    f"its joints are {listing(self.joint_names)}"
                )
        self._spellings = {joint: [joint] for joint in self.joint_names}
        for alias, joint in robot.joint_aliases.items():
            self._spellings[joint].append(alias)
        self._spellings.update({joint: [name] for joint, name in config.joint_names.items()})
        self._signs = np.array([float(config.joint_signs.get(joint, 1)) for joint in self.joint_names])
        self._unnamed = config.joint_entries
        self._indices: dict[tuple[str, ...], tuple[Any, Any]] = {}

    def found(self, names: Sequence[str]) -> BoolArray:
        """Which joints are among ``names``, (joints,)."""
        available = set(names)
        return np.array([any(name in available for name in self._spellings[joint]) for joint in self.joint_names])

    def unknown(self, names: Iterable[str]) -> tuple[str, ...]:
        """Those of ``names`` that are not the name of a joint."""
        known = {spelling for spellings in self._spellings.values() for spelling in spellings}
        return tuple(name for name in names if name not in known)

    def read(self, message: Any) -> tuple[Array, BoolArray]:
        """Angle, velocity and torque of the joints in a message (3, joints), and which joints it holds (joints,).

        NaN where a joint is absent, has no such reading, or reads infinity.
        """
        names = tuple(entry_names(message, self._unnamed))
        if names not in self._indices:
            index = {name: i for i, name in reversed(list(enumerate(names)))}
            found = [next((index[n] for n in self._spellings[j] if n in index), -1) for j in self.joint_names]
            joints = np.flatnonzero(np.array(found) >= 0)
            self._indices[names] = joints, np.array([i for i in found if i >= 0], dtype=int)
        joints, entries = self._indices[names]
        values = np.full((3, len(self.joint_names)), np.nan)
        for row, field in enumerate(_FIELDS):
            readings = np.asarray(getattr(message, field), dtype=np.float64)
            has = entries < len(readings)
            values[row, joints[has]] = readings[entries[has]]
        values[~np.isfinite(values)] = np.nan
        is_present = np.zeros(len(self.joint_names), dtype=np.bool_)
        is_present[joints] = True
        return values * self._signs, is_present


def choose_joint_topics(
    entries: JointEntries, preview: BagPreview, candidates: Sequence[str]
) -> tuple[list[str], BoolArray]:
    """The topics that together hold most of the joints, the one with most first, and which joints those are (joints,).

    A topic that adds no joint is left out, so that commands beside the readings are not read too.
    """
    found = {topic: entries.found(preview.entries.get(topic, ())) for topic in candidates}
    is_present: BoolArray = np.zeros(len(entries.joint_names), dtype=np.bool_)
    chosen: list[str] = []

    def rank(topic: str) -> tuple[int, bool, int, str]:
        return -gains[topic], _is_command(topic), -preview.counts[topic], topic

    while True:
        gains = {topic: int((found[topic] & ~is_present).sum()) for topic in candidates if topic not in chosen}
        best = min(gains, key=rank, default="")
        if not best or gains[best] == 0:
            return chosen, is_present
        chosen.append(best)
        is_present |= found[best]


def missing_joints(
    entries: JointEntries, is_present: BoolArray, preview: BagPreview, candidates: Sequence[str]
) -> str | None:
    """Which joints the bag lacks and which it has instead, as a sentence; None where all are present."""
    if is_present.all():
        return None
    if not candidates:
        return f"there are no joints: no JointState among the topics {listing(preview.types)}"
    names = {name for topic in candidates for name in preview.entries.get(topic, ())}
    if not names:
        return f"the messages on {listing(candidates)} name no joints; list their names in dataset.rosbag.joint_entries"
    missing = [name for name, has_it in zip(entries.joint_names, is_present, strict=True) if not has_it]
    others = entries.unknown(names)
    return (
        f"no joint is called {listing(missing)}: the {'other ' if is_present.any() else ''}names on "
        f"{listing(candidates)} are {listing(others)}; "
        "map the names in dataset.rosbag.joint_names, or name another robot"
    )


def foot_entries(robot: RobotDescription, config: RosbagConfig, names: Sequence[str]) -> dict[str, FootEntry]:
    """By leg, the entry of the joint messages that holds its foot force: as configured, otherwise inferred by name.

    Args:
        robot: describes the legs.
        config: may name an entry for each leg or one range for all.
        names: names of the entries in the joint messages.

    Raises:
        DatasetError: the configuration cannot be parsed, or does not fit the legs.
    """
    configured = config.foot_force_entries
    if configured is None:
        inferred: dict[str, FootEntry] = {}
        for leg in robot.legs:
            spelled = [leg.foot_frame, *(pattern.format(leg=leg.name) for pattern in _FOOT_PATTERNS)]
            name = next((name for name in spelled if name in names), None)
            if name is not None:
                inferred[leg.name] = FootEntry("effort", name)
        return inferred
    if isinstance(configured, str):
        return _entries_in_range(robot, configured) if configured else {}
    unknown = set(configured) - set(robot.leg_names)
    if unknown:
        raise DatasetError(
            f"dataset.rosbag.foot_force_entries names the legs {listing(unknown)}; "
            f"the legs of {robot.name} are {listing(robot.leg_names)}"
        )
    return {leg: _entry(text) for leg, text in configured.items()}


def read_feet(message: Any, entries: Mapping[str, FootEntry], legs: Sequence[str], unnamed: Sequence[str]) -> Array:
    """The force on each foot from the entries of a joint message, (legs,); NaN where it holds none."""
    names = list(entry_names(message, unnamed))
    force = np.full(len(legs), np.nan)
    for i, leg in enumerate(legs):
        entry = entries.get(leg)
        if entry is None:
            continue
        index = entry.key if isinstance(entry.key, int) else _index_of(entry.key, names)
        values = getattr(message, entry.field)
        if index is not None and index < len(values) and np.isfinite(values[index]):
            force[i] = values[index]
    return force


def wrench_force(message: Any, component: str) -> float:
    """The foot force in a WrenchStamped, N: its z or the length of its force; NaN where it is not finite."""
    force = message.wrench.force
    value = float(force.z) if component == "z" else float(np.linalg.norm([force.x, force.y, force.z]))
    return value if np.isfinite(value) else np.nan


def _is_command(topic: str) -> bool:
    return re.search(r"command|cmd|desired|target|setpoint|reference", topic.lower()) is not None


def _index_of(name: str, names: Sequence[str]) -> int | None:
    return names.index(name) if name in names else None


def _entry(text: str) -> FootEntry:
    match = _ENTRY.fullmatch(text.strip())
    if match is None:
        raise DatasetError(
            f"dataset.rosbag.foot_force_entries: {text!r} must be the name of an entry, such as FL_foot or "
            "effort[FL_foot], or its number, such as effort[12]"
        )
    if match["name"]:
        return FootEntry("effort", match["name"])
    inner = match["inner"]
    return FootEntry(match["field"], int(inner) if inner.isdigit() else inner)


def _entries_in_range(robot: RobotDescription, text: str) -> dict[str, FootEntry]:
    match = _RANGE.fullmatch(text.strip())
    count = 0 if match is None else int(match["stop"]) - int(match["start"])
    if match is None or count != len(robot.legs):
        raise DatasetError(
            f"dataset.rosbag.foot_force_entries: {text!r} must be a range of {len(robot.legs)} entries, one for each "
            f"of the legs {', '.join(robot.leg_names)}, such as effort[12:{12 + len(robot.legs)}]"
        )
    return {leg: FootEntry(match["field"], int(match["start"]) + i) for i, leg in enumerate(robot.leg_names)}

# SPDX-License-Identifier: BSD-3-Clause
"""JointState messages and wrenches to readings of all joints and all feet, whatever their order and however spread."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from coclo_vio.datasets.rosbag.config import RosbagConfig
from coclo_vio.datasets.rosbag.glance import Glance
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.errors import DatasetError, listing

_FIELDS = ("position", "velocity", "effort")
_ENTRY = re.compile(r"(?:(?P<field>position|velocity|effort)\[(?P<inner>[^\]]+)\])|(?P<name>[^\[\]]+)")
_RANGE = re.compile(r"(?P<field>position|velocity|effort)\[(?P<start>\d+):(?P<stop>\d+)\]")
_FOOT_PATTERNS = ("{leg}_foot", "{leg}_foot_force", "{leg}_force", "foot_{leg}")


@dataclass(frozen=True, slots=True)
class FootEntry:
    """Where a JointState holds the force on a foot: a field, and an entry by name or by number."""

    field: str
    entry: str | int


class JointEntries:
    """Finds a robot's joints among the entries of JointState messages.

    Attributes:
        joint_names: the robot's, in the order of every reading.
    """

    def __init__(self, robot: RobotDescription, config: RosbagConfig) -> None:
        """Take the names and signs of the joints.

        Raises:
            DatasetError: the configuration names a joint that the robot does not have.
        """
        self.joint_names = robot.joint_names
        for key in ("joint_names", "joint_signs"):
            strangers = set(getattr(config, key)) - set(self.joint_names)
            if strangers:
                raise DatasetError(
                    f"dataset.rosbag.{key} names {listing(strangers)}, no joint of {robot.name}; "
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
        there = set(names)
        return np.array([any(name in there for name in self._spellings[joint]) for joint in self.joint_names])

    def strangers(self, names: Iterable[str]) -> tuple[str, ...]:
        """Those of ``names`` that are no joint's."""
        known = {spelling for spellings in self._spellings.values() for spelling in spellings}
        return tuple(name for name in names if name not in known)

    def read(self, message: Any) -> tuple[Array, BoolArray]:
        """Angle, velocity and torque of the joints in a message (3, joints), and which joints it speaks of (joints,).

        NaN where a joint is not there, has no such reading, or reads infinity.
        """
        names = tuple(message.name) or self._unnamed
        if names not in self._indices:
            place = {name: i for i, name in reversed(list(enumerate(names)))}
            at = [next((place[n] for n in self._spellings[j] if n in place), -1) for j in self.joint_names]
            self._indices[names] = np.flatnonzero(np.array(at) >= 0), np.array([i for i in at if i >= 0], dtype=int)
        ours, theirs = self._indices[names]
        values = np.full((3, len(self.joint_names)), np.nan)
        for row, field in enumerate(_FIELDS):
            given = np.asarray(getattr(message, field), dtype=np.float64)
            has = theirs < len(given)
            values[row, ours[has]] = given[theirs[has]]
        values[~np.isfinite(values)] = np.nan
        is_there = np.zeros(len(self.joint_names), dtype=np.bool_)
        is_there[ours] = True
        return values * self._signs, is_there


def choose_joint_topics(entries: JointEntries, seen: Glance, there: Sequence[str]) -> tuple[list[str], BoolArray]:
    """The topics that together hold most of the joints, the one with most first, and which joints those are (joints,).

    A topic that adds no joint is left out, so that commands beside the readings are not read too.
    """
    found = {topic: entries.found(seen.entries.get(topic, ())) for topic in there}
    has: BoolArray = np.zeros(len(entries.joint_names), dtype=np.bool_)
    chosen: list[str] = []
    while True:
        gains = {topic: int((found[topic] & ~has).sum()) for topic in there if topic not in chosen}
        best = min(gains, key=lambda topic: (-gains[topic], _is_command(topic), -seen.counts[topic], topic), default="")
        if not best or gains[best] == 0:
            return chosen, has
        chosen.append(best)
        has |= found[best]


def complaint_of_joints(entries: JointEntries, has: BoolArray, seen: Glance, there: Sequence[str]) -> str | None:
    """What is wrong with the joints in the bag, as a sentence; None where all are there."""
    if has.all():
        return None
    if not there:
        return f"there are no joints: no JointState among the topics {listing(seen.types)}"
    names = {name for topic in there for name in seen.entries.get(topic, ())}
    if not names:
        return f"the messages on {listing(there)} name no joints; name them in order in dataset.rosbag.joint_entries"
    missing = [name for name, is_there in zip(entries.joint_names, has, strict=True) if not is_there]
    others = entries.strangers(names)
    return (
        f"no joint is called {listing(missing)}: the {'other ' if has.any() else ''}names on {listing(there)} are "
        f"{listing(others)}; "
        "map the names in dataset.rosbag.joint_names, or name another robot"
    )


def foot_entries(robot: RobotDescription, config: RosbagConfig, names: Sequence[str]) -> dict[str, FootEntry]:
    """Where the joint messages hold the force on each leg's foot, as configured, otherwise guessed by name.

    Args:
        robot: whose legs.
        config: may name an entry a leg or one range for all.
        names: of the entries in the joint messages.

    Raises:
        DatasetError: the configuration cannot be understood, or does not fit the legs.
    """
    given = config.foot_force_entries
    if given is None:
        guesses: dict[str, FootEntry] = {}
        for leg in robot.legs:
            spelled = [leg.foot_frame, *(pattern.format(leg=leg.name) for pattern in _FOOT_PATTERNS)]
            name = next((name for name in spelled if name in names), None)
            if name is not None:
                guesses[leg.name] = FootEntry("effort", name)
        return guesses
    if isinstance(given, str):
        return _entries_in_range(robot, given) if given else {}
    strangers = set(given) - set(robot.leg_names)
    if strangers:
        raise DatasetError(
            f"dataset.rosbag.foot_force_entries names the legs {listing(strangers)}; "
            f"the legs of {robot.name} are {listing(robot.leg_names)}"
        )
    return {leg: _entry(text) for leg, text in given.items()}


def read_feet(message: Any, entries: Mapping[str, FootEntry], legs: Sequence[str], unnamed: Sequence[str]) -> Array:
    """The force on each foot from the entries of a joint message, (legs,); NaN where it holds none."""
    names = list(message.name) or list(unnamed)
    force = np.full(len(legs), np.nan)
    for i, leg in enumerate(legs):
        where = entries.get(leg)
        if where is None:
            continue
        index = where.entry if isinstance(where.entry, int) else _index_of(where.entry, names)
        values = getattr(message, where.field)
        if index is not None and index < len(values) and np.isfinite(values[index]):
            force[i] = values[index]
    return force


def wrench_force(message: Any, component: str) -> float:
    """The foot force in a WrenchStamped, N: its z or the length of its force; NaN where it is not finite."""
    force = message.wrench.force
    value = float(force.z) if component == "z" else float(np.linalg.norm([force.x, force.y, force.z]))
    return value if np.isfinite(value) else np.nan


class Collator:
    """Puts together what belongs to one time but comes in several messages.

    A reading is complete when everything that is expected has spoken; it is closed unfinished when a message is of
    another time or speaks of something for the second time. Its stamp is that of its latest part.
    """

    def __init__(self, is_expected: BoolArray, tolerance_ns: int) -> None:
        self._is_expected = is_expected
        self._tolerance_ns = tolerance_ns
        self._held: _Part | None = None

    def push(self, stamp_ns: int, match_ns: int, values: Array, is_there: BoolArray) -> Iterator[tuple[int, Array]]:
        """Take a part.

        Args:
            stamp_ns: its time.
            match_ns: the time by which it is matched with other parts; the same, but where arrivals are believed.
            values: (..., n), NaN where it says nothing.
            is_there: of which entries it speaks, (n,).

        Yields:
            Stamp and values of what is complete or can be so no more.
        """
        part = _Part(stamp_ns, match_ns, values, is_there)
        held, self._held = self._held, None
        if held is not None:
            if abs(match_ns - held.match_ns) > self._tolerance_ns or (held.is_there & is_there).any():
                yield held.stamp_ns, held.values
            else:
                part = held.joined_by(part)
        if (part.is_there | ~self._is_expected).all():
            yield part.stamp_ns, part.values
        else:
            self._held = part

    def finish(self) -> Iterator[tuple[int, Array]]:
        """What is still held at the end."""
        if self._held is not None:
            yield self._held.stamp_ns, self._held.values
            self._held = None


class _Part(NamedTuple):
    """Some entries of a reading."""

    stamp_ns: int
    match_ns: int
    values: Array
    is_there: BoolArray

    def joined_by(self, later: "_Part") -> "_Part":
        values = np.where(later.is_there, later.values, self.values)
        stamp_ns = max(self.stamp_ns, later.stamp_ns)
        return _Part(stamp_ns, self.match_ns, values, self.is_there | later.is_there)


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

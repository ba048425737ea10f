# SPDX-License-Identifier: BSD-3-Clause
"""The first messages of every topic of a bag, from which the topics of the sensors are chosen."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from coclo_vio.datasets.rosbag.imu_bytes import ImuReader
from coclo_vio.datasets.rosbag.imu_halves import HalfTally, ImuHalves
from coclo_vio.datasets.rosbag.message_types import CAMERA_INFO, IMU, JOINT_STATE, POSES, WRENCH, missing_field
from coclo_vio.datasets.rosbag.storage.message_set import MessageSet, RawMessage
from coclo_vio.values.errors import DatasetError, listing
from coclo_vio.values.units import NS_PER_S

_DECODED = frozenset({JOINT_STATE, IMU, CAMERA_INFO, WRENCH, *POSES})
_STAMPED = frozenset({JOINT_STATE, IMU, WRENCH})
_MESSAGES_READ = {IMU: 100, JOINT_STATE: 50, WRENCH: 20}  # for rates, and for parts of one reading; else one


@dataclass(frozen=True, slots=True)
class BagPreview:
    """The topics of a bag and what their first messages hold.

    Attributes:
        types: the type of every topic that has messages, as configured or as in the bag.
        counts: number of messages of every topic.
        first: the first message of every topic of a type that is read, images left out.
        stamps_ns: stamps of the first messages of every Imu, JointState and WrenchStamped topic.
        halves: which readings the messages of every Imu topic have.
        parts: by JointState and WrenchStamped topic, name of the part and stamp of its first messages; messages of one
            topic that hold other joints are other parts.
        entries: joint names in the first messages of every JointState topic, in the order of their appearance.
        entries_with_velocity: those of them that came with a velocity.
    """

    types: Mapping[str, str]
    counts: Mapping[str, int]
    first: Mapping[str, Any]
    stamps_ns: Mapping[str, tuple[int, ...]]
    halves: Mapping[str, ImuHalves]
    parts: Mapping[str, tuple[tuple[str, int], ...]]
    entries: Mapping[str, tuple[str, ...]]
    entries_with_velocity: Mapping[str, frozenset[str]]

    def of_type(self, *msgtypes: str) -> tuple[str, ...]:
        """The topics of these types, by name."""
        return tuple(topic for topic, msgtype in self.types.items() if msgtype in msgtypes)

    def frame(self, topic: str) -> str:
        """``frame_id`` of the topic's first message, without a leading slash; empty without a message."""
        message = self.first.get(topic)
        return "" if message is None else str(message.header.frame_id).lstrip("/")

    def rate_hz(self, topic: str) -> float | None:
        """The median rate of the first messages of an IMU topic, or None with fewer than three."""
        stamps_ns = self.stamps_ns.get(topic, ())
        if len(stamps_ns) < 3:
            return None
        period_ns = float(np.median(np.diff(stamps_ns)))
        return NS_PER_S / period_ns if period_ns > 0 else None


def preview_of(bag: MessageSet, types: Mapping[str, str], joint_entries: Sequence[str] = ()) -> BagPreview:
    """Read a bag until the first messages of each topic have been found.

    Args:
        bag: the bag.
        types: message type by topic, in place of the type that the bag names.
        joint_entries: names of the entries of a JointState without names, or with another number of names than angles.

    Raises:
        DatasetError: no message at all, or one that does not fit its type.
    """
    is_counted = bag.damage is None and any(topic.count for topic in bag.topics.values())
    available = {
        name: types.get(name, topic.msgtype) for name, topic in bag.topics.items() if topic.count or not is_counted
    }
    if not available:
        raise DatasetError(f"{bag.origin} holds no message; its topics are: {listing(bag.topics)}")
    found = _Findings(bag, available, joint_entries)
    remaining = {name: _MESSAGES_READ.get(msgtype, 1) for name, msgtype in available.items() if msgtype in _DECODED}
    for message in bag.messages(set(remaining)):
        topic = message.topic
        if topic not in remaining or not found.add(message):
            continue
        remaining[topic] -= 1
        if topic not in available or (remaining[topic] <= 0 and found.halves.is_settled(topic)):
            del remaining[topic]
            if not remaining:
                break
    return found.preview()


class _Findings:
    """What the first messages of the topics hold; a topic whose messages lack a field is taken out of ``available``."""

    def __init__(self, bag: MessageSet, available: dict[str, str], joint_entries: Sequence[str]) -> None:
        self._bag = bag
        self._available = available
        self._joint_entries = joint_entries
        self._first: dict[str, Any] = {}
        self._stamps_ns: defaultdict[str, list[int]] = defaultdict(list)
        self._joints: defaultdict[str, _Entries] = defaultdict(_Entries)
        self._parts: defaultdict[str, list[tuple[str, int]]] = defaultdict(list)
        self.halves = _Halves(bag, [name for name, msgtype in available.items() if msgtype == IMU])

    def add(self, raw: RawMessage) -> bool:
        """Take a message; False for one that cannot be read."""
        topic, kind = raw.topic, self._available[raw.topic]
        part = topic
        if topic not in self._first or kind == JOINT_STATE:
            message = self._bag.readable(topic, raw.data)
            if message is None:
                return False
            if topic not in self._first and (field := missing_field(message, kind)) is not None:
                self._bag.notes.append(f"{topic} is not read: its messages of type {kind} have no {field}")
                del self._available[topic]
                return True
            self._first.setdefault(topic, message)
            if kind == JOINT_STATE:
                self._joints[topic].add(message, self._joint_entries)
                part = f"{topic} {sorted(message.name)}"
        if kind in _STAMPED:
            stamp_ns = self._bag.readable_stamp_ns(raw)
            if stamp_ns is None:
                return False
            self._stamps_ns[topic].append(stamp_ns)
            self._parts[topic].append((part, stamp_ns))
        if kind == IMU:
            self.halves.add(topic, raw.data)
        return True

    def preview(self) -> BagPreview:
        """All that was found."""
        return BagPreview(
            self._available,
            {name: topic.count for name, topic in self._bag.topics.items()},
            self._first,
            {name: tuple(stamps) for name, stamps in self._stamps_ns.items()},
            self.halves.found(),
            {name: tuple(parts) for name, parts in self._parts.items()},
            {name: tuple(entries.names) for name, entries in self._joints.items()},
            {name: frozenset(entries.with_velocity) for name, entries in self._joints.items()},
        )


class _Halves:
    """What the Imu topics of a bag have."""

    def __init__(self, bag: MessageSet, topics: Sequence[str]) -> None:
        self._reader = ImuReader(bag)
        self._tallies = {topic: HalfTally(topic) for topic in topics}

    def add(self, topic: str, data: bytes) -> None:
        if not self.is_settled(topic):
            with suppress(DatasetError):  # a message that cannot be decoded says nothing
                self._tallies[topic].add(*self._reader.read(topic, data), *self._reader.variances(topic, data))

    def is_settled(self, topic: str) -> bool:
        return topic not in self._tallies or self._tallies[topic].is_settled

    def found(self) -> dict[str, ImuHalves]:
        return {topic: tally.halves() for topic, tally in self._tallies.items()}


def entry_names(message: Any, joint_entries: Sequence[str]) -> Sequence[str]:
    """The names of the entries of a JointState.

    Its own names, or ``joint_entries`` where those are given and it has none, or not one for each angle.
    """
    is_named = bool(message.name) and len(message.name) == (len(message.position) or len(message.name))
    return joint_entries if joint_entries and not is_named else tuple(message.name)


@dataclass(slots=True)
class _Entries:
    """The names in JointState messages, and those of them that came with a velocity."""

    names: dict[str, None] = field(default_factory=dict)
    with_velocity: set[str] = field(default_factory=set)

    def add(self, message: Any, joint_entries: Sequence[str]) -> None:
        names = entry_names(message, joint_entries)
        self.names.update(dict.fromkeys(names))
        self.with_velocity.update(names[: len(message.velocity)])

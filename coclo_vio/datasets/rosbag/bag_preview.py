# SPDX-License-Identifier: BSD-3-Clause
"""The first messages of every topic of a bag, from which the topics of the sensors are chosen."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from coclo_vio.datasets.rosbag.message_types import CAMERA_INFO, IMU, JOINT_STATE, POSES, WRENCH
from coclo_vio.datasets.rosbag.storage.bag_file import BagFile
from coclo_vio.values.errors import DatasetError, listing
from coclo_vio.values.units import NS_PER_S

_DECODED = frozenset({JOINT_STATE, IMU, CAMERA_INFO, WRENCH, *POSES})
_MESSAGES_READ = {IMU: 100, JOINT_STATE: 50}  # an IMU's rate and joints spread over messages need several; else one


@dataclass(frozen=True, slots=True)
class BagPreview:
    """The topics of a bag and what their first messages hold.

    Attributes:
        types: the type of every topic that has messages, as configured or as in the bag.
        counts: number of messages of every topic.
        first: the first message of every topic of a type that is read, images left out.
        stamps_ns: header stamps of the first messages of every IMU topic.
        entries: joint names in the first messages of every JointState topic, in the order of their appearance.
        entries_with_velocity: those of them that came with a velocity.
    """

    types: Mapping[str, str]
    counts: Mapping[str, int]
    first: Mapping[str, Any]
    stamps_ns: Mapping[str, tuple[int, ...]]
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


def preview_of(bag: BagFile, types: Mapping[str, str], joint_entries: Sequence[str] = ()) -> BagPreview:
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
        raise DatasetError(f"{bag.path} holds no message; its topics are: {listing(bag.topics)}")
    first: dict[str, Any] = {}
    stamps_ns: defaultdict[str, list[int]] = defaultdict(list)
    joints: defaultdict[str, _Entries] = defaultdict(_Entries)
    remaining = {name: _MESSAGES_READ.get(msgtype, 1) for name, msgtype in available.items() if msgtype in _DECODED}
    for topic, _, data in bag.messages(set(remaining)):
        if topic not in remaining:
            continue
        if topic not in first or available[topic] == JOINT_STATE:
            message = bag.readable(topic, data)
            if message is None:
                continue
            first.setdefault(topic, message)
            if available[topic] == JOINT_STATE:
                joints[topic].add(message, joint_entries)
        if available[topic] == IMU:
            stamps_ns[topic].append(bag.header_stamp_ns(topic, data))
        remaining[topic] -= 1
        if remaining[topic] == 0:
            del remaining[topic]
            if not remaining:
                break
    return BagPreview(
        available,
        {name: topic.count for name, topic in bag.topics.items()},
        first,
        {name: tuple(stamps) for name, stamps in stamps_ns.items()},
        {name: tuple(entries.names) for name, entries in joints.items()},
        {name: frozenset(entries.with_velocity) for name, entries in joints.items()},
    )


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

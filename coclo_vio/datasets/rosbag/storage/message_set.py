# SPDX-License-Identifier: BSD-3-Clause
"""Messages on topics as bytes, with what decodes them: those of a bag, or of a wire as they arrive."""

import struct
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

from rosbags.typesys.store import Typestore

from coclo_vio.datasets.rosbag.storage import files
from coclo_vio.values.errors import DatasetError, TimestampError
from coclo_vio.values.units import NS_PER_S


@dataclass(frozen=True, slots=True)
class BagTopic:
    """A topic: its name, its type such as ``sensor_msgs/msg/Imu``, and how many messages it has."""

    name: str
    msgtype: str
    count: int


class RawMessage(NamedTuple):
    """A message as bytes, and the time at which it was received, ns."""

    topic: str
    received_ns: int
    data: bytes


class MessageSet(ABC):
    """Messages of one origin.

    Attributes:
        origin: where they come from, for error messages: the path of a bag, the name of a wire.
        is_ros1: whether they are serialized as ROS 1 does it; otherwise as CDR.
        topics: the topics by name.
        damage: what is damaged, or None where everything could be read so far.
        notes: sentences on what is odd about the origin.
    """

    origin: str
    is_ros1: bool
    topics: dict[str, BagTopic]
    damage: str | None
    notes: list[str]

    def __init__(self, origin: str, *, is_ros1: bool, allow_partial: bool) -> None:
        """Begin without topics.

        Args:
            origin: where the messages come from.
            is_ros1: whether they are serialized as ROS 1 does it.
            allow_partial: whether a message that cannot be decoded is left out; otherwise it is an error.
        """
        self.origin, self.is_ros1 = origin, is_ros1
        self.topics, self.damage, self.notes = {}, None, []
        self._allow_partial = allow_partial

    @abstractmethod
    def messages(self, names: Collection[str]) -> Iterator[RawMessage]:
        """The messages of the topics ``names`` in the order of arrival, from the first on.

        Raises:
            DatasetError: the origin is damaged and partial reading is not allowed.
        """

    @abstractmethod
    def typed(self, topic: str) -> tuple[str, Typestore]:
        """The type of a topic and its message definitions."""

    def carriers(self, names: Collection[str]) -> frozenset[str]:
        """The topics whose messages belong to the topics ``names``."""
        return frozenset(names)

    def expanded(self, message: RawMessage, names: Collection[str]) -> Iterator[RawMessage]:
        """The message once for each of the topics ``names`` to which it belongs."""
        if message.topic in names:
            yield message

    def decoded(self, topic: str, data: bytes) -> Any:
        """The message in ``data``, an object with the fields of its type.

        Raises:
            DatasetError: the bytes do not fit the type.
        """
        try:
            msgtype, store = self.typed(topic)
            if msgtype not in store.fielddefs:
                raise LookupError(f"the bag has no definition of {msgtype}; record it as MCAP, which has them")
            return store.deserialize_ros1(data, msgtype) if self.is_ros1 else store.deserialize_cdr(data, msgtype)
        except Exception as error:  # rosbags raises its own, struct's, KeyError, assertions
            raise DatasetError(
                f"{self.origin}: a message on {topic} does not decode as "
                f"{self.topics[topic].msgtype} ({files.reason_of(error)}); --allow-partial "
                "(dataset.allow_partial) leaves it out"
            ) from error

    def readable(self, topic: str, data: bytes) -> Any | None:
        """The message in ``data``, or None where it cannot be decoded and partial reading is allowed.

        Raises:
            DatasetError: the bytes do not fit the type.
        """
        try:
            return self.decoded(topic, data)
        except DatasetError:
            if not self._allow_partial:
                raise
            return None

    def header_stamp_ns(self, topic: str, data: bytes) -> int:
        """The stamp in the header with which the message begins, ns, without decoding the rest.

        Raises:
            TimestampError: the message is too short to have one.
        """
        try:
            if self.is_ros1:
                _, seconds, nanoseconds = struct.unpack_from("<III", data)
            else:
                is_little = data[1] & 1
                seconds, nanoseconds = struct.unpack_from("<iI" if is_little else ">iI", data, 4)
        except (struct.error, IndexError) as error:
            raise TimestampError(f"{self.origin}: a message on {topic} is too short to have a stamp") from error
        return int(seconds) * NS_PER_S + int(nanoseconds)

    def readable_stamp_ns(self, message: RawMessage) -> int | None:
        """The stamp in a message's header, or the time of its arrival where that is 0; None where it has none.

        Raises:
            TimestampError: the message is too short to have one, and partial reading is not allowed.
        """
        try:
            return self.header_stamp_ns(message.topic, message.data) or message.received_ns
        except DatasetError:
            if not self._allow_partial:
                raise
            return None

    def is_stamped_on_arrival(self, message: RawMessage) -> bool:
        """Whether a message's time is that of its arrival, whatever the configuration: it has no header."""
        return False

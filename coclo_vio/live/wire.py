# SPDX-License-Identifier: BSD-3-Clause
"""What a source of messages and a sink of messages are: two small protocols, and the values that pass through them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from coclo_vio.datasets.rosbag.message_types import CAMERA_INFO, IMAGES, IMU, JOINT_STATE, WRENCH
from coclo_vio.datasets.rosbag.storage.message_set import RawMessage
from coclo_vio.values.measurements import Measurement

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

TF_MESSAGE = "tf2_msgs/msg/TFMessage"
READ_TYPES = frozenset({JOINT_STATE, IMU, WRENCH, CAMERA_INFO, *IMAGES})
"""The types that are read wherever they are; others only on topics that the configuration names."""


@dataclass(frozen=True, slots=True)
class WireMessage:
    """A message as it came.

    Attributes:
        topic: with a leading slash.
        msgtype: such as ``sensor_msgs/msg/Imu``.
        data: CDR.
        arrived_ns: when it came, by the clock of this computer, ns since 1970.
        sent_ns: when it was sent, by the sender's clock, ns since 1970; None where the wire does not say so.
        sequence: its number among those of its sender; None where the wire does not say so.
        sender: which of several publishers of the topic.
        monotonic_ns: when it came, by a clock of this computer that never steps; None of a source that does not know
            when its messages came, such as a file.
    """

    topic: str
    msgtype: str
    data: bytes
    arrived_ns: int
    sent_ns: int | None = None
    sequence: int | None = None
    sender: bytes = b""
    monotonic_ns: int | None = None


def raw_message(message: WireMessage, unstamped: str) -> RawMessage:
    """A message with the time that counts where it has no header of its own: that of sending or of arrival."""
    at_ns = message.sent_ns if unstamped == "sent" and message.sent_ns is not None else message.arrived_ns
    return RawMessage(message.topic, at_ns, message.data)


Take = Callable[[WireMessage | Measurement], None]
Wants = Callable[[str, str], bool]
Refuse = Callable[[str, str], None]
"""Called with a topic and the reason why something on it cannot be read."""
Lose = Callable[[str, int], None]
"""Called with a topic and how many messages the wire itself says were lost on it."""


@dataclass(frozen=True, slots=True)
class Receiver:
    """Where a source hands over what comes; all may be called from any thread.

    Attributes:
        wants: whether messages on a topic of a type are read.
        take: takes a message, or a measurement of a source that has no messages.
        refuse: counts what cannot be read, with topic and reason.
        lose: counts what the wire lost.
    """

    wants: Wants
    take: Take
    refuse: Refuse
    lose: Lose


class Source(Protocol):
    """Something from which messages or measurements come while the estimator runs.

    Attributes:
        name: for messages and records, such as ``zenoh tcp/localhost:7447``.
        is_over: whether nothing more will come.
    """

    name: str
    is_over: bool

    def start(self, receiver: Receiver) -> None:
        """Begin to hand over what comes.

        Raises:
            DatasetError: the source cannot be opened.
        """

    def poll(self) -> None:
        """Do what has to be done now and then, such as to subscribe to topics that are new; called a few times a s."""

    def typed(self, topic: str, msgtype: str) -> "tuple[str, Typestore]":
        """The type of a topic and the definitions that decode it."""

    def close(self) -> None:
        """End it; nothing is handed over afterwards."""


class Sink(Protocol):
    """Something to which messages go.

    Attributes:
        name: for error messages.
    """

    name: str

    def publish(self, topic: str, msgtype: str, stamp_ns: int, data: bytes) -> None:
        """Send a message.

        Args:
            topic: with a leading slash.
            msgtype: such as ``nav_msgs/msg/Odometry``.
            stamp_ns: its time, ns.
            data: CDR.
        """

    def close(self) -> None:
        """End it."""


class RobotWire(Sink, Protocol):
    """A sink that can stand in for a robot: it announces its topics, and knows whether somebody listens."""

    def announce(self, topic: str, msgtype: str, *, is_transient_local: bool = False) -> None:
        """Announce a topic before anything is published on it.

        Args:
            topic: with a leading slash.
            msgtype: of its messages.
            is_transient_local: whether late subscribers get the last messages too.
        """

    def has_listeners(self, topic: str) -> bool:
        """Whether somebody subscribes to a topic."""

    def flush(self, timeout_s: float) -> None:
        """Wait until what was published has been taken, where the wire knows that."""

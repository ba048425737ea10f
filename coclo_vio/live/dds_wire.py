# SPDX-License-Identifier: BSD-3-Clause
"""ROS 2 topics over DDS by Cyclone DDS, in both directions on one participant. The only importer of cyclonedds.

A topic ``/imu`` of ROS 2 is ``rt/imu`` in DDS. Publishers are found by DDS's own discovery; messages are taken and
written as bytes. The network is that of the environment variable ``CYCLONEDDS_URI``.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

from cyclonedds import _clayer, builtin, core, pub, qos, sub
from cyclonedds import domain as dds_domain
from cyclonedds import topic as dds_topic

from coclo_vio.datasets.rosbag.storage.type_definitions import TypeDefinitions
from coclo_vio.live.dds_types import DdsTypes
from coclo_vio.live.ros_names import ros_name
from coclo_vio.live.wire import Receiver, WireMessage
from coclo_vio.values.errors import DatasetError, shortened
from coclo_vio.values.units import NS_PER_S

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_PREFIX = "rt/"
_LOOK_AROUND_NS = NS_PER_S // 10
_AT_ONCE = 256
_DEPTH = 1000  # that a reader holds
_WRITTEN = 10
_BLOCKS_NS = NS_PER_S // 10


class DdsWire:
    """A participant of DDS: a source and a sink.

    Attributes:
        name: the wire and its domain.
        is_over: never.
    """

    is_over = False

    def __init__(self, types: TypeDefinitions, domain: int = 0, *, keeps_all: bool = False) -> None:
        """Join the domain.

        Args:
            types: definitions of the message types.
            domain: ``ROS_DOMAIN_ID``.
            keeps_all: keep what is written until every subscriber has it, at the cost of waiting for a slow one;
                otherwise the last ten messages of a topic are kept.

        Raises:
            DatasetError: the domain cannot be joined.
        """
        self.name = f"dds domain {domain}"
        self._types, self._made, self._keeps_all = types, DdsTypes(types), keeps_all
        try:
            self._participant = dds_domain.DomainParticipant(domain)
        except Exception as error:  # Cyclone's own error
            raise DatasetError(
                f"the domain {domain} of DDS cannot be joined: {shortened(error)}; check --domain and the network "
                "interface in CYCLONEDDS_URI"
            ) from error
        self._readers: dict[tuple[str, str], Any] = {}
        self._writers: dict[str, Any] = {}
        self._topics: dict[str, Any] = {}
        self._is_closed = Event()
        self._receiver: Receiver | None = None
        self._publications: Any = None
        self._waitset: Any = None
        self._conditions: list[Any] = []
        self._listeners: list[Any] = []
        self._thread = Thread(target=self._read, name="coclo-vio dds reader", daemon=True)

    def start(self, receiver: Receiver) -> None:
        """Listen for publishers; topics are subscribed to by ``poll``.

        Raises:
            DatasetError: DDS refuses it.
        """
        self._receiver = receiver
        self._publications = builtin.BuiltinDataReader(self._participant, builtin.BuiltinTopicDcpsPublication)
        self._waitset = core.WaitSet(self._participant)
        self._thread.start()

    def poll(self) -> None:
        """Subscribe to the topics whose publishers have been seen since."""
        receiver = self._receiver
        if receiver is None:
            return
        for found in _appeared(self._publications):
            name, msgtype = str(found.topic_name), ros_name(str(found.type_name))
            if msgtype is None or not name.startswith(_PREFIX):
                continue
            topic = "/" + name.removeprefix(_PREFIX)
            if (topic, msgtype) not in self._readers and receiver.wants(topic, msgtype):
                self._subscribe(topic, msgtype, found.qos)

    def typed(self, topic: str, msgtype: str) -> "tuple[str, Typestore]":
        """The type with the definitions of the distribution."""
        return self._types.typed(msgtype)

    def publish(self, topic: str, msgtype: str, stamp_ns: int, data: bytes) -> None:
        """Send a message.

        Raises:
            DatasetError: DDS does not take it.
        """
        self.announce(topic, msgtype)
        padded = data.ljust((len(data) + 3) & ~3, b"\0")
        status = _clayer.ddspy_write(self._writers[topic]._ref, padded)
        if status < 0:
            raise DatasetError(f"DDS does not take a message on {topic} (status {status}); check its type {msgtype}")

    def announce(self, topic: str, msgtype: str, *, is_transient_local: bool = False) -> None:
        """Announce a topic before anything is published on it."""
        if topic in self._writers:
            return
        quality = _quality(
            is_reliable=True, is_transient_local=is_transient_local, depth=0 if self._keeps_all else _WRITTEN
        )
        self._writers[topic] = pub.DataWriter(self._participant, self._topic(topic, msgtype), qos=quality)

    def has_listeners(self, topic: str) -> bool:
        """Whether somebody subscribes to a topic that is published."""
        writer = self._writers.get(topic)
        return writer is not None and len(writer.get_matched_subscriptions()) > 0

    def flush(self, timeout_s: float) -> None:
        """Wait until everything that was written has been acknowledged."""
        for writer in self._writers.values():
            with suppress(Exception):
                writer.wait_for_acks(round(timeout_s * NS_PER_S))

    def close(self) -> None:
        """Leave the domain."""
        self._is_closed.set()
        if self._thread.is_alive():
            self._thread.join()
        self._conditions.clear()
        self._readers.clear()
        self._writers.clear()
        self._publications = self._waitset = None
        self._topics.clear()
        self._participant = None

    def _topic(self, topic: str, msgtype: str) -> Any:
        if topic not in self._topics:
            made = self._made.of(msgtype)
            self._topics[topic] = dds_topic.Topic(self._participant, _PREFIX + topic.lstrip("/"), made)
        return self._topics[topic]

    def _subscribe(self, topic: str, msgtype: str, offered: Any) -> None:
        receiver = self._receiver
        if receiver is None:
            return
        text = str(offered)
        quality = _quality(
            is_reliable="Reliability.Reliable" in text,
            is_transient_local="Durability.TransientLocal" in text,
            depth=_DEPTH,
        )
        try:
            listener = _lost_listener(lambda count: receiver.lose(topic, count))
            entity = sub.DataReader(self._participant, self._topic(topic, msgtype), qos=quality, listener=listener)
        except Exception as error:  # a type that is not known, or one that DDS does not take
            self._readers[topic, msgtype] = None
            receiver.refuse(topic, f"cannot be subscribed to: {shortened(error)}")
            return
        self._listeners.append(listener)
        self._readers[topic, msgtype] = entity
        condition = core.ReadCondition(entity, _any_mask())
        self._conditions.append(condition)
        self._waitset.attach(condition)

    def _read(self) -> None:
        """Take what comes, until the wire is closed."""
        while not self._is_closed.is_set():
            try:
                self._waitset.wait(_LOOK_AROUND_NS)
                for (topic, msgtype), reader in list(self._readers.items()):
                    if reader is not None:
                        self._take(topic, msgtype, reader)
            except Exception as error:  # one topic must not end the others
                if self._receiver is not None and not self._is_closed.is_set():
                    self._receiver.refuse("dds", f"reading failed: {shortened(error)}")
                    self._is_closed.wait(_LOOK_AROUND_NS / NS_PER_S)

    def _take(self, topic: str, msgtype: str, reader: Any) -> None:
        samples = _taken(reader)
        arrived_ns, monotonic_ns = time.time_ns(), time.monotonic_ns()
        receiver = self._receiver
        for data, info in samples:
            if not info.valid_data or receiver is None:
                continue
            sender = int(info.publication_handle).to_bytes(8, "little")
            sent_ns = int(info.source_timestamp)
            receiver.take(WireMessage(topic, msgtype, data, arrived_ns, sent_ns, None, sender, monotonic_ns))


def _quality(*, is_reliable: bool, is_transient_local: bool, depth: int) -> Any:
    """Quality of service as ROS 2 sets it; with depth 0 everything is kept."""
    history = qos.Policy.History.KeepLast(depth) if depth else qos.Policy.History.KeepAll
    durability = qos.Policy.Durability.TransientLocal if is_transient_local else qos.Policy.Durability.Volatile
    if is_transient_local:
        history = qos.Policy.History.KeepLast(_DEPTH)
    reliable, best_effort = qos.Policy.Reliability.Reliable(_BLOCKS_NS), qos.Policy.Reliability.BestEffort
    return qos.Qos(history, durability, reliable if is_reliable else best_effort)


def _any_mask() -> int:
    return int(core.SampleState.Any | core.ViewState.Any | core.InstanceState.Any)


def _taken(reader: Any) -> list[tuple[bytes, Any]]:
    """The bytes of the samples of a reader, each with what DDS knows of it."""
    taken = _clayer.ddspy_take(reader._ref, _any_mask(), _AT_ONCE)
    return [] if isinstance(taken, int) else list(taken)


def _appeared(publications: Any) -> list[Any]:
    """The publishers that have appeared; those that have gone are left out."""
    try:
        found = publications.take(N=_AT_ONCE)
    except core.DDSException:
        return []
    return [each for each in found if getattr(each, "type_name", None) and getattr(each, "topic_name", None)]


def _lost_listener(lose: Callable[[int], None]) -> Any:
    """Calls with the number of samples that DDS lost."""
    return core.Listener(on_sample_lost=lambda reader, status: lose(int(status.total_count_change)))

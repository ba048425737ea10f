# SPDX-License-Identifier: BSD-3-Clause
"""ROS 2 topics over zenoh as rmw_zenoh speaks it, in both directions on one session. The only importer of zenoh.

Topics are found by the liveliness tokens of their publishers. What is published has tokens of its own, so that ROS 2
nodes find it.
"""

import json
import time
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import zenoh
import zenoh.ext as zenoh_ext

from coclo_vio.datasets.rosbag.storage.type_definitions import TypeDefinitions
from coclo_vio.live.wire import Receiver, WireMessage
from coclo_vio.live.zenoh_keys import (
    Advertised,
    Attachment,
    NodeTokens,
    ZenohTopic,
    advertised_by,
    attachment_of,
    sender_of,
    tokens_key,
    topic_of_key,
)
from coclo_vio.runs.live_config import ZenohConfig
from coclo_vio.values.errors import DatasetError, shortened

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_HISTORY = 100  # messages that a transient-local publisher keeps


class ZenohWire:
    """A zenoh session with one ROS 2 node on it: a source and a sink.

    Attributes:
        name: the wire and its endpoints.
        is_over: never.
    """

    is_over = False

    def __init__(self, types: TypeDefinitions, config: ZenohConfig, node: str, domain: int = 0) -> None:
        """Open the session.

        Args:
            types: definitions and hashes of the message types.
            config: of the session.
            node: name of the node.
            domain: ``ROS_DOMAIN_ID``.

        Raises:
            DatasetError: the session cannot be opened.
        """
        self._types, self._domain = types, domain
        self.name = f"zenoh {', '.join((*config.connect, *config.listen)) or config.config_file or 'without endpoint'}"
        try:
            self._session = zenoh.open(_session_config(config))
        except Exception as error:  # zenoh's own error and those of its parser
            raise DatasetError(
                f"the session of {self.name} cannot be opened: {shortened(error)}; correct --endpoint or live.zenoh"
            ) from error
        self._tokens = NodeTokens(domain, str(self._session.zid()), node)
        self._declared: list[Any] = [self._session.liveliness().declare_token(self._tokens.node())]
        self._found: deque[Advertised] = deque()
        self._subscribed: set[tuple[str, str]] = set()
        self._publishers: dict[str, _Publisher] = {}
        self._receiver: Receiver | None = None

    def start(self, receiver: Receiver) -> None:
        """Listen for publishers; topics are subscribed to by ``poll``.

        Raises:
            DatasetError: the session is closed.
        """
        self._receiver = receiver
        tokens = self._session.liveliness().declare_subscriber(tokens_key(self._domain), self._see, history=True)
        self._declared.append(tokens)

    def poll(self) -> None:
        """Subscribe to the topics whose publishers have been seen since."""
        receiver = self._receiver
        while self._found and receiver is not None:
            topic, is_transient_local = self._found.popleft()
            key = (topic.name, topic.msgtype)
            if key in self._subscribed or not receiver.wants(*key):
                continue
            self._subscribed.add(key)
            if topic.msgtype in self._types and not topic.fits(self._types.hash_of(topic.msgtype)):
                receiver.refuse(topic.name, f"its type {topic.msgtype} has another definition ({topic.type_hash})")
                continue
            self._subscribe(topic, is_transient_local=is_transient_local)

    def typed(self, topic: str, msgtype: str) -> "tuple[str, Typestore]":
        """The type with the definitions of the distribution."""
        return self._types.typed(msgtype)

    def publish(self, topic: str, msgtype: str, stamp_ns: int, data: bytes) -> None:
        """Send a message with its number and the time of now."""
        self.announce(topic, msgtype)
        self._publishers[topic].put(data)

    def announce(self, topic: str, msgtype: str, *, is_transient_local: bool = False) -> None:
        """Declare the publisher of a topic and its token, where there is none yet."""
        if topic not in self._publishers:
            named = ZenohTopic(topic, msgtype, self._types.hash_of(msgtype))
            token = self._tokens.entity("MP", named, is_transient_local=is_transient_local)
            made = self._declare(named.key(self._domain), is_transient_local)
            self._publishers[topic] = _Publisher(made, sender_of(token))
            self._declared.append(self._session.liveliness().declare_token(token))

    def has_listeners(self, topic: str) -> bool:
        """Whether somebody subscribes to a topic that is published."""
        known = self._publishers.get(topic)
        return known is not None and known.has_listeners()

    def flush(self, timeout_s: float) -> None:
        """Nothing: zenoh does not say what has been taken."""

    def close(self) -> None:
        """Close the session; its tokens vanish."""
        with suppress(Exception):
            self._session.close()

    def _declare(self, key: str, is_transient_local: bool) -> Any:
        if not is_transient_local:
            return self._session.declare_publisher(key)
        return zenoh_ext.declare_advanced_publisher(
            self._session, key, cache=zenoh_ext.CacheConfig(_HISTORY), publisher_detection=True
        )

    def _subscribe(self, topic: ZenohTopic, *, is_transient_local: bool) -> None:
        key = ZenohTopic(topic.name, topic.msgtype, "*").key(self._domain)
        if is_transient_local:
            history = zenoh_ext.HistoryConfig(detect_late_publishers=True)
            subscriber: Any = zenoh_ext.declare_advanced_subscriber(self._session, key, self._receive, history=history)
        else:
            subscriber = self._session.declare_subscriber(key, self._receive)
        token = self._tokens.entity("MS", topic, is_transient_local=is_transient_local)
        self._declared += [subscriber, self._session.liveliness().declare_token(token)]

    def _see(self, sample: Any) -> None:
        """A token appeared or vanished."""
        if sample.kind == zenoh.SampleKind.PUT:
            found = advertised_by(str(sample.key_expr))
            if found is not None:
                self._found.append(found)

    def _receive(self, sample: Any) -> None:
        """A message came, in a thread of zenoh's."""
        arrived_ns, monotonic_ns = time.time_ns(), time.monotonic_ns()
        receiver, topic = self._receiver, topic_of_key(str(sample.key_expr))
        if receiver is None or topic is None:
            return
        if topic.msgtype in self._types and not topic.fits(self._types.hash_of(topic.msgtype)):
            receiver.refuse(topic.name, f"its type {topic.msgtype} has another definition ({topic.type_hash})")
            return
        attached = None if sample.attachment is None else attachment_of(sample.attachment.to_bytes())
        if attached is None:
            attached = Attachment(0, 0, b"")
        has_any = bool(attached.sender)
        receiver.take(
            WireMessage(
                topic.name,
                topic.msgtype,
                sample.payload.to_bytes(),
                arrived_ns,
                attached.sent_ns if has_any else None,
                attached.sequence if has_any else None,
                attached.sender,
                monotonic_ns,
            )
        )


class _Publisher:
    """Numbers the messages of one topic and sends them."""

    def __init__(self, publisher: Any, sender: bytes) -> None:
        self._publisher, self._sender = publisher, sender
        self.sent = 0

    def put(self, data: bytes) -> None:
        """Send a message."""
        self.sent += 1
        attachment = Attachment(self.sent, time.time_ns(), self._sender)
        self._publisher.put(data, attachment=attachment.packed())

    def has_listeners(self) -> bool:
        """Whether somebody subscribes."""
        status = getattr(self._publisher, "matching_status", None)
        return bool(status is not None and status.matching)


def _session_config(config: ZenohConfig) -> Any:
    """As rmw_zenoh's own: a peer, no multicast, gossip; time stamps, which transient-local topics need."""
    if config.config_file is not None:
        return zenoh.Config.from_file(config.config_file)
    made = zenoh.Config()
    for key, value in (
        ("mode", "peer"),
        ("scouting/multicast/enabled", False),
        ("scouting/gossip/enabled", True),
        ("timestamping/enabled", True),
        ("connect/endpoints", list(config.connect)),
        ("listen/endpoints", list(config.listen)),
    ):
        made.insert_json5(key, json.dumps(value))
    return made

# SPDX-License-Identifier: BSD-3-Clause
"""Messages that arrived so far on a wire, held until the topics of the sensors are chosen."""

import heapq
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterator
from operator import itemgetter

from rosbags.typesys.store import Typestore

from coclo_vio.datasets.rosbag.storage.message_set import BagTopic, MessageSet, RawMessage

Typed = Callable[[str, str], tuple[str, Typestore]]
"""Called with a topic and its type: the type with the definitions that decode it."""


class ArrivedMessages(MessageSet):
    """The messages of a wire in memory; later ones of known topics are decoded without being held."""

    def __init__(self, origin: str, typed: Typed, most: int = 2000, most_bytes: int = 64_000_000) -> None:
        """Begin without messages.

        Args:
            origin: name of the wire.
            typed: the definitions of a topic's type.
            most: messages of a topic that are held; later ones replace the oldest.
            most_bytes: of a topic that are held.
        """
        super().__init__(origin, is_ros1=False, allow_partial=True)
        self._typed, self._most, self._most_bytes = typed, most, most_bytes
        self._held: dict[str, deque[tuple[int, RawMessage]]] = {}
        self._bytes: Counter[str] = Counter()
        self._number = 0

    def add(self, message: RawMessage, msgtype: str) -> None:
        """Hold a message; the first one of a topic sets its type."""
        topic = message.topic
        known = self.topics.get(topic)
        count = 0 if known is None else known.count
        self.topics[topic] = BagTopic(topic, msgtype if known is None else known.msgtype, count + 1)
        held = self._held.setdefault(topic, deque())
        self._number += 1
        held.append((self._number, message))
        self._bytes[topic] += len(message.data)
        while len(held) > self._most or (self._bytes[topic] > self._most_bytes and len(held) > 1):
            self._bytes[topic] -= len(held.popleft()[1].data)

    def messages(self, names: Collection[str]) -> Iterator[RawMessage]:
        """The held messages of the topics ``names`` in the order of arrival."""
        numbered = heapq.merge(*(self._held[name] for name in names if name in self._held), key=itemgetter(0))
        return (message for _, message in numbered)

    def released(self) -> list[RawMessage]:
        """All messages that are held, in the order of arrival; they are held no longer."""
        held = list(self.messages(list(self._held)))
        self._held.clear()
        self._bytes.clear()
        return held

    def typed(self, topic: str) -> tuple[str, Typestore]:
        """The type of a topic and its message definitions."""
        return self._typed(topic, self.topics[topic].msgtype)

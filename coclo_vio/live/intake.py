# SPDX-License-Identifier: BSD-3-Clause
"""The bounded queue between the threads of a wire and the estimator; images make room before anything else."""

import time
from collections import deque
from collections.abc import Iterable, Mapping
from threading import Condition

from coclo_vio.datasets.rosbag.message_types import IMAGES
from coclo_vio.live.topic_counts import TopicCounts, TopicRecord
from coclo_vio.live.wire import Receiver, Wants, WireMessage
from coclo_vio.live.wire_events import WireEvents
from coclo_vio.values.measurements import Measurement

_Item = WireMessage | Measurement


class Intake:
    """Takes what comes in any thread, counts it, and gives it to one.

    Invariant: at most ``most_images`` images and ``most_messages`` others are held. An image beyond that replaces the
    oldest one; another message beyond it is dropped.
    """

    def __init__(self, wants: Wants, events: WireEvents, *, most_messages: int, most_images: int) -> None:
        """Begin empty.

        Args:
            wants: whether messages on a topic of a type are read.
            events: gets what is refused and dropped.
            most_messages: that wait.
            most_images: that wait.
        """
        self._events = events
        self._most_messages, self._most_images = most_messages, most_images
        self._states: deque[tuple[int, _Item]] = deque()
        self._images: deque[tuple[int, WireMessage]] = deque()
        self._counts: dict[str, TopicCounts] = {}
        self._changed = Condition()
        self._number = 0
        self._chosen: frozenset[str] | None = None
        self.last_arrival_s = time.monotonic()
        self.receiver = Receiver(wants, self.take, self.refuse, self._lose)

    def take(self, item: _Item) -> None:
        """Hold an item until it is asked for."""
        with self._changed:
            if self._chosen is not None and isinstance(item, WireMessage) and item.topic not in self._chosen:
                return
            self.last_arrival_s = time.monotonic()
            self._number += 1
            if not isinstance(item, WireMessage):
                self._states.append((self._number, item))
            else:
                self._counts_of(item.topic, item.msgtype).add(item)
                self._hold(item)
            self._changed.notify()

    def refuse(self, topic: str, reason: str) -> None:
        """Count a message that cannot be read, and report it."""
        with self._changed:
            self._counts_of(topic, "").refused[reason] += 1
        self._events.report(topic, reason)

    def leave_out(self, items: Iterable[_Item]) -> None:
        """Count messages that were taken and are not used: too many came before the topics were chosen."""
        reason = "dropped, more came before the topics were chosen than are kept (live.most_messages)"
        for item in items:
            if isinstance(item, WireMessage):
                with self._changed:
                    self._counts_of(item.topic, item.msgtype).dropped += 1
                self._events.report(item.topic, reason, kind="wire_overload")

    def choose(self, topics: frozenset[str]) -> None:
        """From now on take only what comes on these topics; forget what was counted on others."""
        with self._changed:
            self._chosen = topics
            self._counts = {
                topic: counts for topic, counts in self._counts.items() if topic in topics or counts.refused
            }

    def next(self, timeout_s: float) -> _Item | None:
        """The item that came first of those held; None where none came in time."""
        with self._changed:
            if not self._states and not self._images:
                self._changed.wait(timeout_s)
            if not self._states and not self._images:
                return None
            images_first = not self._states or (bool(self._images) and self._images[0][0] < self._states[0][0])
            return self._images.popleft()[1] if images_first else self._states.popleft()[1]

    def records(self) -> Mapping[str, TopicRecord]:
        """What came so far, by topic."""
        with self._changed:
            return {topic: counts.record() for topic, counts in sorted(self._counts.items())}

    def _hold(self, message: WireMessage) -> None:
        if message.msgtype in IMAGES:
            self._images.append((self._number, message))
            if len(self._images) > self._most_images:
                self._drop(self._images.popleft()[1])
        elif len(self._states) < self._most_messages:
            self._states.append((self._number, message))
        else:
            self._drop(message)

    def _drop(self, message: WireMessage) -> None:
        self._counts[message.topic].dropped += 1
        self._events.report(message.topic, "dropped, the estimator does not keep up", kind="wire_overload")

    def _lose(self, topic: str, count: int) -> None:
        with self._changed:
            self._counts_of(topic, "").lost_by_wire += count

    def _counts_of(self, topic: str, msgtype: str) -> TopicCounts:
        counts = self._counts.setdefault(topic, TopicCounts(msgtype))
        counts.msgtype = counts.msgtype or msgtype
        return counts

# SPDX-License-Identifier: BSD-3-Clause
"""The stamp of a message and the order of messages: which clock is used, how a stamp that goes back is handled.

Within a topic stamps must not go back. Between topics they may, because a bag holds messages in the order of arrival
and transport times differ.
"""

import heapq
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.datasets.rosbag.storage.message_set import MessageSet, RawMessage
from coclo_vio.values.errors import TimestampError
from coclo_vio.values.units import NS_PER_S

_APART_NS = 5 * NS_PER_S
_MAX_HELD = 20_000  # in a bag whose time does not advance
Item = TypeVar("Item")


class BagClock:
    """Stamps messages and checks the order within each topic.

    A stamp that is older than the one before it on its topic is an error, or the message is left out and counted.
    """

    def __init__(
        self, bag: MessageSet, *, uses_header: bool, drops_backward: bool, keeps_backward: bool, tally: ReadTally
    ) -> None:
        """Set the clock and the handling of stamps that go back.

        Args:
            bag: the bag of the messages.
            uses_header: use the header's stamp; otherwise the time at which the bag received the message.
            drops_backward: leave out a message whose stamp goes back, and count it.
            keeps_backward: pass it on, to be sorted later.
            tally: counts what is left out.
        """
        self._bag = bag
        self._uses_header = uses_header
        self._drops = drops_backward
        self._keeps = keeps_backward
        self._tally = tally
        self._last_ns: dict[str, int] = {}
        self._count: dict[str, int] = {}
        self._first_lag_ns: dict[str, int] = {}

    def stamp_ns(self, message: RawMessage) -> int | None:
        """The message's time, or None where it is to be left out.

        Raises:
            TimestampError: the header has no stamp, or it goes back within the topic.
        """
        topic = message.topic
        self._count[topic] = self._count.get(topic, 0) + 1
        is_of_header = self._uses_header and not self._bag.is_stamped_on_arrival(message)
        stamp_ns = self._bag.header_stamp_ns(topic, message.data) if is_of_header else message.received_ns
        if stamp_ns == 0 and message.received_ns != 0:  # a simulated recording may begin at 0
            self._leave_out(topic, "header has no stamp", "its header has no stamp")
            return None
        self._compare_clocks(topic, stamp_ns - message.received_ns)
        last_ns = self._last_ns.get(topic, stamp_ns)
        if stamp_ns < last_ns and not self._keeps:
            back_s = (last_ns - stamp_ns) / NS_PER_S
            self._leave_out(topic, "stamp goes back", f"its stamp {stamp_ns} ns goes back by {back_s:.6g} s")
            return None
        self._last_ns[topic] = max(stamp_ns, last_ns)
        return stamp_ns

    def match_ns(self, message: RawMessage) -> int:
        """The time by which parts of one reading are matched, ns: the header's, whichever clock stamps the messages.

        Messages of one time arrive one after the other. Without a stamp in the header it is the time of arrival.
        """
        return self._bag.header_stamp_ns(message.topic, message.data) or message.received_ns

    def _leave_out(self, topic: str, reason: str, sentence: str) -> None:
        if not self._drops:
            raise TimestampError(
                f"{self._bag.origin}, message {self._count[topic]} on {topic}: {sentence}; --allow-partial "
                "(dataset.allow_partial) leaves such messages out, dataset.rosbag.clock=received uses arrival times"
            )
        self._tally.dropped[f"{topic}: {reason}"] += 1

    def _compare_clocks(self, topic: str, lag_ns: int) -> None:
        """Note topics whose clocks are seconds apart: their measurements cannot be combined."""
        if topic in self._first_lag_ns:
            return
        for earlier, earlier_lag_ns in self._first_lag_ns.items():
            if abs(lag_ns - earlier_lag_ns) > _APART_NS:
                apart_s = (lag_ns - earlier_lag_ns) / NS_PER_S
                self._tally.note(
                    f"the clocks of {topic} and {earlier} are {apart_s:.6g} s apart; dataset.rosbag.clock=received "
                    "uses the time at which the bag received the messages"
                )
                break
        self._first_lag_ns[topic] = lag_ns


@dataclass(slots=True, order=True)
class _Held(Generic[Item]):
    key: tuple[int, int]
    number: int
    received_ns: int = field(compare=False)
    item: Item = field(compare=False)
    is_released: bool = field(compare=False, default=False)


class ReorderWindow(Generic[Item]):
    """Holds the items that arrived during the last ``window_ns`` of the bag's time and releases them in order of keys.

    An item stamped more than two windows ahead is on another clock: it is released out of order when its time in the
    window is over, so that it neither delays the others nor is held for ever.

    Attributes:
        late: number of items released after one with a later key.
    """

    def __init__(self, window_ns: int) -> None:
        self.late = 0
        self._window_ns = window_ns
        self._heap: list[_Held[Item]] = []
        self._arrivals: deque[_Held[Item]] = deque()
        self._now_ns = -(2**63)
        self._newest_released: tuple[int, int] | None = None
        self._pushed = 0

    def push(self, received_ns: int, key: tuple[int, int], item: Item) -> Iterator[Item]:
        """Add an item that arrived at ``received_ns``; yields the items that are due, ordered by (stamp_ns, rank)."""
        held = _Held(key, self._pushed, received_ns, item)
        self._pushed += 1
        heapq.heappush(self._heap, held)
        self._arrivals.append(held)
        yield from self.advance(received_ns)

    def advance(self, now_ns: int) -> Iterator[Item]:
        """Let time pass; yields the items that are due."""
        self._now_ns = max(self._now_ns, now_ns)
        while self._arrivals and self._is_over(self._arrivals[0]):
            yield from self._release(self._arrivals.popleft())

    def finish(self) -> Iterator[Item]:
        """All items still held, in order."""
        while self._heap:
            yield from self._emit(heapq.heappop(self._heap))
        self._arrivals.clear()

    def _is_over(self, held: _Held[Item]) -> bool:
        return self._now_ns - held.received_ns > self._window_ns or len(self._arrivals) > _MAX_HELD

    def _release(self, due: _Held[Item]) -> Iterator[Item]:
        """Release an item whose time in the window is over, and before it all with earlier keys."""
        while self._heap and self._heap[0].is_released:
            heapq.heappop(self._heap)
        if due.is_released:
            return
        if due.key[0] - self._heap[0].key[0] > 2 * self._window_ns:
            due.is_released = True
            self.late += 1
            yield due.item
            return
        while not due.is_released:
            yield from self._emit(heapq.heappop(self._heap))

    def _emit(self, held: _Held[Item]) -> Iterator[Item]:
        if held.is_released:
            return
        held.is_released = True
        if self._newest_released is not None and held.key < self._newest_released:
            self.late += 1
        else:
            self._newest_released = held.key
        yield held.item

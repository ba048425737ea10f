# SPDX-License-Identifier: BSD-3-Clause
"""Messages in the order of their stamps, though a bag holds them in the order in which they arrived.

Within a topic stamps must not go back; between topics they may, as far as one message travelled longer than another.
"""

import heapq
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Generic, TypeVar

Item = TypeVar("Item")
_MOST_HELD = 20_000  # in a bag whose time stands still


@dataclass(slots=True, order=True)
class _Held(Generic[Item]):
    key: tuple[int, int]
    number: int
    received_ns: int = field(compare=False)
    item: Item = field(compare=False)
    is_out: bool = field(compare=False, default=False)


class ReorderWindow(Generic[Item]):
    """Holds what arrived during the last ``window_ns`` of the bag's own time and lets it go in the order of keys.

    What is stamped further ahead than two windows has another clock: it goes when its time in the window is over, out
    of order, rather than hold up the others or be held for ever.

    Attributes:
        late: how many came out after something with a later key.
    """

    def __init__(self, window_ns: int) -> None:
        self.late = 0
        self._window_ns = window_ns
        self._heap: list[_Held[Item]] = []
        self._arrivals: deque[_Held[Item]] = deque()
        self._now_ns = -(2**63)
        self._newest_out: tuple[int, int] | None = None
        self._pushed = 0

    def push(self, received_ns: int, key: tuple[int, int], item: Item) -> Iterator[Item]:
        """Take an item that arrived at ``received_ns``; those whose time has come, ordered by (stamp_ns, rank)."""
        self._now_ns = max(self._now_ns, received_ns)
        held = _Held(key, self._pushed, received_ns, item)
        self._pushed += 1
        heapq.heappush(self._heap, held)
        self._arrivals.append(held)
        while self._arrivals and self._is_over(self._arrivals[0]):
            yield from self._release(self._arrivals.popleft())

    def finish(self) -> Iterator[Item]:
        """All that is still held, in order."""
        while self._heap:
            yield from self._out(heapq.heappop(self._heap))
        self._arrivals.clear()

    def _is_over(self, held: _Held[Item]) -> bool:
        return self._now_ns - held.received_ns > self._window_ns or len(self._arrivals) > _MOST_HELD

    def _release(self, due: _Held[Item]) -> Iterator[Item]:
        """Let an item go whose time is over, and before it all that comes earlier."""
        while self._heap and self._heap[0].is_out:
            heapq.heappop(self._heap)
        if due.is_out:
            return
        if due.key[0] - self._heap[0].key[0] > 2 * self._window_ns:
            due.is_out = True
            self.late += 1
            yield due.item
            return
        while not due.is_out:
            yield from self._out(heapq.heappop(self._heap))

    def _out(self, held: _Held[Item]) -> Iterator[Item]:
        if held.is_out:
            return
        held.is_out = True
        if self._newest_out is not None and held.key < self._newest_out:
            self.late += 1
        else:
            self._newest_out = held.key
        yield held.item

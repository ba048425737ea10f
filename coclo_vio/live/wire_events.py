# SPDX-License-Identifier: BSD-3-Clause
"""Events of the wire: one for each topic and reason in a while, with the number of messages that it stands for."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from threading import Lock

from coclo_vio.values.errors import shortened
from coclo_vio.values.outputs import Event

_MOST_REASONS = 200  # of which events are counted apart


@dataclass(slots=True)
class _Reason:
    kind: str
    since: int = 0
    total: int = 0
    reported_s: float | None = None


class WireEvents:
    """Collects what goes wrong in any thread, and gives events to one."""

    def __init__(self, every_s: float, clock_s: Callable[[], float] = time.monotonic) -> None:
        """Begin without events.

        Args:
            every_s: of one topic and reason there is one event in this time.
            clock_s: the time, s.
        """
        self._every_s, self._clock_s = every_s, clock_s
        self._reasons: dict[tuple[str, str], _Reason] = {}
        self._lock = Lock()

    def report(self, topic: str, reason: str, kind: str = "wire_message_refused") -> None:
        """Something went wrong on a topic."""
        with self._lock:
            key = (shortened(topic), shortened(reason))
            if key not in self._reasons and len(self._reasons) >= _MOST_REASONS:
                key = ("further topics", "further reasons")
            entry = self._reasons.setdefault(key, _Reason(kind))
            entry.since += 1
            entry.total += 1

    def due(self, stamp_ns: int, *, is_last: bool = False) -> list[Event]:
        """The events that are due now, stamped as given.

        Args:
            stamp_ns: the time of the estimator, ns.
            is_last: whether all are due.
        """
        if not self._reasons:
            return []
        now_s = self._clock_s()
        found = []
        with self._lock:
            for (topic, reason), entry in self._reasons.items():
                waits = entry.reported_s is not None and now_s - entry.reported_s < self._every_s
                if entry.since == 0 or (waits and not is_last):
                    continue
                count = "a message" if entry.since == 1 else f"{entry.since} messages"
                found.append(Event(stamp_ns, entry.kind, f"{topic}: {count}: {reason} ({entry.total} in all)"))
                entry.since, entry.reported_s = 0, now_s
        return found

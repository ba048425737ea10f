# SPDX-License-Identifier: BSD-3-Clause
"""One reading of all joints, or of all feet, from messages that each hold a part, of one time or milliseconds apart.

Parts are joined while they are fresh: none may be older than a limit, which follows from how far apart the parts of the
first messages are, and is 20 ms at most. The reading has the stamp of its newest part. The angles of older ones are
left as they were measured: carried to that stamp by their velocities they made a walk of six legs, 1.5 ms apart each,
no better (drift of leg odometry 1.39 % instead of 1.36 %, together 1.23 %).
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.values.arrays import Array, BoolArray, IntArray

MOST_APART_NS = 20_000_000
_LEAST_MESSAGES = 3  # of a part
_MORE_OFTEN = 1.3
_MARGIN = 1.3  # of the limit over the span of the first messages, for jitter


def span_ns(parts: Sequence[tuple[str, int]]) -> int:
    """The time within which one message of every part comes, ns: the median over the given messages.

    Args:
        parts: name of the part and stamp of each message; of too few messages nothing follows.
    """
    counts = Counter(name for name, _ in parts)
    if min(counts.values(), default=0) < _LEAST_MESSAGES:
        return 0
    last: dict[str, int] = {}
    windows = []
    for name, stamp_ns in sorted(parts, key=lambda part: part[1]):
        last[name] = stamp_ns
        if len(last) == len(counts):
            windows.append(stamp_ns - min(last.values()))
    if not windows:
        return 0
    count = len(counts)
    shortest = [min(windows[i : i + count]) for i in range(0, max(1, len(windows) - count + 1), count)]
    return int(np.median(shortest))


def tolerance_ns(span: int, pair_tolerance_ns: int) -> int:
    """How old a part may be beside the newest one, ns, for parts that come within ``span`` ns."""
    return max(pair_tolerance_ns, min(MOST_APART_NS, round(_MARGIN * span)))


class ReadingAssembler:
    """Assembles one reading from several messages.

    A reading is complete when every expected entry has arrived; it is closed incomplete when a part of it has become
    too old, or when a part comes again. A part that comes more often than others replaces what it brought before, and
    is no reading without them. The stamp is that of the latest part.
    """

    def __init__(self, is_expected: BoolArray, tolerance: int) -> None:
        """Expect entries.

        Args:
            is_expected: which there are, (n,).
            tolerance: parts are not farther apart, ns.
        """
        self._is_expected = is_expected
        self._tolerance_ns = tolerance
        self._held: _Part | None = None
        self._counts: IntArray = np.zeros(len(is_expected), dtype=np.int64)
        self.readings = 0
        self.complete = 0

    def push(self, stamp_ns: int, match_ns: int, values: Array, is_present: BoolArray) -> Iterator[tuple[int, Array]]:
        """Add a part.

        Args:
            stamp_ns: its time.
            match_ns: the time by which it is matched with other parts (see ``BagClock.match_ns``).
            values: (n,), or angles, velocities and torques (3, n); NaN where the part has no value.
            is_present: which entries the part holds, (n,).

        Yields:
            Stamp and values of a reading that is complete, or that cannot be completed any more.
        """
        self._counts += is_present
        part = _Part(stamp_ns, np.full(len(is_present), match_ns), values, is_present)
        held, self._held = self._held, None
        if held is not None:
            is_repeated = bool((held.is_present & is_present).any()) and not self._is_frequent(is_present)
            if is_repeated or held.age_ns(match_ns, but=is_present) > self._tolerance_ns:
                if not self._is_frequent(held.is_present):
                    yield self._closed(held)
            else:
                part = held.joined_by(part)
        if self._is_complete(part):
            yield self._closed(part)
        else:
            self._held = part

    def finish(self) -> Iterator[tuple[int, Array]]:
        """The reading that is still incomplete at the end."""
        if self._held is not None:
            yield self._closed(self._held)
            self._held = None

    def describe(self, what: str, span: int, tally: ReadTally) -> None:
        """Note what share of the readings is complete, where parts come apart or are missing.

        Args:
            what: such as ``joints``.
            span: how far apart the parts of the first messages are, ns.
            tally: gets the note.
        """
        if self.readings == 0 or (self.complete == self.readings and span <= self._tolerance_ns / _MARGIN / 2):
            return
        share = 100.0 * self.complete / self.readings
        limit_ms, span_ms = self._tolerance_ns / 1e6, span / 1e6
        tally.note(
            f"{what}: {share:.1f} % of {self.readings} samples are complete; their parts come {span_ms:.3g} ms apart "
            f"and are joined within {limit_ms:.3g} ms (dataset.rosbag.parts_tolerance_s)"
        )

    def _is_frequent(self, is_present: BoolArray) -> bool:
        """Whether the entries come more often than the rarest."""
        rarest = int(self._counts[self._is_expected].min()) if self._is_expected.any() else 0
        return rarest >= _LEAST_MESSAGES and bool((self._counts[is_present] > _MORE_OFTEN * rarest).all())

    def _is_complete(self, part: "_Part") -> bool:
        return bool((part.is_present | ~self._is_expected).all())

    def _closed(self, part: "_Part") -> tuple[int, Array]:
        self.readings += 1
        self.complete += self._is_complete(part)
        return part.stamp_ns, part.values


class _Part(NamedTuple):
    """Some entries of a reading, and the time by which each is matched with others, (n,)."""

    stamp_ns: int
    match_ns: IntArray
    values: Array
    is_present: BoolArray

    def age_ns(self, at_ns: int, but: BoolArray) -> int:
        """How far the entries are from a time, at most, without those that are to be replaced."""
        matched = self.match_ns[self.is_present & ~but]
        return int(np.abs(at_ns - matched).max(initial=0))

    def joined_by(self, other: "_Part") -> "_Part":
        stamp_ns = max(self.stamp_ns, other.stamp_ns)
        values = np.where(other.is_present, other.values, self.values)
        match_ns = np.where(other.is_present, other.match_ns, self.match_ns)
        return _Part(stamp_ns, match_ns, values, self.is_present | other.is_present)

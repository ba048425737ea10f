# SPDX-License-Identifier: BSD-3-Clause
"""Puts frames on the clock of the IMU, and in order with its readings, where the cameras have another clock."""

import heapq
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import count

from coclo_vio.values.measurements import Measurement, StereoFrame, StereoTracks
from coclo_vio.values.units import NS_PER_S

_MOST_FRAMES_HELD = 64
_MOST_READINGS_HELD = 4096


class ImageClock:
    """Gives measurements in the order of the IMU's clock, with frames stamped by it.

    Where frames are stamped early (a positive offset) they wait until the other measurements have come as far; where
    they are stamped late the others wait for them. Nothing waits where the clocks agree.
    """

    def __init__(self, offset_s: float, *, waits: bool, holds_others: bool = True) -> None:
        """Take the offset of the clocks.

        Args:
            offset_s: stamp of a frame plus this is the IMU's clock, s.
            waits: whether there is anything that frames have to be in order with.
            holds_others: whether other measurements wait for frames that are stamped late; otherwise these come with
                stamps of the past.
        """
        self._offset_ns = round(offset_s * NS_PER_S)
        self._has_others, self._holds_others = waits, holds_others
        self._held: list[tuple[int, bool, int, Measurement]] = []
        self._numbers = count()
        self._now_ns: int | None = None
        self.counts: Counter[str] = Counter()

    @property
    def _waits(self) -> bool:
        return self._has_others and (self._offset_ns > 0 or (self._offset_ns < 0 and self._holds_others))

    @property
    def _most_held(self) -> int:
        return _MOST_FRAMES_HELD if self._offset_ns > 0 else _MOST_READINGS_HELD

    def shift(self, by_s: float) -> None:
        """The offset is more by this, s, for frames that come from now on; whatever waits keeps its stamp."""
        self._offset_ns += round(by_s * NS_PER_S)

    def push(self, measurement: Measurement) -> Iterator[Measurement]:
        """Take one; those that are due, on one clock and in order."""
        raw_ns, is_frame = measurement.stamp_ns, isinstance(measurement, StereoFrame | StereoTracks)
        if is_frame and self._offset_ns:
            measurement = replace(measurement, stamp_ns=raw_ns + self._offset_ns)
        if not self._waits and not self._held:
            yield measurement
            return
        heapq.heappush(self._held, (measurement.stamp_ns, is_frame, next(self._numbers), measurement))
        self._now_ns = raw_ns if self._now_ns is None else max(self._now_ns, raw_ns)
        due_ns = self._now_ns + min(0, self._offset_ns)
        while self._held and (self._held[0][0] <= due_ns or len(self._held) > self._most_held):
            self.counts["not_waited_for_clock"] += self._held[0][0] > due_ns
            yield heapq.heappop(self._held)[-1]

    def finish(self) -> Iterator[Measurement]:
        """All that still waits, in order: no measurement comes any more."""
        while self._held:
            yield heapq.heappop(self._held)[-1]

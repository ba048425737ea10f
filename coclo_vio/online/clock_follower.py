# SPDX-License-Identifier: BSD-3-Clause
"""Brings the stamps of all streams to one clock that never steps: refuses outliers, follows clocks that stepped.

The clock of the estimator begins as that of the samples. A stamp that is too far ahead of the newest one or too far
behind, or not newer than what its stream has given already, is in doubt, and so is an image that is suddenly further
ahead of other streams than those before it. A sample in doubt waits: where the next of its
stream is as expected, it was an outlier and is refused; where several in a row agree, the clock has stepped. If other
streams have gone on meanwhile it is the clock of that stream, otherwise the clock of all.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from coclo_vio.datasets.read_report import STREAM_NAMES
from coclo_vio.online.config import OnlineConfig
from coclo_vio.online.stream_state import Arrival, StreamState
from coclo_vio.values.measurements import Measurement
from coclo_vio.values.units import NS_PER_S

_LARGEST_NS = 2**63 - 1
_SMALL_STEP_NS = 200_000_000  # a clock that went back by little is recognised by samples over this time
_AGREE_NS = NS_PER_S // 2  # samples in doubt follow one another within this
_MOST_DOUBTS = 5  # times the samples in a row that make a step: then it is decided without the other streams
_ACTIVE_NS = NS_PER_S  # a stream that gave nothing for longer does not count
_SAME_LAG_NS = 50_000_000  # images whose clock has stepped are ahead of the other streams by the same, to this
_BEHIND = ("late", "repeated")


@dataclass(frozen=True, slots=True, eq=False)
class Accepted:
    """A sample for the estimator.

    Attributes:
        arrival: the sample as it came.
        stamp_ns: by the clock of the estimator.
    """

    arrival: Arrival
    stamp_ns: int


@dataclass(frozen=True, slots=True)
class Refused:
    """A sample that the estimator does not get.

    Attributes:
        stream: its name.
        reason: ``not_integer``, ``negative``, ``overflow``, ``unknown_kind``, ``repeated``, ``future``, ``past``,
            ``late``, ``ahead``.
        stamp: as it came.
        limit: what it should be.
    """

    stream: str
    reason: str
    stamp: object
    limit: str


@dataclass(frozen=True, slots=True)
class ClockStep:
    """A clock has stepped; what was accepted before is of the clock before.

    Attributes:
        streams: whose clock it is.
        is_of_all: whether it is the clock of all streams that are there.
        step_ns: new clock less old clock.
        from_ns: first stamp of the new clock, by that clock.
        at_ns: the same by the clock of the estimator.
        samples: from how many it was recognised.
        gap_sigma_s: one sigma of the time that passed between the two clocks beyond what is assumed, s.
    """

    streams: tuple[str, ...]
    is_of_all: bool
    step_ns: int
    from_ns: int
    at_ns: int
    samples: int
    gap_sigma_s: float


Decision = Accepted | Refused | ClockStep


class ClockFollower:
    """Decides on each sample, in the order of arrival.

    Attributes:
        streams: by kind of sample, those that have come.
        now_ns: the newest stamp accepted, by the clock of the estimator; None before the first.
    """

    def __init__(self, config: OnlineConfig) -> None:
        self.streams: dict[type, StreamState] = {}
        self.now_ns: int | None = None
        self._now_arrival_ns: int | None = None
        self._config = config
        self._future_ns, self._past_ns = round(config.future_s * NS_PER_S), round(config.past_s * NS_PER_S)
        self._number = 0

    def take(self, measurement: Measurement, arrival_ns: int | None = None) -> Iterator[Decision]:
        """Decide on a sample, and on those in doubt which it decides on.

        Args:
            measurement: the sample.
            arrival_ns: when it came, by a clock that never steps; None where that is unknown.
        """
        kind, raw = type(measurement), getattr(measurement, "stamp_ns", None)
        if kind not in STREAM_NAMES:
            yield Refused(kind.__name__, "unknown_kind", raw, "one of the measurements that the package declares")
            return
        stream = self.streams.get(kind)
        if stream is None:
            stream = self.streams[kind] = StreamState(kind)
        stream.arrived += 1
        invalid = _invalid(raw)
        if invalid is not None:
            stream.refused[invalid[0]] += 1
            yield Refused(stream.name, invalid[0], raw, invalid[1])
            return
        raw_ns = int(raw)  # type: ignore[arg-type]  # checked above
        self._number += 1
        now_ns = self._expected_now(arrival_ns, raw_ns)
        arrival = Arrival(measurement, stream, raw_ns, self._number, now_ns, arrival_ns)
        stream.last_number = self._number
        reason = self._doubt(stream, raw_ns + stream.shift_ns, now_ns)
        stream.is_last_normal = reason is None
        if reason is None:
            if stream.doubts:
                yield from self._settle_images(stream, raw_ns)
                yield from self._refuse(stream, len(stream.doubts))
            yield self._accept(arrival)
        else:
            yield from self._take_doubtful(arrival, reason)

    def finish(self) -> Iterator[Decision]:
        """Decide on what is still in doubt: nothing comes any more."""
        for stream in self.streams.values():
            yield from self._settle_images(stream, _LARGEST_NS)
            yield from self._refuse(stream, len(stream.doubts))

    def _expected_now(self, arrival_ns: int | None, raw_ns: int) -> int:
        """The newest stamp that can be expected, by the clock of the estimator."""
        if self.now_ns is None:
            return raw_ns
        if arrival_ns is None or self._now_arrival_ns is None:
            return self.now_ns
        return self.now_ns + max(0, arrival_ns - self._now_arrival_ns)

    def _doubt(self, stream: StreamState, stamp_ns: int, now_ns: int) -> str | None:
        """Why a stamp is in doubt, by the clock of the estimator; None if it is as expected."""
        if stream.is_apart:
            now_ns = stamp_ns if stream.newest_ns is None else stream.newest_ns
        if stamp_ns > now_ns + self._future_ns:
            return "future"
        if stamp_ns < now_ns - self._past_ns and not self._was_held_back(stream, stamp_ns):
            return "past"
        if stream.is_repeated(stamp_ns):
            return "repeated"
        if stream.used_ns is not None and stamp_ns <= stream.used_ns:
            return "late"
        if self._is_beside(stream) and not stream.is_apart and stream.is_suddenly_ahead(stamp_ns - now_ns):
            return "ahead"
        return None

    def _settle_images(self, stream: StreamState, before_ns: int) -> Iterator[Accepted]:
        """Images that were ahead of other streams only because these were held back are as they should be."""
        first = next(iter(stream.doubts), None)
        if first is None or self._doubt(stream, first.raw_ns + stream.shift_ns, first.now_ns) != "ahead":
            return
        doubts, stream.doubts = stream.doubts, []
        for arrival in doubts:
            if arrival.raw_ns < before_ns:
                yield self._accept(arrival)
            else:
                stream.doubts.append(arrival)

    def _was_held_back(self, stream: StreamState, stamp_ns: int) -> bool:
        """Whether a sample that came late goes on where its stream and all others ended: the network had stopped."""
        if self.now_ns is None or stream.newest_ns is None or stamp_ns < self.now_ns - self._past_ns:
            return False
        return 0 < stamp_ns - stream.newest_ns <= _longest_step_ns(stream)

    def _accept(self, arrival: Arrival) -> Accepted:
        stream, stamp_ns = arrival.stream, arrival.raw_ns + arrival.stream.shift_ns
        stream.accept(stamp_ns, arrival.arrival_ns)
        if not stream.is_apart:
            stream.lags_ns.append(stamp_ns - arrival.now_ns)
            if self.now_ns is None or (stamp_ns > self.now_ns and not self._is_beside(stream)):
                self.now_ns, self._now_arrival_ns = stamp_ns, arrival.arrival_ns
        return Accepted(arrival, stamp_ns)

    def _is_beside(self, stream: StreamState) -> bool:
        """Whether it is of images that come beside other streams, whose clock is the one that counts."""
        return stream.is_of_images and any(
            not other.is_of_images and not other.is_apart and other.newest_ns is not None
            for other in self.streams.values()
        )

    def _refuse(self, stream: StreamState, count: int) -> Iterator[Refused]:
        """Refuse the oldest samples in doubt."""
        refused, stream.doubts = stream.doubts[:count], stream.doubts[count:]
        for arrival in refused:
            reason = self._doubt(stream, arrival.raw_ns + stream.shift_ns, arrival.now_ns) or "late"
            stream.refused[reason] += 1
            yield Refused(stream.name, reason, arrival.raw_ns, self._limit(stream, reason, arrival.now_ns))

    def _limit(self, stream: StreamState, reason: str, now_ns: int) -> str:
        by_driver = now_ns - stream.shift_ns
        if reason == "future":
            return f"at most {by_driver + self._future_ns} ns (online.future_s = {self._config.future_s:g})"
        if reason == "past":
            return f"at least {by_driver - self._past_ns} ns (online.past_s = {self._config.past_s:g})"
        if reason == "repeated":
            return "a stamp that has not come before"
        if reason == "ahead":
            return f"about {by_driver + stream.lag_ns} ns, as far from other streams as those before it"
        used_ns = (stream.used_ns or 0) - stream.shift_ns
        return f"later than {used_ns} ns, the last one used (raise online.latency.{stream.name}_s)"

    def _take_doubtful(self, arrival: Arrival, reason: str) -> Iterator[Decision]:
        stream = arrival.stream
        doubts = stream.doubts
        if doubts and not self._agrees(doubts[-1], arrival, reason):
            yield from self._settle_images(stream, arrival.raw_ns)
            yield from self._refuse(stream, len(doubts))
        stream.doubts.append(arrival)
        if self._is_decided(stream, reason):
            yield from self._follow(stream)

    def _agrees(self, before: Arrival, arrival: Arrival, reason: str) -> bool:
        """Whether a sample in doubt may be of the same new clock as the one before it."""
        step_ns = arrival.raw_ns - before.raw_ns
        if reason == "ahead":
            return step_ns > 0 and abs(step_ns - arrival.now_ns + before.now_ns) < _SAME_LAG_NS
        if reason in _BEHIND:
            period_ns = arrival.stream.period_ns or _AGREE_NS
            return 0 < step_ns <= 3 * period_ns
        return abs(step_ns) <= _longest_step_ns(arrival.stream)

    def _is_decided(self, stream: StreamState, reason: str) -> bool:
        """Whether samples in doubt are enough for a step of the clock, and the other streams have been heard."""
        doubts, needed = stream.doubts, self._needed(stream)
        if len(doubts) < needed:
            return False
        if reason in _BEHIND and doubts[-1].raw_ns - doubts[0].raw_ns < _SMALL_STEP_NS:
            return False
        if len(doubts) >= _MOST_DOUBTS * needed:
            return True
        others, since = self._active_others(stream), doubts[0].number
        if stream.newest_ns is None and not all(other.is_last_normal for other in others):
            return False  # it may be the other one whose clock is wrong
        return all(other.last_number > since for other in others)

    def _needed(self, stream: StreamState) -> int:
        return self._config.step_images if stream.is_of_images else self._config.step_samples

    def _active_others(self, stream: StreamState) -> list[StreamState]:
        """Other streams by which it can be seen whether the clock of all has stepped."""
        now_ns = self.now_ns or 0
        return [
            other
            for other in self.streams.values()
            if other is not stream
            and not other.is_of_images
            and not other.is_apart
            and other.newest_ns is not None
            and other.newest_ns >= now_ns - _ACTIVE_NS
        ]

    def _follow(self, stream: StreamState) -> Iterator[Decision]:
        """The samples in doubt of a stream are right: follow its clock, or that of all, and take them."""
        first, samples = stream.doubts[0], len(stream.doubts)
        if stream.newest_ns is None:
            self._set_apart(stream, first)
            yield from self._take_again([stream], first)
            return
        others = self._active_others(stream)
        is_of_all = not any(other.is_last_normal and other.last_number > first.number for other in others)
        stepped = list(self.streams.values()) if is_of_all else [stream]
        at_ns = self._continued(first, stream.newest_ns, is_of_all=is_of_all)
        step_ns = first.raw_ns + stream.shift_ns - at_ns
        if is_of_all and first.arrival_ns is None and 0 < step_ns <= self._config.longest_pause_s * NS_PER_S:
            self.now_ns = first.raw_ns + stream.shift_ns  # nothing came for that time
        else:
            for each in stepped:
                each.shift_ns -= step_ns
            names = tuple(each.name for each in stepped)
            sigma_s = self._config.step_gap_s if first.arrival_ns is None else 0.0
            yield ClockStep(names, is_of_all, step_ns, first.raw_ns, at_ns, samples, sigma_s)
        yield from self._take_again(stepped, first)

    def _set_apart(self, stream: StreamState, first: Arrival) -> None:
        """A stream has had another clock from its first sample on: it is left as it is, and no order is kept with it.

        Where there were only images before, they are the ones that are apart.
        """
        before = [other for other in self.streams.values() if other.newest_ns is not None and not other.is_apart]
        if stream.is_of_images or not all(other.is_of_images for other in before):
            stream.is_apart = True
            return
        for other in before:
            other.is_apart = True
        self.now_ns, self._now_arrival_ns = first.raw_ns + stream.shift_ns, first.arrival_ns

    def _take_again(self, streams: list[StreamState], first: Arrival) -> Iterator[Decision]:
        """Take samples of these streams that were in doubt, by the clocks as they are followed now."""
        waiting = sorted((each for stream in streams for each in stream.doubts), key=_number)
        for stream in streams:
            stream.doubts, stream.is_last_normal = [], True
        for arrival in waiting:
            now_ns = first.now_ns if self.now_ns is None else max(first.now_ns, self.now_ns)
            moved = replace(arrival, now_ns=now_ns)
            if self._doubt(arrival.stream, arrival.raw_ns + arrival.stream.shift_ns, now_ns) is None:
                yield self._accept(moved)
            else:
                arrival.stream.doubts.append(moved)
                arrival.stream.is_last_normal = False

    def _continued(self, first: Arrival, newest_ns: int, *, is_of_all: bool) -> int:
        """The stamp of the first sample of a new clock by the clock of the estimator."""
        stream = first.stream
        if not is_of_all:
            return max(first.now_ns + stream.lag_ns, newest_ns + 1)
        elapsed_ns = 0
        if first.arrival_ns is not None and stream.newest_arrival_ns is not None:
            elapsed_ns = first.arrival_ns - stream.newest_arrival_ns
        return newest_ns + max(stream.period_ns or 1, elapsed_ns)


def _longest_step_ns(stream: StreamState) -> int:
    """How far apart two samples of a stream are at most that follow one another."""
    return max(_AGREE_NS, 3 * (stream.period_ns or 0))


def _number(arrival: Arrival) -> int:
    return arrival.number


def _invalid(raw: object) -> tuple[str, str] | None:
    """The reason why a stamp is none, and what it should be; None for one that can be."""
    if isinstance(raw, bool) or not isinstance(raw, int | np.integer):
        return "not_integer", "integer nanoseconds; of seconds it is round(seconds * 1e9)"
    if raw < 0:
        return "negative", "0 ns or later"
    if raw > _LARGEST_NS:
        return "overflow", f"at most {_LARGEST_NS} ns, the largest 64-bit integer"
    return None

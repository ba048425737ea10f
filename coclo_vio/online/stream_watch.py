# SPDX-License-Identifier: BSD-3-Clause
"""What is amiss with a stream though every stamp is right: it is silent while others go on, or its IMU is stuck.

The estimator goes on with what there is. Readings of an IMU that is stuck are no measurements: they are to be left out.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from coclo_vio.datasets.read_report import STREAM_NAMES
from coclo_vio.online.config import OnlineConfig
from coclo_vio.online.stream_state import StreamState
from coclo_vio.values.measurements import InertialReading, Measurement
from coclo_vio.values.outputs import Event
from coclo_vio.values.units import NS_PER_S

_PERIODS = 10  # a stream is not silent before so many of its periods
_EVERY_NS = NS_PER_S // 20
_FEWEST_EQUAL, _TIMES_USUAL = 6, 3  # equal readings in a row, and times the longest such row so far: the IMU is stuck


@dataclass(slots=True)
class _Repetition:
    """Equal readings of an IMU in a row."""

    content: str  # hexadecimal
    since_ns: int
    count: int = 1
    changes: int = 0  # readings that differed from the one before
    usual: int = 1  # longest row of equal readings before, as of an IMU that is published more often than it measures
    is_reported: bool = False


@dataclass(slots=True)
class _Heard:
    """When a stream was heard last, and for how long others have gone on since."""

    last_ns: int
    arrived: int = 0
    silent_ns: int = 0
    is_silent: bool = False


class StreamWatch:
    """Events where a stream falls silent or an IMU repeats one reading, and where that ends."""

    def __init__(self, config: OnlineConfig) -> None:
        """Take the limits."""
        self._silent_ns = round(config.silent_s * NS_PER_S)
        self._most_equal = config.constant_readings
        self._heard: dict[type, _Heard] = {}
        self._repetitions: dict[type, _Repetition] = {}
        self._looked_ns: int | None = None

    def take(self, measurement: Measurement, now_ns: int) -> Iterator[Event]:
        """Take a sample; ``now_ns`` is its stamp by the clock of the estimator."""
        if not self._most_equal or not isinstance(measurement, InertialReading):
            return
        content = (measurement.angular_velocity.tobytes() + measurement.specific_force.tobytes()).hex()
        kind = type(measurement)
        before = self._repetitions.get(kind)
        if before is None:
            self._repetitions[kind] = _Repetition(content, now_ns)
        elif before.content == content:
            before.count += 1
            limit = min(self._most_equal, max(_FEWEST_EQUAL, _TIMES_USUAL * before.usual))
            if not before.is_reported and before.count >= limit and before.changes >= self._most_equal:
                before.is_reported = True
                detail = (
                    f"{STREAM_NAMES[kind]} has given the same reading {before.count} times in a row, to the bit: the "
                    "sensor or its driver is stuck, and its readings are left out until they change"
                )
                yield Event(now_ns, "reading_constant", detail)
        else:
            if before.is_reported:
                duration_s = (now_ns - before.since_ns) / NS_PER_S
                detail = f"{STREAM_NAMES[kind]} gives new readings again, after {duration_s:.3g} s of one reading"
                yield Event(now_ns, "reading_changes", detail)
            usual = before.usual if before.is_reported else max(before.usual, before.count)
            self._repetitions[kind] = _Repetition(content, now_ns, changes=before.changes + 1, usual=usual)

    def is_stuck(self, measurement: Measurement) -> bool:
        """Whether a sample, which was taken last, is the repeated reading of an IMU that is stuck."""
        repetition = self._repetitions.get(type(measurement))
        return repetition is not None and repetition.is_reported

    def look(self, streams: Iterable[StreamState], now_ns: int) -> Iterator[Event]:
        """See which streams are silent; where nothing comes at all, that time does not count.

        Args:
            streams: all of them.
            now_ns: newest stamp of all, by the clock of the estimator.
        """
        step_ns = 0 if self._looked_ns is None else now_ns - self._looked_ns
        if not self._silent_ns or (self._looked_ns is not None and 0 <= step_ns < _EVERY_NS):
            return
        self._looked_ns = now_ns
        for stream in streams:
            heard = self._heard.setdefault(stream.kind, _Heard(now_ns))
            if stream.arrived != heard.arrived:
                if heard.is_silent:
                    pause_s = (now_ns - heard.last_ns) / NS_PER_S
                    yield Event(now_ns, "stream_resumed", f"{stream.name} goes on after {pause_s:.2g} s of silence")
                self._heard[stream.kind] = _Heard(now_ns, stream.arrived)
                continue
            heard.silent_ns += min(step_ns, 2 * _EVERY_NS)
            if heard.is_silent or stream.period_ns is None:
                continue
            if heard.silent_ns > max(self._silent_ns, _PERIODS * stream.period_ns):
                heard.is_silent = True
                detail = (
                    f"no sample of {stream.name} has come for {heard.silent_ns / NS_PER_S:.2g} s, while others have "
                    f"(online.silent_s = {self._silent_ns / NS_PER_S:g}): the estimator goes on without"
                )
                yield Event(now_ns, "stream_silent", detail)

# SPDX-License-Identifier: BSD-3-Clause
"""Readings of an IMU that are no measurements: one that repeats to the bit, and rates at the limit of the gyroscope.

Both are found from the readings alone, as data sheets are not at hand. They are to be left out, as if the IMU were
silent; the estimator goes on with what there is.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from coclo_vio.datasets.read_report import STREAM_NAMES
from coclo_vio.online.config import OnlineConfig
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.measurements import InertialReading, Measurement
from coclo_vio.values.outputs import Event
from coclo_vio.values.units import NS_PER_S

CONSTANT, SATURATED = "constant", "saturated"
_FEWEST_EQUAL, _TIMES_USUAL = 6, 3  # equal readings in a row, and times the longest such row so far: the IMU is stuck
_FEWEST_AT_LIMIT, _TIMES_SHORTER = 3, 2  # readings of one axis at its limit in a row, and times the longest other row
_STEPS_AT_REST, _STEPS_TO_LIMIT = 3, 20  # smallest differences of readings: into such a row, and up to the limit
_FEWEST_ROWS = 3  # or so many rows at one rate that is not exceeded, however short
_READINGS_TO_KNOW = 100  # before rows of equal readings are known
_AT_LIMIT = 1.0 - 1e-4  # times the limit: counts of a converter reach one further on one side
_QUIET_NS = 2 * NS_PER_S  # without a reading at the limit an episode is over


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
class _Rows:
    """Rows of one axis at one rate, as at the limit of a gyroscope, while none of its axes exceeds that rate."""

    rate: float = 0.0
    count: int = 0
    longest: float = 1.0


@dataclass(slots=True)
class _Range:
    """What is known of the range of a gyroscope, the same for its three axes.

    Attributes:
        last: the last reading.
        rows: for how many readings each axis has been equal to the bit while anything of the reading changed, (3,).
        entries: by how much each axis changed when its row began, rad/s, (3,).
        usual: longest row that was exceeded.
        largest: the last rows that have not been exceeded.
        smallest_step: smallest difference of two readings of one axis, rad/s.
        readings: that differed from the one before.
        limit: rad/s; None while unknown.
        since_ns: first reading at the limit in this episode; None between episodes.
        at_limit_ns: the last such reading.
        count: of such readings in the episode.
    """

    last: InertialReading
    rows: Array = field(default_factory=lambda: np.ones(3))
    entries: Array = field(default_factory=lambda: np.zeros(3))
    usual: float = 1.0
    largest: _Rows = field(default_factory=_Rows)
    smallest_step: float = np.inf
    readings: int = 0
    limit: float | None = None
    since_ns: int | None = None
    at_limit_ns: int = 0
    count: int = 0

    def take(self, reading: InertialReading, now_ns: int) -> bool:
        """Take a reading; whether it is at the limit."""
        rate, before, self.last = np.abs(reading.angular_velocity), self.last, reading
        steps = np.abs(reading.angular_velocity - before.angular_velocity)
        if steps.any() or (reading.specific_force != before.specific_force).any():  # else the same, published again
            self.readings += 1
            self._end_rows(np.abs(before.angular_velocity), steps != 0.0)
            self._go_on(rate, steps)
        is_at_limit = self.limit is not None and float(rate.max()) >= self.limit * _AT_LIMIT
        if is_at_limit:
            self.since_ns = now_ns if self.since_ns is None else self.since_ns
            self.at_limit_ns, self.count = now_ns, self.count + 1
        return is_at_limit

    def _go_on(self, rate: Array, steps: Array) -> None:
        """Take the magnitudes of a reading; whether an axis has stayed where it is for too long."""
        is_equal = steps == 0.0
        self.rows = np.where(is_equal, self.rows + 1.0, 1.0)
        self.entries = np.where(is_equal, self.entries, steps)
        self.smallest_step = min(self.smallest_step, float(steps[~is_equal].min(initial=np.inf)))
        most = float(rate.max())
        if self.limit is not None and most > self.limit / _AT_LIMIT:
            self.limit = None
        if most > self.largest.rate / _AT_LIMIT:
            self.usual, self.largest = max(self.usual, self.largest.longest), _Rows()
        is_limit = self._is_row(rate) & (self.rows > _TIMES_SHORTER * self.usual)
        if self.readings >= _READINGS_TO_KNOW and is_limit.any():
            self.limit = float(rate[is_limit].max())

    def _is_row(self, rate: Array) -> BoolArray:
        """Which axes are in rows that may be at a limit, (3,)."""
        is_steep = self.entries > _STEPS_AT_REST * self.smallest_step
        return (self.rows >= _FEWEST_AT_LIMIT) & is_steep & (rate >= _STEPS_TO_LIMIT * self.smallest_step)

    def _end_rows(self, rate: Array, has_ended: BoolArray) -> None:
        """Take note of rows that end, at these magnitudes; several at one that is not exceeded are at the limit."""
        most = float(rate.max())
        for axis in np.flatnonzero(has_ended & (self.rows > 1.0)):
            if rate[axis] < most * _AT_LIMIT or not self._is_row(rate)[axis]:
                at_limit = self.limit is not None and rate[axis] >= self.limit * _AT_LIMIT
                self.usual = self.usual if at_limit else max(self.usual, float(self.rows[axis]))
                continue
            if rate[axis] < self.largest.rate * _AT_LIMIT:
                self.usual = max(self.usual, float(self.rows[axis]))
                continue
            self.largest = _Rows(most, self.largest.count + 1, max(self.largest.longest, float(self.rows[axis])))
            if self.largest.count >= _FEWEST_ROWS and self.readings >= _READINGS_TO_KNOW:
                self.limit = most


class ReadingWatch:
    """Events where an IMU repeats one reading or its gyroscope is at its limit, and where that ends."""

    def __init__(self, config: OnlineConfig) -> None:
        """Take the limits."""
        self._most_equal, self._finds_limit = config.constant_readings, config.leaves_out_saturated
        self._repetitions: dict[type, _Repetition] = {}
        self._ranges: dict[type, _Range] = {}
        self._amiss: str | None = None

    @property
    def amiss(self) -> str | None:
        """Why the sample that was taken last is no measurement, ``constant`` or ``saturated``; None where it is one."""
        return self._amiss

    def take(self, measurement: Measurement, now_ns: int) -> Iterator[Event]:
        """Take a sample; ``now_ns`` is its stamp by the clock of the estimator."""
        self._amiss = None
        if not isinstance(measurement, InertialReading):
            return
        if self._finds_limit:
            yield from self._compare_with_limit(measurement, now_ns)
        if self._most_equal:
            yield from self._compare_with_last(measurement, now_ns)

    def _compare_with_limit(self, measurement: InertialReading, now_ns: int) -> Iterator[Event]:
        kind = type(measurement)
        known = self._ranges.get(kind)
        if known is None:
            self._ranges[kind] = _Range(measurement)
            return
        if known.take(measurement, now_ns):
            self._amiss = SATURATED
            if known.count == 1:
                detail = (
                    f"an axis of the gyroscope of {STREAM_NAMES[kind]} stays at {known.limit:.4g} rad/s to the bit "
                    "while the others change: that is its limit, and readings at it are left out until one exceeds it"
                )
                yield Event(now_ns, "reading_saturated", detail)
        elif known.since_ns is not None and now_ns - known.at_limit_ns > _QUIET_NS:
            duration_s = (known.at_limit_ns - known.since_ns) / NS_PER_S
            detail = (
                f"the gyroscope of {STREAM_NAMES[kind]} is within its range again; {known.count} readings in "
                f"{duration_s:.3g} s were at its limit"
            )
            known.since_ns, known.count = None, 0
            yield Event(now_ns, "reading_in_range", detail)

    def _compare_with_last(self, measurement: InertialReading, now_ns: int) -> Iterator[Event]:
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
        if self._repetitions[kind].is_reported:
            self._amiss = CONSTANT

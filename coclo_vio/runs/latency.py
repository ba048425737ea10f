# SPDX-License-Identifier: BSD-3-Clause
"""Latencies in constant memory, and ``latency.json``: what a played recording came to in time."""

import math
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from coclo_vio.values.record import Record

_LEAST_NS, _MOST_NS = 1e3, 1e12  # 1 us to 1000 s
_STEP = math.log(1.01)
_BINS = int(math.log(_MOST_NS / _LEAST_NS) / _STEP) + 2
_NS_PER_MS = 1e6
_MOST_NEW = 256  # durations that are kept as they came: sorted in one by one they would take time from each push


class _Part(BaseModel):
    """A part of the record."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Spread(_Part):
    """How durations are spread, ms: their number, mean, percentiles, and the longest; None without any."""

    count: int
    mean_ms: float | None
    p50_ms: float | None
    p95_ms: float | None
    p99_ms: float | None
    max_ms: float | None


class DurationHistogram:
    """Durations of 1 us to 1000 s, kept to 1 %; the sum and the longest are exact."""

    def __init__(self) -> None:
        self._bins = np.zeros(_BINS, dtype=np.int64)
        self._count, self._sum_ns, self._most_ns = 0, 0, 0
        self._new: list[int] = []

    def add(self, duration_ns: int) -> None:
        """Take a duration; a negative one counts as none."""
        self._new.append(duration_ns)
        if len(self._new) >= _MOST_NEW:
            self._sort_in()

    @property
    def count(self) -> int:
        """How many there are."""
        return self._count + len(self._new)

    def _sort_in(self) -> None:
        durations_ns, self._new = np.maximum(np.array(self._new, dtype=np.int64), 0), []
        rows = np.log(np.maximum(durations_ns, _LEAST_NS) / _LEAST_NS) / _STEP
        rows = np.where(durations_ns <= _LEAST_NS, 0, rows.astype(np.int64) + 1)
        self._bins += np.bincount(np.minimum(rows, _BINS - 1), minlength=_BINS)
        self._count += len(durations_ns)
        self._sum_ns += int(durations_ns.sum())
        self._most_ns = max(self._most_ns, int(durations_ns.max()))

    def spread(self) -> Spread:
        """What they come to."""
        if self._new:
            self._sort_in()
        if not self._count:
            return Spread(count=0, mean_ms=None, p50_ms=None, p95_ms=None, p99_ms=None, max_ms=None)
        return Spread(
            count=self._count,
            mean_ms=self._sum_ns / self._count / _NS_PER_MS,
            p50_ms=self._percentile(0.5),
            p95_ms=self._percentile(0.95),
            p99_ms=self._percentile(0.99),
            max_ms=self._most_ns / _NS_PER_MS,
        )

    def _percentile(self, share: float) -> float:
        row = int(np.searchsorted(np.cumsum(self._bins), share * self._count))
        return min(_LEAST_NS * math.exp((row - 0.5) * _STEP) if row else 0.0, self._most_ns) / _NS_PER_MS


class LoadRecord(_Part):
    """A process over an interval: resident memory at its end, and processor time as a share of one core."""

    rss_mb: float
    cpu_percent: float


class IntervalRecord(_Part):
    """What happened in an interval of a played recording.

    Attributes:
        time_s: its end, s of wall time since the first measurement was due.
        length_s: its length, s.
        measurements: how many were pushed.
        push_ms: mean time of a push, over all streams.
        latency_p95_ms: of each trajectory that gave an estimate.
        waiting_most: largest number of measurements that waited for the estimator.
        images_left_out: because the estimator was behind, before they reached it.
        processes: ``estimator``, ``source`` and, where there is one, ``vision``.
    """

    time_s: float
    length_s: float
    measurements: int
    push_ms: float
    latency_p95_ms: dict[str, float]
    waiting_most: int
    images_left_out: int
    processes: dict[str, LoadRecord]


class LatencyRecord(Record):
    """``latency.json``: times of a recording that was played by its stamps.

    A latency is the wall time from when a measurement was due, by its stamp and the rate, to when its estimate came
    out (``trajectories``) or its push returned (``streams``). Latencies and pushes of the first ``settling_s`` after
    the first estimate, while code is loaded, are in the intervals alone.

    Attributes:
        mode: that was played to.
        vision: how its frames were processed, ``in_turn`` or ``beside``.
        rate: seconds of recording per second.
        settling_s: what is left out at the beginning.
        trajectories: latency of estimates, by the name of the trajectory.
        streams: latency of measurements, by stream.
        pushes: time that the push of a measurement took, by stream.
        pushes_cpu: processor time of the same in the estimator's thread, which other programs do not prolong.
        measurements: pushed, by stream.
        left_out: images left out before they reached the estimator; what it left out itself is in ``run.json``.
        joints_left_out: joint samples left out before they reached the estimator.
        waiting_most: largest number of measurements that waited.
        intervals: over time.
    """

    schema_version: Literal[1] = 1
    mode: str
    vision: str
    rate: float
    settling_s: float
    trajectories: dict[str, Spread]
    streams: dict[str, Spread]
    pushes: dict[str, Spread]
    pushes_cpu: dict[str, Spread]
    measurements: dict[str, int]
    left_out: int
    joints_left_out: int = 0
    waiting_most: int
    intervals: tuple[IntervalRecord, ...]

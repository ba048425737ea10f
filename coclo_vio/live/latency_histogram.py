# SPDX-License-Identifier: BSD-3-Clause
"""Latencies of a stream in constant memory: a histogram with bins of two percent."""

import math

import numpy as np
from pydantic import BaseModel, ConfigDict

from coclo_vio.values.arrays import IntArray
from coclo_vio.values.units import NS_PER_S

_RATIO = math.log(1.02)
_SHORTEST_NS = 1_000
_BINS = math.ceil(math.log(1000 * NS_PER_S / _SHORTEST_NS) / _RATIO)
_MS = 1e-6  # of ns


class LatencyRecord(BaseModel):
    """Latencies of a stream, ms; percentiles to two percent.

    Attributes:
        count: of messages.
        negative: of them those that came before they were sent: the two clocks are not in step.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    count: int
    p50_ms: float
    p95_ms: float
    p99_ms: float
    max_ms: float
    negative: int


class LatencyHistogram:
    """Counts latencies from a microsecond to a thousand seconds."""

    def __init__(self) -> None:
        self._bins: IntArray = np.zeros(_BINS + 1, dtype=np.int64)
        self._count = 0
        self._longest_ns = 0
        self._negative = 0

    def add(self, latency_ns: int) -> None:
        """Count one."""
        self._count += 1
        if latency_ns < 0:
            self._negative += 1
        self._longest_ns = max(self._longest_ns, latency_ns)
        index = 0 if latency_ns <= _SHORTEST_NS else int(math.log(latency_ns / _SHORTEST_NS) / _RATIO) + 1
        self._bins[min(index, _BINS)] += 1

    def record(self) -> LatencyRecord | None:
        """What it came to; None without a latency."""
        if self._count == 0:
            return None
        p50, p95, p99 = (self._percentile_ms(share) for share in (0.50, 0.95, 0.99))
        longest_ms = self._longest_ns * _MS
        return LatencyRecord(
            count=self._count, p50_ms=p50, p95_ms=p95, p99_ms=p99, max_ms=longest_ms, negative=self._negative
        )

    def _percentile_ms(self, share: float) -> float:
        index = int(np.searchsorted(np.cumsum(self._bins), share * self._count))
        upper_ns = _SHORTEST_NS * math.exp(index * _RATIO)
        return float(min(upper_ns, max(self._longest_ns, 0)) * _MS)

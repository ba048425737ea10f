# SPDX-License-Identifier: BSD-3-Clause
"""How long it takes from the arrival of a sample to the estimate of its time."""

import time
from collections import deque

from coclo_vio.live.latency_histogram import LatencyHistogram, LatencyRecord
from coclo_vio.values.outputs import Estimate

_MOST_STAMPS = 5000


class EstimateLatency:
    """Matches estimates with the arrivals of the samples of their stamps."""

    def __init__(self) -> None:
        self._arrivals: dict[int, int] = {}
        self._order: deque[int] = deque()
        self._found: dict[str, LatencyHistogram] = {}

    def arrived(self, stamp_ns: int, arrived_ns: int) -> None:
        """A sample of a stamp arrived; the last one of a stamp counts, since it completes the step."""
        if stamp_ns not in self._arrivals:
            self._order.append(stamp_ns)
            if len(self._order) > _MOST_STAMPS:
                self._arrivals.pop(self._order.popleft(), None)
        self._arrivals[stamp_ns] = arrived_ns

    def estimated(self, estimate: Estimate) -> None:
        """An estimate came out."""
        arrived_ns = self._arrivals.get(estimate.state.stamp_ns)
        if arrived_ns is not None:
            self._found.setdefault(estimate.name, LatencyHistogram()).add(time.time_ns() - arrived_ns)

    def records(self) -> dict[str, LatencyRecord]:
        """What it came to, by trajectory."""
        found = {name: histogram.record() for name, histogram in self._found.items()}
        return {name: record for name, record in found.items() if record is not None}

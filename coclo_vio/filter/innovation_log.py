# SPDX-License-Identifier: BSD-3-Clause
"""Innovations of the joint samples for whoever wants to see them, at a rate that costs little."""

from coclo_vio.filter.robust_models import Expectation
from coclo_vio.values.outputs import Innovation

_PERIOD_NS = 40_000_000


class InnovationLog:
    """Keeps the innovation of a sample every 40 ms until it is taken."""

    def __init__(self) -> None:
        self._kept: list[Innovation] = []
        self._kept_ns: int | None = None

    def add(self, stamp_ns: int, expectation: Expectation) -> None:
        """Keep the innovation of this sample where one is due; rows of rejected legs count."""
        if self._kept_ns is not None and 0 <= stamp_ns - self._kept_ns < _PERIOD_NS:
            return
        self._kept_ns = stamp_ns
        self._kept.append(Innovation(stamp_ns, "legs", expectation.innovation_squared, expectation.degrees_of_freedom))

    def take(self) -> tuple[Innovation, ...]:
        """Those since the last call."""
        kept, self._kept = tuple(self._kept), []
        return kept

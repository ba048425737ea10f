# SPDX-License-Identifier: BSD-3-Clause
"""Samples of one stream at a lower rate than they come."""

from coclo_vio.values.units import NS_PER_S

_JITTER = 0.1  # of the interval, by which a sample may come too soon


class Thinning:
    """Leaves out samples that follow the last one that was used sooner than an interval.

    A sample from before the last one is used: its clock has been set back.
    """

    def __init__(self, interval_s: float) -> None:
        """Take the interval, s; 0: nothing is left out."""
        self._interval_ns = round((1.0 - _JITTER) * interval_s * NS_PER_S)
        self._used_ns: int | None = None

    def leaves_out(self, stamp_ns: int) -> bool:
        """Whether a sample of this stamp is left out; otherwise it counts as used."""
        if self._used_ns is not None and 0 <= stamp_ns - self._used_ns < self._interval_ns:
            return True
        self._used_ns = stamp_ns
        return False

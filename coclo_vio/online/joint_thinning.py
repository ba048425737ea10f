# SPDX-License-Identifier: BSD-3-Clause
"""Joint samples and foot forces at a lower rate than they come, for computers that do not keep pace with them all."""

from coclo_vio.values.measurements import FootForceSample, JointSample, Measurement
from coclo_vio.values.units import NS_PER_S

_JITTER = 0.1  # of the interval, by which a sample may come too soon


class JointThinning:
    """Leaves out samples that follow the last one of their kind that was used sooner than an interval.

    IMUs are not thinned: the filter takes the mean of their readings between two joint samples.
    """

    def __init__(self, interval_s: float) -> None:
        """Take the interval, s; 0: nothing is left out."""
        self._interval_ns = round((1.0 - _JITTER) * interval_s * NS_PER_S)
        self._used_ns: dict[type, int] = {}

    def leaves_out(self, measurement: Measurement, stamp_ns: int) -> bool:
        """Whether a sample of this stamp, by the clock of the estimator, is left out."""
        if not self._interval_ns or not isinstance(measurement, JointSample | FootForceSample):
            return False
        last_ns = self._used_ns.get(type(measurement))
        if last_ns is not None and 0 <= stamp_ns - last_ns < self._interval_ns:
            return True
        self._used_ns[type(measurement)] = stamp_ns
        return False

# SPDX-License-Identifier: BSD-3-Clause
"""Joint samples and foot forces at a lower rate than they come, for computers that do not keep pace with them all."""

from coclo_vio.values.measurements import FootForceSample, JointSample, Measurement
from coclo_vio.values.thinning import Thinning


class JointThinning:
    """Leaves out samples that follow the last one of their kind that was used sooner than an interval.

    IMUs are not thinned: the filter takes the mean of their readings between two joint samples.
    """

    def __init__(self, interval_s: float) -> None:
        """Take the interval, s; 0: nothing is left out."""
        self._of_kind: dict[type, Thinning] = {kind: Thinning(interval_s) for kind in (JointSample, FootForceSample)}

    def leaves_out(self, measurement: Measurement, stamp_ns: int) -> bool:
        """Whether a sample of this stamp, by the clock of the estimator, is left out."""
        thinning = self._of_kind.get(type(measurement))
        return thinning is not None and thinning.leaves_out(stamp_ns)

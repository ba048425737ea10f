# SPDX-License-Identifier: BSD-3-Clause
"""When all standing feet slip: while those that have stood for a while take over the weight of one that lifts off.

A foot holds under a steady load. As its load rises it gives way, downhill on a slope, and the body with all feet that
stand. Such a slip comes in jumps of less than a millimetre, in the part of a step in which the body is slow, so it is
no share of the body's speed.
"""

import math

import numpy as np

from coclo_vio.geometry.array_types import Array, BoolArray

_SMOOTHING_S = 0.02  # of the shares of the weight, against the noise of loads
_STOOD_S = 0.3  # from then on a foot has taken the load of its own touch-down
_SLOW_PER_S = 1.0  # share of the weight a second: so slowly weight also moves between feet as the body moves over them
_MEMORY_M = 1.0  # way over which the mean takeover is known
_PRIOR_M = 0.3  # way that must be known before the takeover counts as much as not
_STILL_MPS = 0.005  # at this speed half of the takeover counts: a body at rest has no slip that would be observed


class LoadTransfer:
    """Follows the weight from foot to foot.

    The speed that it returns has the body's speed as its mean, so what a slip is a share of is the way of the body.

    Args:
        legs: their number.
    """

    def __init__(self, legs: int) -> None:
        self._shares = np.full(legs, 1.0 / legs)
        self._stood_s = np.zeros(legs)
        self._taken, self._way_m = 0.0, 0.0

    def clear(self) -> None:
        """No foot has stood before this."""
        self._stood_s[:] = 0.0

    def push(self, weights: Array, is_stance: BoolArray, speed_mps: float, dt_s: float) -> float:
        """Take a joint sample.

        Args:
            weights: what each foot carries, in any unit, not negative, (n,).
            is_stance: feet that stand, (n,).
            speed_mps: of the body, m/s.
            dt_s: time since the sample before, s.

        Returns:
            The body's mean speed times the present takeover over its mean, m/s; 0 where there is none.
        """
        self._stood_s = np.where(is_stance, self._stood_s + dt_s, 0.0)
        total = float(weights.sum())
        if total <= 0.0:
            return 0.0
        change = (weights / total - self._shares) * (1.0 - math.exp(-dt_s / _SMOOTHING_S))
        self._shares = self._shares + change
        taken = float(np.maximum(change, 0.0)[self._stood_s >= _STOOD_S].sum()) / dt_s
        rate = max(taken - _SLOW_PER_S, 0.0) * speed_mps / (speed_mps + _STILL_MPS)
        kept = math.exp(-speed_mps * dt_s / _MEMORY_M)
        self._taken = kept * self._taken + rate * dt_s
        self._way_m = kept * self._way_m + speed_mps * dt_s
        if rate == 0.0:
            return 0.0
        return rate * self._way_m / self._taken * self._way_m / (_PRIOR_M + self._way_m)

# SPDX-License-Identifier: BSD-3-Clause
"""Slip of standing feet by load: they slip while they take over the weight of a foot that lifts off.

A foot holds under a steady load. As its load rises it gives way, downhill on a slope, and the body moves with it. On
simulated ramps all standing feet together slide by about half a millimetre at each lift-off. The body is slow then, so
this slip is no share of its speed.
"""

import math

import numpy as np

from coclo_vio.geometry.array_types import Array, BoolArray

_SMOOTHING_S = 0.02  # of the shares of the weight, against the noise of loads
_STOOD_S = 0.3  # from then on a foot has taken the load of its own touch-down
_SLOW_PER_S = 1.0  # share of the weight a second: so slowly weight also moves between feet as the body moves over them
_MEMORY_M = 1.0  # way over which the mean takeover is known
_PRIOR_M = 0.3  # after this way the takeover counts half
_STILL_MPS = 0.005  # at this speed the takeover counts half: a body at rest has no slip that would be observed
_MOST = 30.0  # multiple of the body's mean speed


class LoadTransfer:
    """Follows the weight from foot to foot.

    The speed that it returns has the body's speed as its mean once steps are known, so that slip is a share of the way.

    Args:
        weights: what each foot carries at first, in any unit, not negative, (n,).
    """

    def __init__(self, weights: Array) -> None:
        self._taken, self._way_m, self._moved_s, self._known_m = 0.0, 0.0, 0.0, 0.0
        self._shares, self._stood_s = weights, np.zeros(len(weights))
        self.restart(weights)

    def restart(self, weights: Array) -> None:
        """Take weights (n,) that do not continue those before: after a gap, or from another source."""
        total = float(weights.sum())
        self._shares = weights / total if total > 0.0 else np.full(len(weights), 1.0 / len(weights))
        self._stood_s = np.zeros(len(weights))

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
        moving = speed_mps / (speed_mps + _STILL_MPS)
        taken = float(np.maximum(change, 0.0)[self._stood_s >= _STOOD_S].sum()) / dt_s
        rate = max(taken - _SLOW_PER_S, 0.0) * moving
        step_m = speed_mps * dt_s
        kept = math.exp(-step_m / _MEMORY_M)
        self._taken = kept * self._taken + rate * dt_s
        self._way_m = kept * self._way_m + step_m
        self._moved_s = kept * self._moved_s + moving * dt_s
        self._known_m += step_m
        if rate == 0.0:
            return 0.0
        known = self._known_m / (_PRIOR_M + self._known_m)
        return known * min(rate * self._way_m / self._taken, _MOST * self._way_m / self._moved_s)

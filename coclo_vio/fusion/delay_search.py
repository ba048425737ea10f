# SPDX-License-Identifier: BSD-3-Clause
"""Finds a delay of the images that is too large for ``rotation_calibration``, which is linear in it: 25 ms to a second.

Rates of the body by pairs of frames are compared with those of the gyroscope earlier and later by each lag of a grid,
their mean difference (a bias) removed. A gait repeats itself, so a lag counts only where it explains the rates much
better than every other lag does, and than none at all. Source: the correlation of rates in Furgale, Rehder, Siegwart,
"Unified temporal and spatial calibration for multi-sensor systems", 2013, with an absolute norm.
"""

from collections import deque

import numpy as np

from coclo_vio.fusion.rotation_streams import GyroscopeRotation
from coclo_vio.values.arrays import Array
from coclo_vio.values.units import NS_PER_S

RANGE_S = 1.0  # of lags, to either side
LEAST_LAG_S = 0.025
"""A smaller delay is found by the calibration, which is linear in the delay."""

_STEP_S = 0.01
_LAGS_S = np.linspace(-RANGE_S, RANGE_S, 2 * round(RANGE_S / _STEP_S) + 1)
_FEWEST, _MOST = 10, 40  # pairs of frames that are compared
_NEAR_S = 0.15  # lags about the best one that explain nearly as much
_LEAST_RATE_RADPS = 0.005  # mean absolute rate, less than which shows nothing
_SHARE_OF_NONE, _SHARE_OF_RATES, _SHARE_OF_OTHERS = 0.4, 0.4, 0.5  # that the differences at the best lag may be of


class DelaySearch:
    """Takes rotations between frames; the delay of the images once it is certain."""

    def __init__(self, gyroscope: GyroscopeRotation) -> None:
        """Take the gyroscope, which is fed by others, and keeps readings of more than two ranges of lags."""
        self._gyroscope = gyroscope
        self._waiting: deque[tuple[int, int, Array]] = deque()
        self._visual: deque[Array] = deque(maxlen=_MOST)
        self._lagged: deque[Array] = deque(maxlen=_MOST)  # rates by the gyroscope, (lags, 3)

    def restart(self) -> None:
        """Forget all: stamps of images have changed."""
        self._waiting.clear()
        self._visual.clear()
        self._lagged.clear()

    def push(self, start_ns: int, end_ns: int, by_vision: Array) -> float | None:
        """Take a rotation between two frames; by how much stamps of images are late, s, or None.

        Args:
            start_ns: stamp of the first frame.
            end_ns: stamp of the second one.
            by_vision: rotation vector of the body, body axes, rad, (3,).
        """
        self._waiting.append((start_ns, end_ns, by_vision))
        has_more = False
        while self._waiting and self._waiting[0][1] + RANGE_S * NS_PER_S <= end_ns:
            first_ns, last_ns, turn = self._waiting.popleft()
            back_ns = np.rint(_LAGS_S * NS_PER_S).astype(np.int64)
            rates = self._gyroscope.mean_rates(first_ns - back_ns, last_ns - back_ns)
            if rates is not None:
                self._visual.append(turn * NS_PER_S / (last_ns - first_ns))
                self._lagged.append(rates)
                has_more = True
        return self._best_lag_s() if has_more and len(self._visual) >= _FEWEST else None

    def _best_lag_s(self) -> float | None:
        visual = np.array(self._visual)
        spread = _mean_size(visual - visual.mean(axis=0))
        if spread < _LEAST_RATE_RADPS:
            return None
        off = visual[:, None] - np.array(self._lagged)
        by_lag = _mean_size(off - off.mean(axis=0))
        best = int(by_lag.argmin())
        delay_s, least = float(_LAGS_S[best]), by_lag[best]
        others = by_lag[np.abs(_LAGS_S - delay_s) > _NEAR_S].min()
        limits = _SHARE_OF_NONE * by_lag[len(_LAGS_S) // 2], _SHARE_OF_RATES * spread, _SHARE_OF_OTHERS * others
        return delay_s if abs(delay_s) > LEAST_LAG_S and least < min(limits) else None


def _mean_size(vectors: Array) -> Array:
    """Mean length over the first axis of vectors (pairs, ..., 3)."""
    return np.asarray(np.linalg.norm(vectors, axis=-1).mean(axis=0))

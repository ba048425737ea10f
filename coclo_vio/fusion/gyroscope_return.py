# SPDX-License-Identifier: BSD-3-Clause
"""Watches a gyroscope that has been set aside, for the time at which it agrees with the cameras again."""

from collections import deque

import numpy as np

from coclo_vio.fusion.rotation_findings import GyroscopeAgrees
from coclo_vio.fusion.rotation_streams import GyroscopeRotation
from coclo_vio.values.arrays import Array
from coclo_vio.values.units import NS_PER_S

_COMPARED = 10  # intervals in a row
_LEAST_RATE_RADPS = 0.01  # root mean square about its mean, less than which shows nothing
_MOST_SHARE = 0.2  # of that, the differences: a mounting of 5 degrees is 0.09


class GyroscopeReturn:
    """Compares the turns of the latest intervals, their mean difference (a bias) removed."""

    def __init__(self, gyroscope: GyroscopeRotation) -> None:
        """Take the gyroscope, which is fed by others."""
        self._gyroscope = gyroscope
        self._rates: deque[tuple[Array, Array]] = deque(maxlen=_COMPARED)  # by cameras, by gyroscope

    def push(self, start_ns: int, end_ns: int, by_vision: Array) -> GyroscopeAgrees | None:
        """Take a rotation between two frames, body axes, rad, (3,); None while the two do not agree."""
        turned = self._gyroscope.between(start_ns, end_ns, np.zeros(3))
        if turned is None:
            self._rates.clear()
            return None
        dt_s = (end_ns - start_ns) / NS_PER_S
        self._rates.append((by_vision / dt_s, turned[0] / dt_s))
        if len(self._rates) < _COMPARED:
            return None
        by_cameras, by_gyroscope = (np.array(each) for each in zip(*self._rates, strict=True))
        off = by_gyroscope - by_cameras
        moved, noise = _deviation(by_cameras), _deviation(off)
        if moved < _LEAST_RATE_RADPS or noise > _MOST_SHARE * moved:
            return None
        return GyroscopeAgrees(off.mean(axis=0), noise / np.sqrt(3.0 * _COMPARED))


def _deviation(rates: Array) -> float:
    """Root mean square about the mean of vectors (n, 3)."""
    return float(np.sqrt(np.square(rates - rates.mean(axis=0)).sum(axis=1).mean()))

# SPDX-License-Identifier: BSD-3-Clause
"""A trajectory as a line that grows: in parts of bounded length, so that a long run is not sent again and again."""

from collections.abc import Callable

import numpy as np

from coclo_vio.values.arrays import Array

_SPACING_M, _SPACING_NS = 0.005, 1_000_000_000  # a point for every so much of way, and of time at rest
_REDRAWN_NS = 200_000_000
_POINTS_PER_PART = 200


class DrawnPath:
    """Collects points, and draws the part that grows five times a second."""

    def __init__(self, draw: Callable[[int, int, Array], None]) -> None:
        """Take what draws: called with the stamp (ns), the number of the part and its points (N, 3)."""
        self._draw = draw
        self._points: list[Array] = []
        self._part, self._added_ns, self._drawn_ns = 0, 0, 0
        self._is_drawn = True

    def add(self, stamp_ns: int, position: Array) -> None:
        """Add a point, m, (3,), where it is far enough from the last one."""
        if self._points:
            moved_m = float(np.linalg.norm(position - self._points[-1]))
            if moved_m < _SPACING_M and abs(stamp_ns - self._added_ns) < _SPACING_NS:
                return
        self._points.append(np.array(position))
        self._added_ns, self._is_drawn = stamp_ns, False
        is_full = len(self._points) >= _POINTS_PER_PART
        if is_full or abs(stamp_ns - self._drawn_ns) >= _REDRAWN_NS:
            self.finish()
        if is_full:
            self._points = self._points[-1:]
            self._part += 1

    def finish(self) -> None:
        """Draw what has not been drawn yet."""
        if not self._is_drawn and len(self._points) > 1:
            self._draw(self._added_ns, self._part, np.array(self._points))
            self._drawn_ns, self._is_drawn = self._added_ns, True

# SPDX-License-Identifier: BSD-3-Clause
"""What the smoother reports besides its estimates: counts, events, and its health at each keyframe."""

from collections import Counter
from collections.abc import Mapping

import numpy as np

from coclo_vio.backend.window.keyframe import Solution
from coclo_vio.values.measurements import StereoTracks
from coclo_vio.values.outputs import Event, KeyframeHealth

_SMALLEST = 1e-300  # keeps a quotient finite
_FEW_DROPPED = 10  # landmarks at one keyframe: no event, however few are left


class EventLog:
    """Counts over the whole run; keeps events and health until they are taken, so memory stays flat."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._events: list[Event] = []
        self._health: list[KeyframeHealth] = []
        self._has_vision = True

    @property
    def counts(self) -> Mapping[str, int]:
        """How often each thing happened, by name."""
        return {name: count for name, count in sorted(self._counts.items()) if count}

    def count(self, name: str, times: int = 1) -> None:
        """Count something ordinary, which is no event."""
        self._counts[name] += times

    def add_dropped(self, stamp_ns: int, dropped: int, solved: int) -> None:
        """Count the landmarks that were not determined and were dropped; many of them at once are an event."""
        self.count("landmarks_dropped", dropped)
        if dropped > max(_FEW_DROPPED, solved):
            detail = f"{dropped} landmarks were not determined and were dropped; {solved} are left in the window"
            self.add(stamp_ns, "many_landmarks_dropped", detail)

    def add(self, stamp_ns: int, kind: str, detail: str) -> None:
        """Count an event and keep it."""
        self._counts[kind] += 1
        self._events.append(Event(stamp_ns, kind, detail))

    def add_vision(self, tracks: StereoTracks, *, has_vision: bool) -> None:
        """Count a frame without vision; the loss of vision and its recovery are events."""
        self._counts["frames_without_vision"] += not has_vision
        if has_vision == self._has_vision:
            return
        self._has_vision = has_vision
        if has_vision:
            detail = "landmarks are observed again; the frame is localised by them"
            self.add(tracks.stamp_ns, "vision_recovered", detail)
        else:
            reason = tracks.reason or f"too few of {len(tracks)} tracks fit the landmarks"
            self.add(
                tracks.stamp_ns, "vision_lost", f"{reason}; poses are predicted until landmarks are observed again"
            )

    def add_keyframe(self, stamp_ns: int, tracks: int, keyframes: int, solution: Solution, compute_s: float) -> None:
        """Count a keyframe and keep its health.

        Args:
            stamp_ns: time of the keyframe.
            tracks: points that were matched to landmarks or began one.
            keyframes: in the window.
            solution: of the window.
            compute_s: processor time, s.
        """
        self._counts["keyframes"] += 1
        axes = np.linalg.eigvalsh(solution.covariance[:6, :6])
        self._health.append(
            KeyframeHealth(
                stamp_ns=stamp_ns,
                keyframes=keyframes,
                tracks=tracks,
                landmarks=solution.landmarks,
                factors=solution.factors,
                reprojection_px=solution.reprojection_px,
                iterations=solution.iterations,
                compute_s=compute_s,
                condition=float(np.sqrt(max(axes[-1], 0.0) / max(axes[0], _SMALLEST))),
            )
        )

    def take(self) -> tuple[tuple[Event, ...], tuple[KeyframeHealth, ...]]:
        """Events and health of keyframes since the last call."""
        events, self._events = tuple(self._events), []
        health, self._health = tuple(self._health), []
        return events, health

# SPDX-License-Identifier: BSD-3-Clause
"""What the smoother tells of itself: counts, events, and its health at each keyframe."""

from collections import Counter
from collections.abc import Mapping

import numpy as np

from coclo_vio.backend.window.window import Solution
from coclo_vio.values.measurements import StereoTracks
from coclo_vio.values.outputs import Event, KeyframeHealth

_SMALLEST = 1e-300  # keeps a quotient finite


class Diary:
    """Counts for ever; keeps events and health until somebody takes them, so memory stays flat."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._events: list[Event] = []
        self._health: list[KeyframeHealth] = []
        self._is_blind = False

    @property
    def counts(self) -> Mapping[str, int]:
        """How often each thing happened, by name."""
        return {name: count for name, count in sorted(self._counts.items()) if count}

    def count(self, name: str) -> None:
        """Count something that is nothing out of the ordinary."""
        self._counts[name] += 1

    def tell(self, stamp_ns: int, kind: str, detail: str) -> None:
        """Count an event and keep it."""
        self._counts[kind] += 1
        self._events.append(Event(stamp_ns, kind, detail))

    def tell_sight(self, tracks: StereoTracks, *, is_blind: bool) -> None:
        """Count a frame without sight; its beginning and its end are events."""
        self._counts["blind_frames"] += is_blind
        if is_blind == self._is_blind:
            return
        self._is_blind = is_blind
        if is_blind:
            why = tracks.reason or f"{len(tracks)} tracks, too few that fit the landmarks"
            self.tell(tracks.stamp_ns, "blind", f"{why}; carried on without sight")
        else:
            self.tell(tracks.stamp_ns, "sight", "landmarks are seen again")

    def note(self, stamp_ns: int, tracks: int, keyframes: int, solution: Solution, compute_s: float) -> None:
        """Count a keyframe and keep its health.

        Args:
            stamp_ns: its time.
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

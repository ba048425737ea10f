# SPDX-License-Identifier: BSD-3-Clause
"""A recording through an estimator: measurements in, estimates out, one at a time."""

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from coclo_vio.values.errors import CocloError
from coclo_vio.values.estimates import SelfReporting, Several, StateEstimate
from coclo_vio.values.measurements import Measurement
from coclo_vio.values.outputs import Estimator, Event, KeyframeHealth
from coclo_vio.values.units import NS_PER_S


@dataclass(frozen=True, slots=True)
class RunSummary:
    """How a run went.

    Attributes:
        measurements: how many were pushed.
        estimates: how many came out.
        recording_ns: stamps of the earliest and latest measurement, None without any.
        compute_s: time spent in the estimator, s.
        counts: what the estimator counted.
        failure: why it stopped early, None if it went through.
        events: what it lived through.
        estimated_until_ns: stamp of the last estimate, None without any.
        others: how many estimates came out under each further name.
    """

    measurements: int
    estimates: int
    recording_ns: tuple[int, int] | None
    compute_s: float
    counts: Mapping[str, int]
    failure: str | None
    events: tuple[Event, ...] = ()
    estimated_until_ns: int | None = None
    others: Mapping[str, int] = field(default_factory=dict)

    @property
    def realtime_factor(self) -> float | None:
        """Seconds of recording, up to the last estimate, per second of computing."""
        if self.recording_ns is None or self.estimated_until_ns is None or self.compute_s <= 0.0:
            return None
        return (self.estimated_until_ns - self.recording_ns[0]) / NS_PER_S / self.compute_s


def run(
    estimator: Estimator,
    measurements: Iterable[Measurement],
    take: Callable[[StateEstimate], None],
    progress: Callable[[int], None] | None = None,
    keep_health: Callable[[KeyframeHealth], None] | None = None,
    take_other: Callable[[str, StateEstimate], None] | None = None,
) -> RunSummary:
    """Push every measurement and hand each estimate on; an error ends the run, what came before it stays.

    What an estimator tells of itself is taken from it at once, so that its memory stays flat.

    Args:
        estimator: a fresh estimator.
        measurements: in time order.
        take: called with each estimate.
        progress: called with the stamp (ns) of each measurement.
        keep_health: called with each keyframe's health, where the estimator has keyframes.
        take_other: called with name and estimate, where the estimator has several answers.
    """
    several = estimator if isinstance(estimator, Several) else None
    others: Counter[str] = Counter()
    diary = _Diary(estimator, keep_health)
    pushed = estimates = 0
    first_ns = last_ns = until_ns = None
    compute_s = 0.0
    failure = None
    try:
        for measurement in measurements:
            stamp_ns = measurement.stamp_ns
            first_ns = stamp_ns if first_ns is None else min(first_ns, stamp_ns)
            last_ns = stamp_ns if last_ns is None else max(last_ns, stamp_ns)
            began = time.perf_counter()
            estimate = estimator.push(measurement)
            compute_s += time.perf_counter() - began
            pushed += 1
            diary.read()
            if estimate is not None:
                estimates += 1
                until_ns = estimate.stamp_ns
                take(estimate)
            for name, other in () if several is None else several.take_others():
                others[name] += 1
                if take_other is not None:
                    take_other(name, other)
            if progress is not None:
                progress(stamp_ns)
    except CocloError as error:
        failure = str(error)
    diary.read()
    recording_ns = None if first_ns is None or last_ns is None else (first_ns, last_ns)
    counts = dict(estimator.counts)
    events = tuple(diary.events)
    return RunSummary(pushed, estimates, recording_ns, compute_s, counts, failure, events, until_ns, dict(others))


class _Diary:
    """Takes from an estimator what it tells of itself, if it does."""

    def __init__(self, estimator: Estimator, keep_health: Callable[[KeyframeHealth], None] | None) -> None:
        self.events: list[Event] = []
        self._estimator = estimator if isinstance(estimator, SelfReporting) else None
        self._keep_health = keep_health

    def read(self) -> None:
        if self._estimator is None:
            return
        self.events += self._estimator.take_events()
        for health in self._estimator.take_health():
            if self._keep_health is not None:
                self._keep_health(health)

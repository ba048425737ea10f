# SPDX-License-Identifier: BSD-3-Clause
"""A recording through an estimator: measurements in, outputs out, one at a time."""

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Protocol, runtime_checkable

from coclo_vio.runs.first_clock import FirstClock
from coclo_vio.values.errors import CocloError
from coclo_vio.values.measurements import Measurement
from coclo_vio.values.outputs import Estimate, Estimator, Event, Output
from coclo_vio.values.units import NS_PER_S


@dataclass(frozen=True, slots=True)
class RunSummary:
    """How a run went.

    Attributes:
        measurements: how many were pushed.
        estimates: how many came out, by the name of the trajectory.
        recording_ns: stamps of the earliest and latest measurement used, None without any.
        compute_s: time spent in the estimator, s.
        counts: what the estimator counted.
        failure: why it stopped early, None if it went through.
        events: what happened in it.
        estimated_until_ns: latest stamp of an estimate, None without any.
        is_stopped: whether it was asked to stop before the measurements ended.
    """

    measurements: int = 0
    estimates: Mapping[str, int] = field(default_factory=dict)
    recording_ns: tuple[int, int] | None = None
    compute_s: float = 0.0
    counts: Mapping[str, int] = field(default_factory=dict)
    failure: str | None = None
    events: tuple[Event, ...] = ()
    estimated_until_ns: int | None = None
    is_stopped: bool = False

    @property
    def realtime_factor(self) -> float | None:
        """Seconds of recording, up to the last estimate, per second of computing."""
        if self.recording_ns is None or self.estimated_until_ns is None or self.compute_s <= 0.0:
            return None
        return (self.estimated_until_ns - self.recording_ns[0]) / NS_PER_S / self.compute_s


@runtime_checkable
class Spanning(Protocol):
    """An estimator that refuses samples, and knows from when to when those were that it used."""

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Earliest and latest stamp of the samples used, by a clock that never steps; None before any."""


def run(
    estimator: Estimator,
    measurements: Iterable[Measurement],
    take: Callable[[Output], None],
    progress: Callable[[int], None] | None = None,
    *,
    tally: "Tally | None" = None,
    stop: Callable[[], bool] | None = None,
    keep: Callable[[Output], None] | None = None,
) -> RunSummary:
    """Push every measurement and hand each output on; an error ends the run, what came before it stays.

    Args:
        estimator: a fresh estimator, or one that goes on where ``tally`` ended.
        measurements: in time order.
        take: called with each output.
        progress: called with the stamp (ns) of each measurement.
        tally: counts on from here; from nothing if None.
        stop: asked before each measurement whether to stop; what the estimator holds back comes out all the same.
        keep: called with each output before ``take``, by the clock that the run began with (``first_clock``).
    """
    tally = tally or Tally()
    failure, is_stopped = None, False
    try:
        for measurement in measurements:
            if stop is not None and stop():
                is_stopped = True
                break
            tally.count(measurement.stamp_ns)
            tally.take(partial(estimator.push, measurement), take, keep)
            if progress is not None:
                progress(measurement.stamp_ns)
        tally.take(estimator.finish, take, keep)
    except CocloError as error:
        failure = str(error)
    return tally.summary_of(estimator, failure, is_stopped=is_stopped)


class Tally:
    """Counts what goes in and comes out, and keeps the events, all by the clock that the run began with.

    Attributes:
        clock: undoes the steps of the clock of all streams.
    """

    def __init__(self) -> None:
        self.clock = FirstClock()
        self._compute_s = 0.0
        self._measurements = 0
        self._first_ns: int | None = None
        self._last_ns = 0
        self._until_ns: int | None = None
        self._estimates: Counter[str] = Counter()
        self._events: list[Event] = []

    def count(self, stamp_ns: int) -> None:
        """A measurement goes in."""
        self._last_ns = stamp_ns if self._first_ns is None else max(self._last_ns, stamp_ns)
        self._first_ns = stamp_ns if self._first_ns is None else min(self._first_ns, stamp_ns)
        self._measurements += 1

    @property
    def measurements(self) -> int:
        """How many went in."""
        return self._measurements

    def take(
        self,
        call: Callable[[], Iterable[Output]],
        hand_on: Callable[[Output], None],
        keep: Callable[[Output], None] | None = None,
    ) -> None:
        """A call of the estimator, and the outputs that it gives; ``keep`` gets them by the first clock."""
        for output in self._timed(call):
            undone = self.clock.undone(output)
            match undone:
                case Estimate():
                    self._estimates[undone.name] += 1
                    stamp_ns = undone.state.stamp_ns
                    self._until_ns = stamp_ns if self._until_ns is None else max(self._until_ns, stamp_ns)
                case Event():
                    self._events.append(undone)
            if keep is not None:
                keep(undone)
            hand_on(output)

    def _timed(self, call: Callable[[], Iterable[Output]]) -> Iterator[Output]:
        """The outputs of a call; it may compute each of them only when it is taken."""
        began = time.perf_counter()
        for output in call():
            self._compute_s += time.perf_counter() - began
            yield output
            began = time.perf_counter()
        self._compute_s += time.perf_counter() - began

    def summary_of(self, estimator: Estimator, failure: str | None = None, *, is_stopped: bool = False) -> RunSummary:
        """The same with the counts of the estimator, and without the stamps that it refused."""
        summary = self.summary(dict(estimator.counts), failure, is_stopped=is_stopped)
        if isinstance(estimator, Spanning) and estimator.span_ns is not None:
            return replace(summary, recording_ns=estimator.span_ns)
        return summary

    def summary(self, counts: Mapping[str, int], failure: str | None = None, *, is_stopped: bool = False) -> RunSummary:
        """What it has come to so far.

        Args:
            counts: of the estimator.
            failure: why it stopped early.
            is_stopped: whether it was asked to.
        """
        return RunSummary(
            self._measurements,
            dict(self._estimates),
            None if self._first_ns is None else (self._first_ns, self._last_ns),
            self._compute_s,
            counts,
            failure,
            tuple(self._events),
            self._until_ns,
            is_stopped,
        )

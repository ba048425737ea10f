# SPDX-License-Identifier: BSD-3-Clause
"""The times of a recording that is played to an estimator: latencies, pushes, what waited, load of the processes."""

import time
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping

from coclo_vio.datasets.read_report import STREAM_NAMES
from coclo_vio.runs.latency import DurationHistogram, IntervalRecord, LatencyRecord, LoadRecord
from coclo_vio.runs.process_load import ProcessLoad
from coclo_vio.values.measurements import Measurement
from coclo_vio.values.units import NS_PER_S

_SETTLING_S = 2.0


class PlayTimes:
    """All times of a recording that is played.

    Attributes:
        due_ns: when the measurement that is pushed now was due, by the monotonic clock.
        images_left_out: images that did not reach the estimator.
        joints_left_out: joint samples that did not.
    """

    def __init__(self, interval_s: float, rate: float, processes: Mapping[str, Callable[[], int | None]]) -> None:
        self._interval_ns, self._rate = round(interval_s * NS_PER_S), rate
        self._processes = processes
        self._loads: dict[str, tuple[int, ProcessLoad]] = {}
        self._intervals: list[IntervalRecord] = []
        self._trajectories: defaultdict[str, DurationHistogram] = defaultdict(DurationHistogram)
        self._streams: defaultdict[str, DurationHistogram] = defaultdict(DurationHistogram)
        self._pushes: defaultdict[str, DurationHistogram] = defaultdict(DurationHistogram)
        self._cpu: defaultdict[str, DurationHistogram] = defaultdict(DurationHistogram)
        self._of_interval: defaultdict[str, DurationHistogram] = defaultdict(DurationHistogram)
        self._pushed: Counter[str] = Counter()
        self._number, self._spent_ns, self._most_waiting, self._left_out_before = 0, 0, 0, 0
        self._most_of_all = 0
        self._begin_ns: int | None = None
        self._interval_began_ns = 0
        self._settled_ns: int | None = None
        self._schedule: tuple[int, int] | None = None  # a stamp, and when it was due
        self.due_ns = 0
        self.images_left_out = self.joints_left_out = 0
        self._take_loads()

    def waiting(self, number: int) -> None:
        """So many measurements wait."""
        self._most_waiting = max(self._most_waiting, number)

    def leave_out(self) -> None:
        """An image is left out."""
        self.images_left_out += 1

    def leave_out_joints(self) -> None:
        """A joint sample is left out."""
        self.joints_left_out += 1

    def estimate(self, name: str, stamp_ns: int) -> None:
        """An estimate of this stamp comes out now."""
        now_ns = time.monotonic_ns()
        due_ns = self.due_ns
        if self._schedule is not None:
            due_ns = self._schedule[1] + round((stamp_ns - self._schedule[0]) / self._rate)
        self._of_interval[name].add(now_ns - due_ns)
        if self._settled_ns is None:
            self._settled_ns = now_ns + round(_SETTLING_S * NS_PER_S)
        if now_ns >= self._settled_ns:
            self._trajectories[name].add(now_ns - due_ns)

    def pushed(self, measurement: Measurement, began_ns: int, cpu_ns: int) -> None:
        """The push of a measurement has returned, which took so much processor time of its thread."""
        now_ns = time.monotonic_ns()
        self._schedule = measurement.stamp_ns, self.due_ns
        if self._begin_ns is None:
            self._begin_ns, self._interval_began_ns = self.due_ns, now_ns
        stream = STREAM_NAMES[type(measurement)]
        self._pushed[stream] += 1
        self._number, self._spent_ns = self._number + 1, self._spent_ns + now_ns - began_ns
        if self._settled_ns is not None and now_ns >= self._settled_ns:
            self._pushes[stream].add(now_ns - began_ns)
            self._cpu[stream].add(cpu_ns)
            self._streams[stream].add(now_ns - self.due_ns)
        if now_ns - self._interval_began_ns >= self._interval_ns:
            self.end_interval(now_ns)

    def end_interval(self, now_ns: int) -> None:
        """An interval is over."""
        if not self._number or self._begin_ns is None:
            return
        spreads = {name: one.spread().p95_ms for name, one in self._of_interval.items()}
        self._intervals.append(
            IntervalRecord(
                time_s=(now_ns - self._begin_ns) / NS_PER_S,
                length_s=(now_ns - self._interval_began_ns) / NS_PER_S,
                measurements=self._number,
                push_ms=self._spent_ns / self._number / 1e6,
                latency_p95_ms={name: p95 for name, p95 in spreads.items() if p95 is not None},
                waiting_most=self._most_waiting,
                images_left_out=self.images_left_out - self._left_out_before,
                processes=self._take_loads(),
            )
        )
        self._most_of_all = max(self._most_of_all, self._most_waiting)
        self._of_interval.clear()
        self._number = self._spent_ns = self._most_waiting = 0
        self._left_out_before, self._interval_began_ns = self.images_left_out, now_ns

    def _take_loads(self) -> dict[str, LoadRecord]:
        """The load of each process since the last call; nothing of one that is new or gone."""
        loads = {}
        for name, number in self._processes.items():
            pid, known = number(), self._loads.get(name)
            if pid is None:
                continue
            if known is None or known[0] != pid:
                self._loads[name] = pid, ProcessLoad(pid)
                continue
            load = known[1].take()
            if load is not None:
                loads[name] = load
        return loads

    def record(self, mode: str, vision: str) -> LatencyRecord:
        """The record of all times."""
        return LatencyRecord(
            mode=mode,
            vision=vision,
            rate=self._rate,
            settling_s=_SETTLING_S,
            trajectories={name: one.spread() for name, one in sorted(self._trajectories.items())},
            streams={name: one.spread() for name, one in sorted(self._streams.items())},
            pushes={name: one.spread() for name, one in sorted(self._pushes.items())},
            pushes_cpu={name: one.spread() for name, one in sorted(self._cpu.items())},
            measurements=dict(self._pushed),
            left_out=self.images_left_out,
            joints_left_out=self.joints_left_out,
            waiting_most=max(self._most_of_all, self._most_waiting),
            intervals=tuple(self._intervals),
        )

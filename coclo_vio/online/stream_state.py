# SPDX-License-Identifier: BSD-3-Clause
"""What is known of one stream of samples: its clock, its period, what became of its samples."""

from collections import Counter, deque
from dataclasses import dataclass, field

from coclo_vio.datasets.read_report import STREAM_NAMES
from coclo_vio.values.measurements import IMAGE_SENSORS, Measurement
from coclo_vio.values.outputs import StreamStatus
from coclo_vio.values.units import NS_PER_S

_PERIODS = 15  # from whose median the period is known
_FEWEST_PERIODS = 4
_LEAST_AHEAD_NS = NS_PER_S // 10  # a stream is not suddenly ahead of the others by less
_TIMES_SPREAD = 3  # nor by less than so many times what its lags have differed by
_RECENT = 1024  # stamps that are remembered, so that a repeated one is found


@dataclass(frozen=True, slots=True, eq=False)
class Arrival:
    """A sample as it came.

    Attributes:
        measurement: with its own stamp.
        stream: which it is of.
        raw_ns: its stamp, by the clock of its driver.
        number: of all samples, in the order of arrival.
        now_ns: newest stamp of all streams when it came, by the clock of the estimator.
        arrival_ns: when it came, by a clock that never steps; None where that is unknown.
    """

    measurement: Measurement
    stream: "StreamState"
    raw_ns: int
    number: int
    now_ns: int
    arrival_ns: int | None


@dataclass(slots=True, eq=False)
class StreamState:
    """One stream.

    Attributes:
        kind: of its samples.
        shift_ns: stamp of a sample plus this is the clock of the estimator.
        newest_ns: the latest stamp accepted, by the clock of the estimator.
        newest_arrival_ns: when that sample came.
        used_ns: stamp of the last sample that the estimator got, by its clock.
        is_apart: whether its clock is another than that of the other streams, from its first sample on.
        doubts: samples in doubt, in the order of arrival.
        last_number: of its last sample.
        is_last_normal: whether that one was accepted.
        lags_ns: of accepted samples: how far ahead of all streams their stamps were, the last few.
        is_awaited: whether other streams wait for it.
        waiting_ns: stamps of its samples that wait, ascending.
        arrived: number of samples pushed.
        used: number of samples that the estimator got.
        late: of these, those that came after a later one of another stream.
        refused: the others, by reason.
    """

    kind: type
    shift_ns: int = 0
    newest_ns: int | None = None
    newest_arrival_ns: int | None = None
    used_ns: int | None = None
    is_apart: bool = False
    doubts: list[Arrival] = field(default_factory=list)
    last_number: int = -1
    is_last_normal: bool = True
    lags_ns: deque[int] = field(default_factory=lambda: deque(maxlen=_PERIODS))
    is_awaited: bool = True
    waiting_ns: list[int] = field(default_factory=list)
    arrived: int = 0
    used: int = 0
    late: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    _periods_ns: deque[int] = field(default_factory=lambda: deque(maxlen=_PERIODS))
    _period_ns: int | None = None
    _recent: deque[int] = field(default_factory=deque)
    _recent_set: set[int] = field(default_factory=set)

    @property
    def name(self) -> str:
        """Of the stream."""
        return STREAM_NAMES[self.kind]

    @property
    def is_of_images(self) -> bool:
        """Whether its samples are frames or tracks, for which nothing waits."""
        return self.kind in IMAGE_SENSORS

    @property
    def period_ns(self) -> int | None:
        """Median of the last few periods; None while too few are known."""
        return self._period_ns

    @property
    def lag_ns(self) -> int:
        """How far ahead of all streams its stamps usually are, median; 0 while unknown."""
        return sorted(self.lags_ns)[len(self.lags_ns) // 2] if self.lags_ns else 0

    def is_suddenly_ahead(self, lag_ns: int) -> bool:
        """Whether a sample is further ahead of all streams than those before it; False while these are few."""
        if len(self.lags_ns) < _FEWEST_PERIODS:
            return False
        spread_ns = max(self.lags_ns) - min(self.lags_ns)
        return lag_ns - self.lag_ns > max(_LEAST_AHEAD_NS, _TIMES_SPREAD * spread_ns)

    @property
    def status(self) -> StreamStatus:
        """What became of its samples."""
        held = len(self.waiting_ns) + len(self.doubts)
        return StreamStatus(self.name, self.arrived, self.used, self.late, held, dict(self.refused))

    def is_repeated(self, stamp_ns: int) -> bool:
        """Whether a stamp, by the clock of the estimator, has been accepted before."""
        return stamp_ns in self._recent_set

    def accept(self, stamp_ns: int, arrival_ns: int | None) -> None:
        """Take note of an accepted stamp, by the clock of the estimator."""
        if self.newest_ns is None or stamp_ns > self.newest_ns:
            self.newest_ns, self.newest_arrival_ns = stamp_ns, arrival_ns
        self._recent.append(stamp_ns)
        self._recent_set.add(stamp_ns)
        if len(self._recent) > _RECENT:
            self._recent_set.discard(self._recent.popleft())

    def use(self, stamp_ns: int) -> None:
        """Take note of a sample that goes to the estimator."""
        self.used += 1
        if self.used_ns is not None:
            self._periods_ns.append(stamp_ns - self.used_ns)
            if len(self._periods_ns) >= _FEWEST_PERIODS:
                self._period_ns = sorted(self._periods_ns)[len(self._periods_ns) // 2]
        self.used_ns = stamp_ns

    def leave_out(self, reason: str) -> None:
        """The last sample that was to go to the estimator does not: its stamp is right, its content is not wanted."""
        self.used -= 1
        self.refused[reason] += 1

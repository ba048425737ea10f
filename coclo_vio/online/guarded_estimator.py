# SPDX-License-Identifier: BSD-3-Clause
"""Any estimator, made to survive what drivers do to stamps: late, repeated and impossible ones, clocks that step.

Samples in; ``ClockFollower`` refuses outliers and follows clocks that stepped; ``ReorderBuffer`` puts the others in
order; the estimator gets them by a clock that never steps; its outputs go out by the clock of the samples, and in the
world that ``reset`` and ``reanchor`` choose.
"""

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

from coclo_vio.online.clock_follower import Accepted, ClockFollower, ClockStep, Decision, Refused
from coclo_vio.online.config import OnlineConfig
from coclo_vio.online.fault_episodes import FaultEpisodes
from coclo_vio.online.joint_thinning import JointThinning
from coclo_vio.online.output_frame import OutputFrame
from coclo_vio.online.reading_watch import ReadingWatch
from coclo_vio.online.reorder_buffer import ReorderBuffer
from coclo_vio.online.stream_watch import StreamWatch
from coclo_vio.online.world_anchor import checked_pose
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import CocloError
from coclo_vio.values.measurements import Measurement
from coclo_vio.values.outputs import (
    ClockStepEvent,
    Estimator,
    Event,
    Interruptible,
    Learning,
    Output,
    Settling,
    Status,
)
from coclo_vio.values.units import NS_PER_S


class GuardedEstimator:
    """An estimator behind a guard; on samples in order it gives what the estimator alone gives, in the same order.

    Invariant: of each stream ``arrived == used + held + refused``; the estimator gets no stamp that is not newer than
    the last one of its stream.
    """

    def __init__(
        self, make: Callable[[], Estimator], config: OnlineConfig | None = None, *, is_levelled: bool = True
    ) -> None:
        """Make the estimator.

        Args:
            make: gives a fresh one.
            config: limits of stamps and latencies.
            is_levelled: whether it has roll and pitch from gravity.
        """
        self._make = make
        self._prepare: Callable[[Measurement], Measurement] | None = None
        self._estimator = make()
        self._config = config or OnlineConfig()
        self._follower = ClockFollower(self._config)
        self._buffer = ReorderBuffer(self._config.latency, self._follower.streams)
        self._watch, self._readings = StreamWatch(self._config), ReadingWatch(self._config)
        self._thinning = JointThinning(self._config.joint_interval_s)
        self._faults, self._frame = FaultEpisodes(), OutputFrame(is_levelled=is_levelled)
        self._counted: Counter[str] = Counter()
        self._ended: Counter[str] = Counter()  # counts of estimators before a reset
        self._events: list[Event] = []  # of calls between pushes
        self._span_ns: tuple[int, int] | None = None
        self._status_ns: int | None = None
        self._error: CocloError | None = None

    @property
    def counts(self) -> Mapping[str, int]:
        """What the estimator counted, and here samples refused by stream and reason, late ones, steps and resets."""
        streams = self._follower.streams.values()
        refused = {f"{of.name}_{reason}": count for of in streams for reason, count in of.refused.items()}
        late = {f"{of.name}_late_used": of.late for of in streams if of.late}
        of_estimators = dict(self._estimator.counts)
        for name, count in self._ended.items():
            of_estimators[name] = of_estimators.get(name, 0) + count
        return {**of_estimators, **refused, **late, **self._counted}

    @property
    def estimator(self) -> Estimator:
        """The estimator behind the guard; another one after ``reset``."""
        return self._estimator

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Earliest and latest stamp of the samples that the estimator got, by its clock; None before any."""
        return self._span_ns

    @property
    def status(self) -> Status:
        """What became of all samples so far, stream by stream."""
        now_ns = self._follower.now_ns
        return Status(
            0 if now_ns is None else self._frame.stamp_ns(now_ns),
            tuple(stream.status for stream in self._follower.streams.values()),
        )

    def push(self, measurement: Measurement, arrival_ns: int | None = None) -> Sequence[Output]:
        """Take one sample; the outputs that it leads to, in order.

        Args:
            measurement: as a driver gives it.
            arrival_ns: when it came, by a clock that never steps, such as ``time.monotonic_ns()``; the same for all
                samples or for none. Without it only the order of arrival is known.

        Raises:
            CocloError: the estimator cannot go on, whatever the stamps.
        """
        self._raise_error()
        return self._collected(self._decided(self._follower.take(measurement, arrival_ns), arrival_ns))

    def finish(self) -> Iterator[Output]:
        """The outputs of samples that wait for others, and all that the estimator holds back; take them all.

        Raises:
            CocloError: the estimator cannot go on.
        """
        yield from self._collected(self._decided(self._follower.finish(), None))
        self._raise_error()
        yield from self._collected(self._used(self._buffer.flush()))
        self._raise_error()
        yield from map(self._frame.moved, self._estimator.finish())
        yield from map(self._frame.moved, self._faults.finish())
        if self._config.status_every_s:
            yield self.status

    def settle(self) -> None:
        """Wait for what the estimator does in another thread, so that its state can be kept."""
        if isinstance(self._estimator, Settling):
            self._estimator.settle()

    def prepare_with(self, prepare: Callable[[Measurement], Measurement]) -> None:
        """Change each sample before the estimator gets it, in the order in which it does.

        Args:
            prepare: gives the sample that the estimator gets, such as one with velocities that its driver lacks.
        """
        self._prepare = prepare

    def reset(self, pose: Array | None = None, covariance: Array | None = None) -> None:
        """Start anew: velocity, contacts, footholds, keyframes and landmarks are forgotten.

        Biases, leg constants and errors of the cameras are kept where the estimator learns them, and so are clocks and
        waiting samples. The estimator waits for a standstill again, or starts on the move.

        Args:
            pose: ``T_world_body`` of the first estimate to come, (4, 4); the last one given out if None. With gravity
                its roll and pitch are measured, and position and heading are taken.
            covariance: of its right/local error [rotation rad, position m], (6, 6); the last one given out if neither
                is given, zero if only the pose is.

        Raises:
            ConfigError: no pose, or no covariance.
        """
        where = self._frame.last_pose if pose is None else checked_pose(pose, covariance)
        if pose is None and covariance is not None and where is not None:
            where = checked_pose(where[0], covariance)
        learnt = self._estimator.learnt if isinstance(self._estimator, Learning) else {}
        with suppress(CocloError):  # an estimator that failed may fail again
            deque(self._estimator.finish(), maxlen=0)  # ends its processes; what it held back is of the past
        self._ended.update(self._estimator.counts)
        self._estimator = self._make()
        if isinstance(self._estimator, Learning):
            self._estimator.start_with(learnt)
        self._frame.anchor_next(where)
        self._counted["reset"] += 1
        kept = f"kept are {', '.join(learnt)}" if learnt else "nothing learnt is kept"
        detail = f"the estimator starts anew at the {'last' if pose is None else 'given'} pose; {kept}"
        self._events.append(Event(self._follower.now_ns or 0, "reset", detail))

    def reanchor(self, pose: Array, covariance: Array | None = None) -> None:
        """Choose the world anew: the last estimate gets this pose, and the estimator goes on as it is.

        Args:
            pose: ``T_world_body``, (4, 4); with gravity only its position and heading are taken.
            covariance: of its right/local error, (6, 6); zero if None.

        Raises:
            ConfigError: no pose, or no covariance.
        """
        self._frame.anchor_now(checked_pose(pose, covariance))
        self._counted["reanchored"] += 1
        detail = "the last estimate has the given position and heading; what follows is relative to it"
        self._events.append(Event(self._follower.now_ns or 0, "reanchored", detail))

    def _collected(self, outputs: Iterable[Output]) -> Sequence[Output]:
        """All outputs; where the estimator fails, those before, and the error comes with the next call."""
        collected: list[Output] = []
        try:
            for output in outputs:
                collected.append(self._frame.moved(output))
        except CocloError as error:
            if not collected:
                raise
            self._error = error
        return collected

    def _raise_error(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def _decided(self, decisions: Iterator[Decision], arrival_ns: int | None) -> Iterator[Output]:
        if self._events:
            events, self._events = self._events, []
            yield from events
        for decision in decisions:
            match decision:
                case Accepted():
                    yield from self._take(decision)
                case Refused():
                    self._refuse(decision)
                case ClockStep():
                    yield from self._step(decision)
        now_ns = self._follower.now_ns
        if now_ns is None:
            return
        yield from self._used(self._buffer.due(now_ns if arrival_ns is None else arrival_ns))
        yield from self._faults.over(now_ns)
        yield from self._watch.look(self._follower.streams.values(), now_ns)
        yield from self._status_due(now_ns)

    def _take(self, sample: Accepted) -> Iterator[Output]:
        arrival = sample.arrival
        if arrival.stream.is_apart:  # there is no order with the others
            arrival.stream.use(sample.stamp_ns)
            yield from self._used(iter((sample,)))
            return
        time_ns = self._follower.now_ns if arrival.arrival_ns is None else arrival.arrival_ns
        self._buffer.push(sample, sample.stamp_ns if time_ns is None else time_ns)

    def _used(self, samples: Iterator[Accepted]) -> Iterator[Output]:
        for sample in samples:
            measurement, stamp_ns = sample.arrival.measurement, sample.stamp_ns
            yield from self._readings.take(measurement, stamp_ns)
            if self._readings.amiss is not None:
                sample.arrival.stream.leave_out(self._readings.amiss)
                continue
            if self._thinning.leaves_out(measurement, stamp_ns):
                sample.arrival.stream.leave_out("thinned")
                continue
            first_ns, last_ns = self._span_ns or (stamp_ns, stamp_ns)
            self._span_ns = min(first_ns, stamp_ns), max(last_ns, stamp_ns)
            if stamp_ns != measurement.stamp_ns:
                measurement = replace(measurement, stamp_ns=stamp_ns)
            if self._prepare is not None:
                measurement = self._prepare(measurement)
            yield from self._estimator.push(measurement)

    def _refuse(self, refused: Refused) -> None:
        if refused.reason == "unknown_kind":
            self._counted["unknown_kind"] += 1
        self._faults.add(refused, self._follower.now_ns or 0)

    def _step(self, step: ClockStep) -> Iterator[Output]:
        """Everything before is used first; then a new epoch begins."""
        yield from self._used(self._buffer.flush())
        self._counted["clock_step"] += 1
        direction = "forward" if step.step_ns > 0 else "back"
        whose = "all streams" if step.is_of_all else " and ".join(step.streams)
        consequence = "its samples are moved to the clock of the others"
        if step.is_of_all:
            is_wider = isinstance(self._estimator, Interruptible) and self._estimator.interrupt(step.gap_sigma_s)
            if not is_wider:
                self._frame.widen(step.gap_sigma_s)
            self._frame.step(step.at_ns, step.step_ns)
            consequence = (
                "outputs are stamped by the new clock from here on, and the covariance allows for "
                f"{step.gap_sigma_s:g} s of unknown motion (online.step_gap_s)"
            )
        detail = (
            f"the clock of {whose} stepped {direction} by {abs(step.step_ns) / NS_PER_S:.6g} s at {step.from_ns} ns, "
            f"recognised by {step.samples} samples: {consequence}"
        )
        if step.is_of_all:
            yield ClockStepEvent(step.at_ns, "clock_step", detail, step.at_ns, step.step_ns)
        else:
            yield Event(step.at_ns, "clock_step", detail)

    def _status_due(self, now_ns: int) -> Iterator[Output]:
        every_ns = round(self._config.status_every_s * NS_PER_S)
        if not every_ns:
            return
        if self._status_ns is None:
            self._status_ns = now_ns
        if now_ns - self._status_ns >= every_ns:
            self._status_ns = now_ns
            yield replace(self.status, stamp_ns=now_ns)

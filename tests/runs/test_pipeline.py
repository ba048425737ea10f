# SPDX-License-Identifier: BSD-3-Clause
"""A recording through an estimator: outputs in order, counts, times, and what an error leaves."""

import time
from collections.abc import Iterable, Iterator, Mapping

import numpy as np
import pytest

from coclo_vio.runs import pipeline
from coclo_vio.values.errors import ConfigError, DatasetError, FilterError
from coclo_vio.values.estimates import NavState, StateEstimate
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample, Measurement
from coclo_vio.values.outputs import Estimate, Event, KeyframeHealth, Output


class Counting:
    """An estimate at each joint sample, an event at each IMU sample and at the end; an error at one stamp."""

    def __init__(self, fails_at_ns: int | None = None) -> None:
        self._fails_at_ns = fails_at_ns
        self._estimates = 0

    @property
    def counts(self) -> Mapping[str, int]:
        return {"joint_samples": self._estimates}

    def push(self, measurement: Measurement) -> Iterable[Output]:
        if measurement.stamp_ns == self._fails_at_ns:
            raise FilterError(f"lost at {measurement.stamp_ns} ns")
        if isinstance(measurement, ImuSample):
            return (Event(measurement.stamp_ns, "shaken", "it shook"),)
        if not isinstance(measurement, JointSample):
            return ()
        self._estimates += 1
        nav = NavState(np.eye(4), *(np.zeros(3) for _ in range(4)))
        return (Estimate("counted", StateEstimate(measurement.stamp_ns, nav, np.eye(9))),)

    def finish(self) -> Iterable[Output]:
        return (Event(0, "finished", "no measurement comes any more"),)


def _measurements(count: int) -> list[Measurement]:
    """Three sensors in turn, 1 ms apart."""
    kinds = (
        lambda stamp_ns: FootForceSample(stamp_ns, np.zeros(4)),
        lambda stamp_ns: ImuSample(stamp_ns, np.zeros(3), np.zeros(3)),
        lambda stamp_ns: JointSample(stamp_ns, np.zeros(12), np.zeros(12), np.zeros(12)),
    )
    return [kinds[number % 3](5_000_000 + 1_000_000 * number) for number in range(count)]


def stamps_of(outputs: Iterable[Output]) -> list[int]:
    return [output.state.stamp_ns for output in outputs if isinstance(output, Estimate)]


def test_every_output_is_handed_on_in_order() -> None:
    taken: list[Output] = []
    summary = pipeline.run(Counting(), _measurements(9), taken.append)
    assert [type(output) for output in taken] == [Event, Estimate] * 3 + [Event]
    assert stamps_of(taken) == [7_000_000, 10_000_000, 13_000_000]
    assert (summary.measurements, summary.estimates, summary.failure) == (9, {"counted": 3}, None)
    assert summary.recording_ns == (5_000_000, 13_000_000)
    assert summary.estimated_until_ns == 13_000_000
    assert summary.counts == {"joint_samples": 3}


def test_events_are_kept_and_those_of_the_end_are_too() -> None:
    summary = pipeline.run(Counting(), _measurements(9), lambda _: None)
    assert [(event.kind, event.stamp_ns) for event in summary.events] == [
        *(("shaken", stamp_ns) for stamp_ns in (6_000_000, 9_000_000, 12_000_000)),
        ("finished", 0),
    ]


def test_an_estimator_that_fails_keeps_what_it_had_and_is_not_finished() -> None:
    taken: list[Output] = []
    summary = pipeline.run(Counting(fails_at_ns=11_000_000), _measurements(12), taken.append)
    assert summary.failure == "lost at 11000000 ns"
    assert stamps_of(taken) == [7_000_000, 10_000_000]
    assert (summary.measurements, summary.estimates) == (6 + 1, {"counted": 2})
    assert summary.counts == {"joint_samples": 2}
    assert {event.kind for event in summary.events} == {"shaken"}


def test_a_recording_that_breaks_off_keeps_what_came_before() -> None:
    def broken() -> Iterator[Measurement]:
        yield from _measurements(4)
        raise DatasetError("line 5: mend it")

    taken: list[Output] = []
    summary = pipeline.run(Counting(), broken(), taken.append)
    assert (summary.failure, len(stamps_of(taken))) == ("line 5: mend it", 1)


def test_outputs_before_an_error_within_one_measurement_are_kept() -> None:
    """An estimator may compute each output only when it is taken."""

    class Lazy(Counting):
        def push(self, measurement: Measurement) -> Iterator[Output]:
            yield Event(measurement.stamp_ns, "before", "the error")
            raise FilterError("and then it is lost")

    summary = pipeline.run(Lazy(), _measurements(3), lambda _: None)
    assert [event.kind for event in summary.events] == ["before"]
    assert (summary.measurements, summary.failure) == (1, "and then it is lost")


def test_an_error_at_the_end_is_a_failure_after_its_outputs() -> None:
    class FailingAtTheEnd(Counting):
        def finish(self) -> Iterator[Output]:
            yield from super().finish()
            raise FilterError("lost at the end")

    summary = pipeline.run(FailingAtTheEnd(), _measurements(3), lambda _: None)
    assert (summary.events[-1].kind, summary.failure) == ("finished", "lost at the end")


def test_an_output_that_is_refused_ends_the_run() -> None:
    def refuse(output: Output) -> None:
        if isinstance(output, Estimate):
            raise ConfigError(f"no trajectory {output.name}")

    summary = pipeline.run(Counting(), _measurements(9), refuse)
    assert (summary.measurements, summary.failure) == (3, "no trajectory counted")


def test_unexpected_errors_are_not_swallowed() -> None:
    class Faulty(Counting):
        def push(self, measurement: Measurement) -> Iterable[Output]:
            raise KeyError("bug")

    with pytest.raises(KeyError):
        pipeline.run(Faulty(), _measurements(1), lambda _: None)


def test_progress_gets_every_stamp() -> None:
    stamps_ns: list[int] = []
    pipeline.run(Counting(), _measurements(5), lambda _: None, stamps_ns.append)
    assert stamps_ns == [sample.stamp_ns for sample in _measurements(5)]


def test_the_real_time_factor_is_recording_over_computing_as_far_as_there_are_estimates() -> None:
    """An IMU that goes on long after the cameras makes no estimator faster."""
    summary = pipeline.RunSummary(3, {}, (1_000_000_000, 50_000_000_000), 0.5, {}, None, (), 5_000_000_000)
    assert summary.realtime_factor == pytest.approx(8.0)


@pytest.mark.parametrize("is_lazy", [False, True])
def test_computing_is_what_the_estimator_spends_until_its_outputs_are_taken_and_nothing_else(
    is_lazy: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a clock of this test: 1 s for each measurement, 100 s for whoever takes an output."""
    now_s = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now_s[0])

    def work(stamp_ns: int) -> Iterator[Output]:
        now_s[0] += 0.25
        yield Event(stamp_ns, "worked", "for a second")
        now_s[0] += 0.75

    class Working(Counting):
        def push(self, measurement: Measurement) -> Iterable[Output]:
            outputs = work(measurement.stamp_ns)
            return outputs if is_lazy else list(outputs)

    def take(output: Output) -> None:
        now_s[0] += 100.0

    summary = pipeline.run(Working(), _measurements(3), take)
    assert len(summary.events) == 4
    assert summary.compute_s == pytest.approx(3.0)


def test_an_empty_recording_has_no_extent_and_no_real_time_factor() -> None:
    summary = pipeline.run(Counting(), [], lambda _: None)
    assert summary.recording_ns is None
    assert summary.realtime_factor is None


def test_stamps_out_of_order_still_give_the_extent() -> None:
    summary = pipeline.run(Counting(), reversed(_measurements(4)), lambda _: None)
    assert summary.recording_ns == (5_000_000, 8_000_000)


def test_outputs_are_handed_on_before_the_next_measurement_is_read() -> None:
    """Memory stays flat: nothing but events is kept."""
    taken: list[Output] = []

    class Healthy(Counting):
        def push(self, measurement: Measurement) -> Iterable[Output]:
            return (KeyframeHealth(measurement.stamp_ns, 1, 2, 3, 4, 0.5, 6, 0.007, 8.0),)

    def reading() -> Iterator[Measurement]:
        for number, measurement in enumerate(_measurements(5)):
            assert len(taken) == number
            yield measurement

    assert pipeline.run(Healthy(), reading(), taken.append).measurements == 5

# SPDX-License-Identifier: BSD-3-Clause
from collections.abc import Iterator, Mapping

import numpy as np
import pytest

from coclo_vio.runs import pipeline
from coclo_vio.values.errors import DatasetError, FilterError
from coclo_vio.values.estimates import NavState, StateEstimate
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample, Measurement
from coclo_vio.values.outputs import Event, KeyframeHealth


class Counting:
    """An estimator that answers joint samples, and fails at one of them."""

    def __init__(self, fails_at_ns: int | None = None) -> None:
        self._fails_at_ns = fails_at_ns
        self._answered = 0

    @property
    def counts(self) -> Mapping[str, int]:
        return {"answered": self._answered}

    def push(self, measurement: Measurement) -> StateEstimate | None:
        if measurement.stamp_ns == self._fails_at_ns:
            raise FilterError(f"lost at {measurement.stamp_ns} ns")
        if not isinstance(measurement, JointSample):
            return None
        self._answered += 1
        nav = NavState(np.eye(4), *(np.zeros(3) for _ in range(4)))
        return StateEstimate(measurement.stamp_ns, nav, np.eye(9))


def _measurements(count: int) -> list[Measurement]:
    """Three sensors in turn, 1 ms apart."""
    kinds = (
        lambda stamp_ns: FootForceSample(stamp_ns, np.zeros(4)),
        lambda stamp_ns: ImuSample(stamp_ns, np.zeros(3), np.zeros(3)),
        lambda stamp_ns: JointSample(stamp_ns, np.zeros(12), np.zeros(12), np.zeros(12)),
    )
    return [kinds[number % 3](5_000_000 + 1_000_000 * number) for number in range(count)]


def test_every_estimate_is_handed_on_in_order() -> None:
    taken: list[StateEstimate] = []
    summary = pipeline.run(Counting(), _measurements(9), taken.append)
    assert [estimate.stamp_ns for estimate in taken] == [7_000_000, 10_000_000, 13_000_000]
    assert (summary.measurements, summary.estimates, summary.failure) == (9, 3, None)
    assert summary.recording_ns == (5_000_000, 13_000_000)
    assert summary.counts == {"answered": 3}


def test_an_estimator_that_fails_keeps_what_it_had() -> None:
    taken: list[StateEstimate] = []
    summary = pipeline.run(Counting(fails_at_ns=11_000_000), _measurements(12), taken.append)
    assert summary.failure == "lost at 11000000 ns"
    assert [estimate.stamp_ns for estimate in taken] == [7_000_000, 10_000_000]
    assert (summary.measurements, summary.estimates) == (6, 2)
    assert summary.counts == {"answered": 2}


def test_a_recording_that_breaks_off_keeps_what_came_before() -> None:
    def broken() -> Iterator[Measurement]:
        yield from _measurements(4)
        raise DatasetError("line 5: mend it")

    taken: list[StateEstimate] = []
    summary = pipeline.run(Counting(), broken(), taken.append)
    assert (summary.failure, len(taken)) == ("line 5: mend it", 1)


def test_errors_that_nobody_foresaw_are_not_swallowed() -> None:
    class Faulty(Counting):
        def push(self, measurement: Measurement) -> StateEstimate | None:
            raise KeyError("bug")

    with pytest.raises(KeyError):
        pipeline.run(Faulty(), _measurements(1), lambda _: None)


def test_progress_hears_every_stamp() -> None:
    heard: list[int] = []
    pipeline.run(Counting(), _measurements(5), lambda _: None, heard.append)
    assert heard == [sample.stamp_ns for sample in _measurements(5)]


def test_the_real_time_factor_is_recording_over_computing_as_far_as_there_are_estimates() -> None:
    """An IMU that goes on long after the cameras makes no estimator faster."""
    summary = pipeline.RunSummary(3, 1, (1_000_000_000, 50_000_000_000), 0.5, {}, None, (), 5_000_000_000)
    assert summary.realtime_factor == pytest.approx(8.0)
    assert pipeline.run(Counting(), _measurements(10), lambda _: None).estimated_until_ns == 13_000_000


def test_an_empty_recording_has_no_extent_and_no_real_time_factor() -> None:
    summary = pipeline.run(Counting(), [], lambda _: None)
    assert summary.recording_ns is None
    assert summary.realtime_factor is None


def test_stamps_out_of_order_still_give_the_extent() -> None:
    summary = pipeline.run(Counting(), reversed(_measurements(4)), lambda _: None)
    assert summary.recording_ns == (5_000_000, 8_000_000)


class Diarist(Counting):
    """Has an event at every IMU sample and a keyframe at every joint sample; forgets what was taken."""

    def __init__(self, fails_at_ns: int | None = None) -> None:
        super().__init__(fails_at_ns)
        self.events: list[Event] = []
        self.health: list[KeyframeHealth] = []
        self.most_kept = 0

    def push(self, measurement: Measurement) -> StateEstimate | None:
        if isinstance(measurement, ImuSample):
            self.events.append(Event(measurement.stamp_ns, "shaken", "it shook"))
        if isinstance(measurement, JointSample):
            self.health.append(KeyframeHealth(measurement.stamp_ns, 1, 2, 3, 4, 0.5, 6, 0.007, 8.0))
        self.most_kept = max(self.most_kept, len(self.events) + len(self.health))
        return super().push(measurement)

    def take_events(self) -> tuple[Event, ...]:
        taken, self.events = tuple(self.events), []
        return taken

    def take_health(self) -> tuple[KeyframeHealth, ...]:
        taken, self.health = tuple(self.health), []
        return taken


@pytest.mark.parametrize("fails_at_ns", [None, 12_000_000])
def test_what_an_estimator_tells_of_itself_is_taken_at_once(fails_at_ns: int | None) -> None:
    diarist, health = Diarist(fails_at_ns), []
    summary = pipeline.run(diarist, _measurements(9), lambda _: None, keep_health=health.append)
    assert [event.stamp_ns for event in summary.events] == [6_000_000, 9_000_000, 12_000_000]
    assert [one.stamp_ns for one in health] == [7_000_000, 10_000_000, 13_000_000][: 2 if fails_at_ns else 3]
    assert diarist.most_kept == 1


def test_an_estimator_without_a_diary_has_no_events() -> None:
    assert pipeline.run(Counting(), _measurements(9), lambda _: None, keep_health=pytest.fail).events == ()

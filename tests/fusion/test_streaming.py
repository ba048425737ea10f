# SPDX-License-Identifier: BSD-3-Clause
"""Outputs of estimators: eager at a push, none lost by an error, all of what waits at the end."""

from collections.abc import Iterator

import numpy as np
import pytest
from stand_ins import MS, state_at, tracks

from coclo_vio.fusion.image_clock import ImageClock
from coclo_vio.fusion.streaming import StreamingEstimator
from coclo_vio.values.errors import FilterError
from coclo_vio.values.measurements import ImuSample, Measurement, StereoTracks
from coclo_vio.values.outputs import Estimate, Event, Output


class Echo(StreamingEstimator):
    """An estimate for each frame; fails within the frame of a stamp, after an event."""

    def __init__(self, clock: ImageClock | None = None, fails_at_ms: int | None = None) -> None:
        super().__init__(clock)
        self._fails_at_ms = fails_at_ms
        self.processed_ms: list[int] = []

    def _process(self, measurement: Measurement) -> Iterator[Output]:
        self.processed_ms.append(measurement.stamp_ns // MS)
        if not isinstance(measurement, StereoTracks):
            return
        self._counted["frames"] += 1
        if measurement.stamp_ns // MS == self._fails_at_ms:
            yield Event(measurement.stamp_ns, "vision_lost", "before the error")
            raise FilterError(f"lost at {self._fails_at_ms} ms")
        yield Estimate("echo", state_at(measurement.stamp_ns))


def reading(stamp_ms: int) -> ImuSample:
    return ImuSample(stamp_ms * MS, np.zeros(3), np.zeros(3))


def test_a_push_does_its_work_though_its_outputs_are_not_taken() -> None:
    echo = Echo()
    echo.push(tracks(50 * MS))
    assert echo.processed_ms == [50]
    assert echo.counts == {"frames": 1}


def test_outputs_before_an_error_are_returned_and_the_error_comes_with_the_next_push() -> None:
    echo = Echo(fails_at_ms=100)
    assert [type(output) for output in echo.push(tracks(50 * MS))] == [Estimate]
    assert [type(output) for output in echo.push(tracks(100 * MS))] == [Event]
    with pytest.raises(FilterError, match="lost at 100 ms"):
        echo.push(tracks(150 * MS))
    assert echo.processed_ms == [50, 100], "nothing is processed after the error"


def test_frames_before_the_one_that_fails_keep_their_estimates() -> None:
    """Three frames come due with one reading, and the last of them fails."""
    echo = Echo(ImageClock(0.2, waits=True), fails_at_ms=300)
    for stamp_ms in (0, 50, 100):
        assert echo.push(tracks(stamp_ms * MS)) == []
    outputs = echo.push(reading(500))
    assert [type(output) for output in outputs] == [Estimate, Estimate, Event]
    with pytest.raises(FilterError, match="lost at 300 ms"):
        echo.push(reading(505))


def test_an_error_without_outputs_before_it_comes_at_once() -> None:
    class Failing(Echo):
        def _process(self, measurement: Measurement) -> Iterator[Output]:
            raise FilterError("it never starts")
            yield

    with pytest.raises(FilterError, match="it never starts"):
        Failing().push(tracks(0))


def test_the_error_of_the_last_push_comes_with_finish() -> None:
    echo = Echo(fails_at_ms=50)
    echo.push(tracks(50 * MS))
    with pytest.raises(FilterError, match="lost at 50 ms"):
        list(echo.finish())


def test_finish_gives_the_outputs_of_what_waits_and_then_its_error() -> None:
    echo = Echo(ImageClock(0.2, waits=True), fails_at_ms=300)
    for stamp_ms in (0, 50, 100):
        echo.push(tracks(stamp_ms * MS))
    finished: list[Output] = []
    with pytest.raises(FilterError, match="lost at 300 ms"):
        finished.extend(echo.finish())
    assert [type(output) for output in finished] == [Estimate, Estimate, Event]


def test_without_another_clock_nothing_waits_for_finish() -> None:
    echo = Echo()
    assert len(echo.push(tracks(50 * MS))) == 1
    assert list(echo.finish()) == []


def test_counts_are_those_of_the_estimator_and_of_its_clock() -> None:
    echo = Echo(ImageClock(1.0, waits=True))
    for number in range(70):
        echo.push(tracks(number * MS))
    assert echo.counts == {"frames": 6, "not_waited_for_clock": 6}

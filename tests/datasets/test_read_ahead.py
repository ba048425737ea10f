# SPDX-License-Identifier: BSD-3-Clause
import gc
import threading
from collections.abc import Iterator

import numpy as np
import pytest

from coclo_vio.datasets.read_ahead import THREAD_NAME, read_ahead
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.measurements import ImuSample, Measurement


def recorded(count: int, fails_at: int | None = None, taken: list[int] | None = None) -> Iterator[Measurement]:
    for number in range(count):
        if number == fails_at:
            raise DatasetError("the file was cut off")
        if taken is not None:
            taken.append(number)
        yield ImuSample(number, np.zeros(3), np.zeros(3))


def reading_threads() -> list[threading.Thread]:
    return [one for one in threading.enumerate() if one.name == THREAD_NAME]


@pytest.mark.parametrize("most", [1, 7, 1000])
def test_the_measurements_are_the_same_in_the_same_order(most: int) -> None:
    assert [one.stamp_ns for one in read_ahead(recorded(500), most)] == list(range(500))
    assert not reading_threads()


def test_an_error_comes_after_the_measurements_before_it() -> None:
    stamps_ns: list[int] = []
    with pytest.raises(DatasetError, match="cut off"):
        _note(read_ahead(recorded(500, fails_at=300), 50), stamps_ns)
    assert stamps_ns == list(range(300))
    assert not reading_threads()


def _note(measurements: Iterator[Measurement], stamps_ns: list[int]) -> None:
    for one in measurements:
        stamps_ns.append(one.stamp_ns)  # one by one, so that they are kept when reading raises


def test_no_more_than_the_limit_are_read_ahead() -> None:
    taken: list[int] = []
    ahead = read_ahead(recorded(500, taken=taken), 10)
    for _ in range(100):
        next(ahead)
    assert len(taken) <= 100 + 10 + 1
    ahead.close()


def test_a_closed_or_abandoned_iterator_leaves_no_thread_and_closes_the_recording() -> None:
    closed = threading.Event()

    def watched() -> Iterator[Measurement]:
        try:
            yield from recorded(500)
        finally:
            closed.set()

    ahead = read_ahead(watched(), 5)
    assert next(ahead).stamp_ns == 0
    assert len(reading_threads()) == 1
    del ahead
    gc.collect()
    assert not reading_threads()
    assert closed.wait(10.0)


def test_an_interruption_where_measurements_are_taken_leaves_no_thread() -> None:
    with pytest.raises(KeyboardInterrupt):
        _interrupted()
    gc.collect()
    assert not reading_threads()


def _interrupted() -> None:
    for one in read_ahead(recorded(500), 5):
        if one.stamp_ns == 20:
            raise KeyboardInterrupt

# SPDX-License-Identifier: BSD-3-Clause
"""What is played: rounds that go on in time, a limit by stamps, and each measurement when it is due."""

import time

import numpy as np
import pytest

from coclo_vio.runs.paced_source import Pace, in_rounds, limited, paced
from coclo_vio.values.measurements import ImuSample, Measurement
from coclo_vio.values.units import NS_PER_S

START_NS = 1_700_000_000 * NS_PER_S
MS = 1_000_000


def samples(*at_ms: int) -> list[Measurement]:
    return [ImuSample(START_NS + at * MS, np.zeros(3), np.array([0.0, 0.0, 9.81])) for at in at_ms]


def test_a_round_begins_after_a_pause_where_the_last_one_ended() -> None:
    played = list(in_rounds(lambda: iter(samples(0, 10, 30)), Pace(rounds=3, pause_s=0.5)))
    assert [(one.stamp_ns - START_NS) // MS for one in played] == [0, 10, 30, 530, 540, 560, 1060, 1070, 1090]


def test_a_round_without_a_measurement_ends_it() -> None:
    assert list(in_rounds(lambda: iter(()), Pace(rounds=3))) == []


def test_the_limit_is_by_stamps() -> None:
    assert len(list(limited(iter(samples(0, 10, 20, 30)), 0.02))) == 3
    assert len(list(limited(iter(samples(0, 10, 20, 30)), None))) == 4


@pytest.mark.parametrize("rate", [1.0, 4.0])
def test_measurements_come_when_they_are_due(rate: float) -> None:
    begin_ns = time.monotonic_ns()
    for (due_ns, due), at_ms in zip(paced(iter(samples(0, 0, 40, 200)), rate), (0, 40, 200), strict=True):
        assert time.monotonic_ns() >= due_ns
        assert [one.stamp_ns for one in due] == [START_NS + at_ms * MS] * (1 if at_ms else 2)
        if not at_ms:
            first_ns = due_ns
            assert due_ns - begin_ns > 0.2 * NS_PER_S
        assert due_ns - first_ns == pytest.approx(at_ms * MS / rate, abs=1)


def test_a_stamp_far_ahead_or_in_the_past_holds_nothing_up() -> None:
    begin_s = time.monotonic()
    due = [due_ns for due_ns, _ in paced(iter(samples(0, 3_600_000, 20, 40)), 1.0)]
    assert time.monotonic() - begin_s < 3.0
    assert due == sorted(due)


def test_what_is_due_at_one_time_comes_in_small_parts() -> None:
    """More images than the memory has room for may be due at once, as after a clock that was set back."""
    due = [part for _, part in paced(iter(samples(*[0] * 20)), 1.0)]
    assert [len(part) for part in due] == [6, 6, 6, 2]

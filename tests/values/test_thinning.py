# SPDX-License-Identifier: BSD-3-Clause
"""Samples at a lower rate: one an interval, with room for jitter, also after a clock that was set back."""

import pytest

from coclo_vio.values.thinning import Thinning

MS = 1_000_000
T0 = 1_700_000_000_000 * MS


def used(interval_s: float, times_ms: list[float]) -> list[float]:
    thinning = Thinning(interval_s)
    return [at for at in times_ms if not thinning.leaves_out(T0 + round(at * MS))]


@pytest.mark.parametrize(("interval_s", "one_of"), [(0.0, 1), (0.002, 1), (0.003, 2), (0.004, 2), (0.005, 3)])
def test_one_sample_an_interval_is_used(interval_s: float, one_of: int) -> None:
    times_ms = [2.0 * number for number in range(100)]
    assert used(interval_s, times_ms) == times_ms[::one_of]


def test_a_sample_may_come_a_tenth_of_the_interval_too_soon() -> None:
    assert used(0.01, [0.0, 8.999, 9.0, 17.999, 18.0]) == [0.0, 9.0, 18.0]


def test_without_an_interval_samples_of_one_time_are_all_used() -> None:
    assert used(0.0, [0.0, 0.0, 1.0]) == [0.0, 0.0, 1.0]


def test_after_a_clock_that_was_set_back_samples_are_used_again() -> None:
    assert used(0.01, [0.0, 10.0, -5000.0, -4999.0, -4990.0]) == [0.0, 10.0, -5000.0, -4990.0]

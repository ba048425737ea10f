# SPDX-License-Identifier: BSD-3-Clause
"""Rates and gaps of streams, from their stamps alone."""

import numpy as np
import pytest

from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.values.measurements import ImuSample


def tallied(steps_s, gap_s=0.1):
    tally = ReadTally("test", gap_s)
    for time_s in np.cumsum([0.0, *steps_s]):
        tally.count(ImuSample, round(time_s * 1e9))
    return tally.report().streams[0]


@pytest.mark.parametrize("count", [2, 20, 200])
@pytest.mark.parametrize("step_s", [0.005, 0.1001, 0.5, 10.0])
def test_a_steady_stream_has_its_rate_and_no_gap_however_slow_it_is(step_s, count):
    stream = tallied([step_s] * count)
    assert stream.rate_hz == pytest.approx(1.0 / step_s)
    assert stream.gaps == 0


@pytest.mark.parametrize("before", [1, 20, 200])
def test_a_pause_is_a_gap_that_does_not_count_in_the_rate(before):
    stream = tallied([0.01] * before + [0.6] + [0.01] * 50)
    assert (stream.gaps, stream.longest_gap_s) == (1, pytest.approx(0.6))
    assert stream.rate_hz == pytest.approx(100.0)


@pytest.mark.parametrize(("pause_s", "gaps"), [(0.39, 0), (0.41, 0), (0.5, 0), (0.51, 1)])
def test_a_slow_stream_may_pause_for_two_and_a_half_of_its_steps(pause_s, gaps):
    assert tallied([0.2] * 50 + [pause_s]).gaps == gaps


def test_a_fast_stream_may_pause_for_as_long_as_is_configured():
    assert tallied([0.01] * 50 + [0.09]).gaps == 0
    assert tallied([0.01] * 50 + [0.09], gap_s=0.05).gaps == 1


def test_a_stream_of_one_sample_has_no_rate():
    assert tallied([]).rate_hz == 0.0

# SPDX-License-Identifier: BSD-3-Clause
"""Percentiles from a histogram of constant size, against those of all values."""

import os
from pathlib import Path

import numpy as np
import pytest

from coclo_vio.runs.latency import DurationHistogram
from coclo_vio.runs.process_load import ProcessLoad


def test_percentiles_are_right_to_one_percent() -> None:
    durations = np.random.default_rng(2).lognormal(14.0, 1.5, 20_000).astype(np.int64)
    histogram = DurationHistogram()
    for duration_ns in durations.tolist():
        histogram.add(duration_ns)
    spread = histogram.spread()
    for share, found_ms in ((50, spread.p50_ms), (95, spread.p95_ms), (99, spread.p99_ms)):
        assert found_ms == pytest.approx(np.percentile(durations, share) / 1e6, rel=0.012)
    assert spread.max_ms == durations.max() / 1e6
    assert spread.mean_ms == pytest.approx(durations.mean() / 1e6)
    assert spread.count == 20_000


def test_nothing_and_durations_out_of_range_are_no_error() -> None:
    histogram = DurationHistogram()
    assert histogram.spread().p99_ms is None
    for duration_ns in (-5, 0, 10**15):
        histogram.add(duration_ns)
    assert histogram.spread().max_ms == 10**9


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="the system has no /proc")
def test_the_load_of_this_process_and_of_none() -> None:
    load = ProcessLoad(os.getpid())
    np.linalg.svd(np.random.default_rng(0).random((200, 200)))
    taken = load.take()
    assert taken is not None
    assert 10.0 < taken.rss_mb < 1e5
    assert ProcessLoad(2**22 + 1).take() is None

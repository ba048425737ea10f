# SPDX-License-Identifier: BSD-3-Clause
"""Frames that come 50 to 150 ms late are used at their own stamps: nearly as good as frames in time."""

from functools import cache

import numpy as np
import pytest
from test_tight import outputs_of as tight_outputs_of
from test_tight import tight
from walk_among_points import combined, error_m, outputs_of, states, stream

from coclo_vio.values.measurements import Measurement, StereoTracks
from coclo_vio.values.outputs import Output


@cache
def late_stream() -> tuple[Measurement, ...]:
    """Tracks come 50 to 150 ms after their stamp, everything else at once."""
    rng = np.random.default_rng(8)
    arrivals = [
        one.stamp_ns + (round(rng.uniform(50e6, 150e6)) if isinstance(one, StereoTracks) else 0) for one in stream()
    ]
    return tuple(stream()[index] for index in np.argsort(arrivals, kind="stable"))


def run(mode: str, measurements: tuple[Measurement, ...]) -> tuple[dict[str, int], list[Output]]:
    if mode == "combined":
        odometry = combined()
        outputs = outputs_of(odometry, measurements)
        return dict(odometry.counts), outputs
    of_all = tight()
    outputs = tight_outputs_of(of_all, measurements)
    return dict(of_all.counts), outputs


@pytest.mark.long
@pytest.mark.parametrize("mode", ["combined", "tight"])
def test_late_frames_are_used_at_their_own_stamps(mode: str) -> None:
    name = "combined_coclo" if mode == "combined" else "tight"
    counts, outputs = run(mode, late_stream())
    frames = sum(isinstance(one, StereoTracks) for one in stream())
    assert counts.get("frame_late", 0) <= 2, "frames of the time before the filter had started"
    used = frames - sum(counts.get(f"frame_{reason}", 0) for reason in ("before_start", "late", "stamp_refused"))
    assert counts["smoother_frames"] == used > 0.7 * frames
    by_legs = states(outputs, name)
    errors = np.array([error_m(each) for each in by_legs])
    sigmas = np.array([np.sqrt(each.covariance[3:6, 3:6].trace()) for each in by_legs])
    assert errors[-1] < 0.015
    assert (errors < 3.0 * sigmas + 0.003).all()

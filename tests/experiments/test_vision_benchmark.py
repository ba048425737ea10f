# SPDX-License-Identifier: BSD-3-Clause
"""The benchmark of vision times the real stages, on frames in which they track points."""

import numpy as np
import pytest

from coclo_vio.experiments import vision_benchmark
from coclo_vio.values.measurements import CameraImuSample

PROMISED = {
    *("frontend_ms_median", "frontend_ms_p95", "smoother_ms_median", "smoother_ms_p95", "vision_ms_per_frame"),
    *("keyframe_factors", "keyframe_landmarks", "keyframe_iterations"),
}


def test_figures_have_the_names_that_the_command_line_promises() -> None:
    figures = vision_benchmark.vision_figures(until_s=4.0)
    assert set(figures) >= PROMISED
    known = {name: value for name, value in figures.items() if value is not None}
    assert set(known) >= PROMISED
    assert 0.0 < known["frontend_ms_median"] <= known["frontend_ms_p95"] < 1000.0
    assert 0.0 < known["smoother_ms_median"] <= known["smoother_ms_p95"] < 1000.0
    assert known["keyframe_tracks"] > 50
    assert known["keyframe_factors"] > known["keyframe_landmarks"] > 50
    assert 0.0 < known["keyframes_per_frame"] <= 1.0


def test_before_the_first_keyframe_its_figures_are_unknown() -> None:
    figures = vision_benchmark.vision_figures(until_s=0.1)
    assert figures["frontend_ms_median"] is not None
    assert figures["smoother_ms_median"] is None
    assert figures["keyframe_factors"] is None


def test_backwards_the_body_turns_the_other_way_and_weighs_the_same() -> None:
    readings = [
        CameraImuSample(1000 + 10 * n, np.array([0.1, -0.2, 0.3]) * n, np.array([0.0, n, 9.81])) for n in range(3)
    ]
    stream = vision_benchmark._to_and_fro(tuple(readings))
    samples = [next(stream) for _ in range(6)]
    assert [sample.stamp_ns for sample in samples] == [1010, 1020, 1030, 1040, 1050, 1060]
    numbers = [1, 2, 1, 0, 1, 2]
    signs = [1, 1, -1, -1, 1, 1]
    for sample, number, sign in zip(samples, numbers, signs, strict=True):
        assert isinstance(sample, CameraImuSample)
        np.testing.assert_array_equal(sample.angular_velocity, sign * readings[number].angular_velocity)
        np.testing.assert_array_equal(sample.specific_force, readings[number].specific_force)


@pytest.mark.slow
def test_memory_is_flat() -> None:
    held = vision_benchmark.vision_resident_mb(frames=120, samples=3)
    assert len(held) == 4
    assert held[-1] - held[1] < 30.0

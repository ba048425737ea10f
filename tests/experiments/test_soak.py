# SPDX-License-Identifier: BSD-3-Clause
"""A recording played round after round: the record of a few seconds, and the drift of each round."""

from pathlib import Path

import numpy as np
import pytest

import coclo_vio as cv
from coclo_vio.evaluation.figure_style import can_draw
from coclo_vio.experiments.soak.__main__ import soak
from coclo_vio.experiments.soak.soak_figure import plot_soak
from coclo_vio.experiments.soak.soak_record import SoakRecord, growth_of, rounds_of
from coclo_vio.runs.latency import IntervalRecord


@pytest.mark.long
def test_a_soak_plays_rounds_and_measures_each(leg_log: Path, tmp_path: Path) -> None:
    recording = cv.open(leg_log)
    record = soak(recording.path, recording.config, "coclo", minutes=0.05, rate=4.0, output=tmp_path)
    assert record == SoakRecord.read(tmp_path / "soak.json")
    assert record.minutes * 60.0 > 2.5
    assert record.latency.streams["joints"].count > 100
    assert record.is_flat is None  # three seconds say nothing
    if can_draw():
        assert plot_soak(record, tmp_path / "soak.png").stat().st_size > 10_000


@pytest.mark.parametrize(("late", "is_flat"), [(104.0, True), (106.0, False), (50.0, True)])
def test_growth_is_that_of_the_late_intervals_by_the_early_ones(late: float, is_flat: bool) -> None:
    """The first tenth does not count, however large."""
    values = [500.0, *[100.0] * 5, *[late] * 4]
    intervals = [_interval(float(number + 1), value) for number, value in enumerate(values)]
    growth = growth_of(intervals, lambda one: one.push_ms)
    assert growth is not None
    assert (growth.early, growth.late, growth.is_flat) == (100.0, late, is_flat)
    assert growth_of(intervals[:9], lambda one: one.push_ms) is None


def _interval(time_s: float, push_ms: float) -> IntervalRecord:
    return IntervalRecord(
        time_s=time_s,
        length_s=1.0,
        measurements=100,
        push_ms=push_ms,
        latency_p95_ms={},
        waiting_most=1,
        images_left_out=0,
        processes={},
    )


def test_drift_of_a_round_is_seen_from_one_second_after_its_beginning() -> None:
    """Two rounds of one metre forward; the second begins turned, with a short jump, and ends 0.1 m short."""
    second = 1_000_000_000
    truth = _line([0, second, 3 * second], [(0.0, 0.0), (0.0, 0.0), (1.0, 0.0)])
    estimate = _line(
        [number * second for number in (0, 1, 3, 4, 5, 7)],
        [(0.0, 0.0), (0.0, 0.0), (1.0, 0.0), (1.4, 0.0), (1.0, 0.0), (1.0, 0.9)],
        yaws=(0.0, 0.0, 0.0, 70.0, 90.0, 93.0),
    )
    first, other = rounds_of("coclo", estimate, truth, 4 * second)
    assert (first.drift_m, first.yaw_deg) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert (other.number, other.drift_m, other.drift_percent, other.yaw_deg) == pytest.approx((1, 0.1, 10.0, 3.0))


def _line(
    stamps_ns: list[int], places: list[tuple[float, float]], yaws: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> cv.Trajectory:
    poses = np.tile(np.eye(4), (len(stamps_ns), 1, 1))
    poses[:, :2, 3] = places
    angles = np.radians(yaws)
    poses[:, 0, 0] = poses[:, 1, 1] = np.cos(angles)
    poses[:, 1, 0], poses[:, 0, 1] = np.sin(angles), -np.sin(angles)
    return cv.Trajectory(np.array(stamps_ns), poses)

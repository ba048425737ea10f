# SPDX-License-Identifier: BSD-3-Clause
"""Joint samples that a logger stamped on arrival, in bursts, get even stamps; everything else stays."""

from dataclasses import replace

import numpy as np
import pytest

from coclo_vio.datasets.burst_stamps import spread_bursts
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample, Measurement

PERIOD_NS = 10_000_000
Rows = list[tuple[FootForceSample, ImuSample, JointSample]]


def rows_at(stamps_ns: list[int]) -> list[Measurement]:
    """One row of foot forces, IMU and joints for each stamp; the angles count the rows."""
    found: list[Measurement] = []
    for number, stamp_ns in enumerate(stamps_ns):
        found.append(FootForceSample(stamp_ns, np.array([float(number)])))
        found.append(ImuSample(stamp_ns, np.full(3, float(number)), np.zeros(3)))
        found.append(JointSample(stamp_ns, np.array([0.001 * number]), np.zeros(1), np.full(1, np.nan)))
    return found


def with_burst(first: int, count: int, rows: int = 60) -> list[int]:
    """Even stamps, of which ``count`` from row ``first`` on arrive with the last of them, 0.3 ms apart."""
    stamps = [number * PERIOD_NS for number in range(rows)]
    last = first + count - 1
    for number in range(first, last):
        stamps[number] = stamps[last] - (last - number) * 300_000
    return stamps


def spread(measurements: list[Measurement]) -> tuple[list[Measurement], list[str]]:
    notes: list[str] = []
    return list(spread_bursts(measurements, notes.append)), notes


@pytest.mark.parametrize("count", [4, 16])
def test_a_burst_is_spread_over_the_pause_with_its_whole_rows(count: int) -> None:
    found, notes = spread(rows_at(with_burst(30, count)))
    for kind in (FootForceSample, ImuSample, JointSample):
        stamps = np.array([each.stamp_ns for each in found if isinstance(each, kind)])
        assert np.abs(stamps - np.arange(60) * PERIOD_NS).max() <= PERIOD_NS // 100
    stamps = [each.stamp_ns for each in found]
    assert stamps == sorted(stamps)
    assert [note.split(" after")[0] for note in notes] == [f"{count} joint samples came in 1 bursts"]


def test_a_burst_at_the_end_and_two_in_a_row_are_spread() -> None:
    stamps = with_burst(30, 10)
    stamps[45:59] = [stamps[59] - (59 - number) * 300_000 for number in range(45, 59)]
    found, _ = spread(rows_at(stamps))
    joints = np.array([each.stamp_ns for each in found if isinstance(each, JointSample)])
    assert np.abs(joints - np.arange(60) * PERIOD_NS).max() <= PERIOD_NS // 50


def test_an_imu_with_stamps_of_its_own_keeps_them() -> None:
    measurements = [each for each in rows_at(with_burst(30, 10)) if not isinstance(each, ImuSample)]
    own = [ImuSample(number * 2_500_000 + 7, np.zeros(3), np.zeros(3)) for number in range(239)]
    found, _ = spread(sorted([*measurements, *own], key=lambda each: each.stamp_ns))
    assert [each.stamp_ns for each in found if isinstance(each, ImuSample)] == [each.stamp_ns for each in own]
    stamps = [each.stamp_ns for each in found]
    assert stamps == sorted(stamps)


def test_a_pause_without_the_samples_that_it_lacks_stays() -> None:
    stamps = [number * PERIOD_NS for number in range(60)]
    measurements = rows_at([*stamps[:30], *stamps[45:]])
    assert spread(measurements) == (measurements, [])


def test_held_readings_stay() -> None:
    measurements = rows_at(with_burst(30, 10))
    held = [replace(each, position=np.zeros(1)) if isinstance(each, JointSample) else each for each in measurements]
    assert spread(held) == (held, [])


def test_uneven_stamps_stay() -> None:
    rng = np.random.default_rng(0)
    measurements = rows_at(np.cumsum(rng.integers(4_000_000, 24_000_000, 200)).tolist())
    assert spread(measurements) == (measurements, [])


def test_samples_without_joints_pass() -> None:
    measurements = [each for each in rows_at(with_burst(30, 10)) if isinstance(each, ImuSample)] * 100
    assert spread(measurements) == (measurements, [])

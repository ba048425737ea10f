# SPDX-License-Identifier: BSD-3-Clause
"""An IMU that is stuck and a gyroscope at its limit are reported once, with their end, and their readings left out."""

import numpy as np
import pytest
from damaged_streams import MS, NotingEstimator, S, imu, joints, recorded

from coclo_vio.datasets.sequencer import sort_measurements
from coclo_vio.online.config import OnlineConfig
from coclo_vio.online.guarded_estimator import GuardedEstimator
from coclo_vio.online.reading_watch import ReadingWatch
from coclo_vio.values.measurements import ImuSample, Measurement
from coclo_vio.values.outputs import Event

T0 = 1_700_000_000 * S
KINDS = ("reading_constant", "reading_changes", "reading_saturated", "reading_in_range")
STEP = 0.000533  # rad/s: of a converter of 16 bits over +-1000 deg/s


def reported(measurements: list[Measurement], **values: float) -> list[Event]:
    guard = GuardedEstimator(NotingEstimator, OnlineConfig(**values))
    outputs = [output for measurement in measurements for output in guard.push(measurement)]
    return [output for output in [*outputs, *guard.finish()] if isinstance(output, Event) and output.kind in KINDS]


def stuck(start_s: float, end_s: float) -> list[Measurement]:
    held = None
    rows: list[Measurement] = []
    for each in recorded():
        if isinstance(each, ImuSample):
            is_stuck = start_s * S <= each.stamp_ns - T0 < end_s * S
            held = each if held is None or not is_stuck else held
            each = ImuSample(each.stamp_ns, held.angular_velocity, held.specific_force)  # noqa: PLW2901
        rows.append(each)
    return rows


def test_an_imu_that_repeats_its_reading_is_reported_and_so_is_its_end() -> None:
    stops, goes_on = reported(stuck(2.0, 3.0))
    assert (stops.kind, goes_on.kind) == ("reading_constant", "reading_changes")
    assert stops.detail.startswith("imu has given the same reading 6 times in a row, to the bit")
    assert (stops.stamp_ns - T0) / S == pytest.approx(2.025, abs=0.01)
    assert goes_on.detail == "imu gives new readings again, after 1 s of one reading"


def test_a_reading_that_comes_a_few_times_or_never_changes_is_not_reported() -> None:
    assert reported(stuck(2.0, 2.02)) == []
    assert reported(stuck(2.0, 3.0), constant_readings=0) == []
    stamps = [T0 + number * 5 * MS for number in range(600)]
    assert reported(list(sort_measurements([*map(imu, stamps), *map(joints, stamps)]))) == [], "made by hand"


def test_an_imu_that_is_published_more_often_than_it_measures_is_not_stuck() -> None:
    rows = recorded()
    held: ImuSample | None = None
    for number, each in enumerate([row for row in rows if isinstance(row, ImuSample)]):
        held = each if number % 5 == 0 else held
        assert held is not None
        rows[rows.index(each)] = ImuSample(each.stamp_ns, held.angular_velocity, held.specific_force)
    assert reported(rows) == []


def test_readings_of_an_imu_that_is_stuck_do_not_reach_the_estimator() -> None:
    rows = stuck(2.0, 3.0)
    guard = GuardedEstimator(NotingEstimator)
    for row in rows:
        guard.push(row)
    guard.finish()
    count = guard.counts["imu_constant"]
    assert 190 <= count <= 196, "of 200, those after the sixth"


def shaken(limit: float, *, seconds: float = 12.0, start_s: float = 0.0, step: float = STEP) -> list[ImuSample]:
    """A body that trots at 500 Hz, in steps of a converter, clipped from a time on."""
    noise, readings = np.random.default_rng(3), []
    for number in range(round(seconds * 500)):
        time_s = number / 500
        moving = min(1.0, time_s)
        rate = moving * np.array([0.5, 0.6, 0.2]) * np.sin(2.0 * np.pi * np.array([1.9, 2.3, 0.7]) * time_s)
        rate = np.round((rate + noise.normal(0.0, 0.003, 3)) / step) * step
        if time_s >= start_s:
            rate = np.clip(rate, -limit, limit)
        readings.append(ImuSample(T0 + number * 2 * MS, rate, noise.normal([0.0, 0.0, 9.81], 0.05)))
    return readings


def left_out(readings: list[ImuSample], **values: bool) -> tuple[np.ndarray, list[Event]]:
    """Which readings are, (n,), and the events."""
    watch, amiss, events = ReadingWatch(OnlineConfig(**values)), [], []
    for reading in readings:
        events += watch.take(reading, reading.stamp_ns)
        amiss.append(watch.amiss == "saturated")
    return np.array(amiss), events


@pytest.mark.long
@pytest.mark.parametrize("limit", [0.1, 0.3, 0.45])
@pytest.mark.parametrize("start_s", [0.0, 5.0])
def test_readings_at_the_limit_of_a_gyroscope_are_found_and_left_out(limit: float, start_s: float) -> None:
    readings = shaken(limit, start_s=start_s)
    is_left_out, events = left_out(readings)
    stamps = np.array([each.stamp_ns - T0 for each in readings]) / S
    is_clipped = np.array([np.abs(each.angular_velocity).max() >= limit for each in readings]) & (stamps >= start_s)
    assert not (is_left_out & ~is_clipped).any()
    first = stamps[np.flatnonzero(is_clipped)[0]]
    assert is_left_out[is_clipped & (stamps > first + 1.5)].all(), "found within a few steps of the gait"
    assert events[0].kind == "reading_saturated"
    assert f"stays at {limit:.4g} rad/s to the bit" in events[0].detail


def test_where_the_limit_is_exceeded_it_was_none() -> None:
    readings = [*shaken(0.2, seconds=4.0), *shaken(9.0, seconds=8.0)[1000:]]
    stamped = [
        ImuSample(T0 + number * 2 * MS, each.angular_velocity, each.specific_force)
        for number, each in enumerate(readings)
    ]
    is_left_out, events = left_out(stamped)
    assert [event.kind for event in events] == ["reading_saturated", "reading_in_range"]
    assert not is_left_out[2000 + 500 :].any()
    assert "is within its range again; " in events[1].detail


@pytest.mark.long
@pytest.mark.parametrize("step", [1e-9, STEP, 0.005, 0.02])
def test_a_gyroscope_within_its_range_has_no_limit(step: float) -> None:
    """Coarse converters repeat values, and so do the turning points of a regular gait."""
    is_left_out, events = left_out(shaken(9.0, seconds=30.0, step=step))
    assert not is_left_out.any()
    assert not events


def test_the_search_for_a_limit_can_be_switched_off() -> None:
    is_left_out, events = left_out(shaken(0.1), leaves_out_saturated=False)
    assert not is_left_out.any()
    assert not events


def test_saturated_readings_do_not_reach_the_estimator_and_are_counted() -> None:
    guard = GuardedEstimator(NotingEstimator)
    for reading in shaken(0.1):
        guard.push(reading)
    guard.finish()
    assert guard.counts["imu_saturated"] > 3000
    assert guard.status.streams[0].refused["saturated"] == guard.counts["imu_saturated"]

# SPDX-License-Identifier: BSD-3-Clause
"""Frames on another clock: everything comes out on the IMU's clock, in order, and all of it."""

import numpy as np
import pytest

from coclo_vio.fusion.image_clock import ImageClock
from coclo_vio.values.measurements import CameraImuSample, Measurement, StereoTracks

MS = 1_000_000


def reading(stamp_ms: float) -> CameraImuSample:
    return CameraImuSample(round(stamp_ms * MS), np.zeros(3), np.zeros(3))


def tracks(stamp_ms: float) -> StereoTracks:
    return StereoTracks(round(stamp_ms * MS), np.zeros(0, dtype=np.int64), np.zeros((0, 2)), np.zeros((0, 2)))


def recording(until_ms: int = 400) -> list[Measurement]:
    """Readings at 200 Hz and frames at 20 Hz in the order of their stamps."""
    samples = [*(reading(5 * n) for n in range(until_ms // 5)), *(tracks(50 * n) for n in range(until_ms // 50))]
    return sorted(samples, key=lambda sample: (sample.stamp_ns, isinstance(sample, StereoTracks)))


@pytest.mark.parametrize("offset_ms", [0, 3, 7, 50, 120, -3, -7, -50, -120])
def test_everything_comes_out_in_order_on_one_clock(offset_ms: int) -> None:
    clock = ImageClock(offset_ms * 1e-3, waits=True)
    out = [due for sample in recording() for due in clock.push(sample)]
    stamps = [(one.stamp_ns, isinstance(one, StereoTracks)) for one in out]
    assert stamps == sorted(stamps)
    frames_ms = [one.stamp_ns / MS for one in out if isinstance(one, StereoTracks)]
    assert frames_ms == [50.0 * n + offset_ms for n in range(len(frames_ms))]
    assert len(recording()) - len(out) <= abs(offset_ms) / 5 + abs(offset_ms) / 50 + 1
    assert clock.counts["not_waited_for_clock"] == 0


@pytest.mark.parametrize("offset_ms", [0, 60, 200, -7, -200])
def test_all_that_waits_comes_out_at_the_end(offset_ms: int) -> None:
    clock = ImageClock(offset_ms * 1e-3, waits=True)
    due = [one for sample in recording() for one in clock.push(sample)]
    rest = list(clock.finish())
    assert len(due) + len(rest) == len(recording())
    assert bool(rest) == (offset_ms != 0)
    stamps = [(one.stamp_ns, isinstance(one, StereoTracks)) for one in (*due, *rest)]
    assert stamps == sorted(stamps)
    assert list(clock.finish()) == []


def test_a_frame_waits_until_the_imu_has_come_as_far() -> None:
    clock = ImageClock(0.012, waits=True)
    assert list(clock.push(tracks(100))) == []
    for stamp_ms in (105, 110):
        assert [type(one) for one in clock.push(reading(stamp_ms))] == [CameraImuSample]
    after = list(clock.push(reading(115)))
    assert [(type(one), one.stamp_ns // MS) for one in after] == [(StereoTracks, 112), (CameraImuSample, 115)]


def test_others_need_not_wait_for_frames_that_are_stamped_late() -> None:
    clock = ImageClock(-0.2, waits=True, holds_others=False)
    out = [each.stamp_ns / MS for sample in (reading(1005), tracks(1010), reading(1015)) for each in clock.push(sample)]
    assert out == [1005.0, 810.0, 1015.0]


def test_where_nothing_else_is_used_nothing_waits() -> None:
    clock = ImageClock(0.5, waits=False)
    assert [one.stamp_ns for one in clock.push(tracks(100))] == [600 * MS]


@pytest.mark.parametrize("offset_s", [1.0, -1.0])
def test_no_more_than_so_many_are_held(offset_s: float) -> None:
    """Frames at a kilohertz, or readings at ten: more than a second of them is not waited for."""
    clock = ImageClock(offset_s, waits=True)
    samples = [tracks(n) for n in range(1000)] if offset_s > 0 else [reading(0.1 * n) for n in range(9000)]
    held = most = 0
    for sample in samples:
        held += 1 - len(list(clock.push(sample)))
        most = max(most, held)
    assert 10 < most <= (64 if offset_s > 0 else 4096)
    assert clock.counts["not_waited_for_clock"] == len(samples) - held


@pytest.mark.parametrize(("offset_ms", "shift_ms"), [(0, -30), (0, 30), (20, -20), (-40, 55)])
def test_a_shift_holds_for_frames_that_come_later_and_loses_none(offset_ms: int, shift_ms: int) -> None:
    clock = ImageClock(offset_ms * 1e-3, waits=True)
    out: list[Measurement] = []
    for sample in recording():
        if sample.stamp_ns == 200 * MS and isinstance(sample, StereoTracks):
            clock.shift(shift_ms * 1e-3)
        out += clock.push(sample)
    out += clock.finish()
    assert len(out) == len(recording())
    frames_ms = sorted(one.stamp_ns / MS for one in out if isinstance(one, StereoTracks))
    assert frames_ms == sorted(50.0 * n + offset_ms + shift_ms * (n >= 4) for n in range(8))
    late = [one.stamp_ns for one in out if one.stamp_ns > 300 * MS]
    assert late == sorted(late)

# SPDX-License-Identifier: BSD-3-Clause
"""Faults of rotation through the combined estimator with a window that measures nothing: events, and what is done."""

import re
from collections.abc import Iterable

import numpy as np
import pytest
from rotating_walk import (
    stream,
    trial,
    turned_rig,
    with_late_images,
    with_offset_gyroscope,
    with_reversed_gyroscope,
)
from stand_ins import NotingSmoother
from walk_among_points import DAISY, outputs_of, states

from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.fusion.combined import CombinedOdometry
from coclo_vio.fusion.rotation_check import RotationCheck
from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.measurements import ImuSample, Measurement, StereoTracks
from coclo_vio.values.outputs import Event, Output
from coclo_vio.values.units import NS_PER_S

IMU_ROTATION = DAISY.description.imu.T_body_imu[:3, :3]


class Run:
    """Combined odometry on measurements, by cameras whose calibration is turned; events of the stand-in left out."""

    def __init__(self, measurements: Iterable[Measurement], turn: Array) -> None:
        self.filter, self.smoother = LegOdometryFilter(DAISY, remembers_frames=True), NotingSmoother()
        check = RotationCheck(turned_rig(turn), IMU_ROTATION)
        odometry = CombinedOdometry(self.filter, self.smoother, None, check=check)
        self.outputs: list[Output] = outputs_of(odometry, measurements)
        self.counts = odometry.counts
        self.events = [each for each in self.outputs if isinstance(each, Event) and each.kind != "vision_lost"]
        self.last = states(self.outputs, "combined_coclo")[-1]

    @property
    def kinds(self) -> list[str]:
        return [each.kind for each in self.events]

    @property
    def attitude_error_rad(self) -> float:
        """Of the last estimate from the truth, whose heading at the start is that of the estimate's world."""
        truth = trial().truth
        start = so3.about_z(float(so3.yaw(truth.T_world_body[0][:3, :3])))
        row = min(int(np.searchsorted(truth.stamps_ns, self.last.stamp_ns)), len(truth.stamps_ns) - 1)
        off = (start.T @ truth.T_world_body[row][:3, :3]).T @ self.last.nav.T_world_body[:3, :3]
        return float(np.linalg.norm(so3.log(off)))

    def starts_anew_after(self, event: Event) -> bool:
        start = self.smoother.start
        return start is not None and event.stamp_ns < start.stamp_ns < event.stamp_ns + 0.3 * NS_PER_S


@pytest.mark.long
def test_nothing_happens_where_all_is_well() -> None:
    run = Run(stream(), np.zeros(3))
    assert run.kinds == []
    assert run.smoother.start is not None
    assert run.smoother.start.stamp_ns < NS_PER_S


@pytest.mark.long
def test_a_turned_mounting_is_reported_and_becomes_the_filters_prior() -> None:
    turn = np.radians([-1.7, 1.7, 1.7])
    run = Run(stream(), turn)
    assert run.kinds == ["camera_mounting_off"]
    assert "0.23 deg is expected" in run.events[0].detail
    assert run.starts_anew_after(run.events[0])
    found = run.filter.camera_calibration(run.last.stamp_ns)
    assert np.linalg.norm(found.rotation_body - turn) < np.radians(1.0)
    assert 0.02 < found.rotation_sigma.min() < found.rotation_sigma.max() < 0.04


def test_late_stamps_of_images_are_reported_and_corrected_from_then_on() -> None:
    run = Run(with_late_images(stream(), 0.03), np.zeros(3))
    assert run.kinds == ["image_delay"]
    assert run.starts_anew_after(run.events[0])
    recorded = [one.stamp_ns for one in stream() if isinstance(one, StereoTracks)]
    last = next(each for each in reversed(run.smoother.pushed) if isinstance(each, StereoTracks))
    assert min(abs(last.stamp_ns - stamp_ns) for stamp_ns in recorded) < 0.006 * NS_PER_S


def test_a_small_delay_behind_the_images_becomes_that_of_the_gyroscope() -> None:
    run = Run(with_late_images(stream(), -0.006), np.zeros(3))
    assert run.kinds == []
    delay = run.filter.imu_delay
    assert delay is not None
    assert abs(delay.by_legs_s) < 0.003
    assert 0.004 < delay.value_s < 0.007


def test_an_offset_of_the_gyroscope_is_reported_and_taken_out_of_bias_and_attitude() -> None:
    run = Run(with_offset_gyroscope(stream(), 5.5, np.full(3, 0.05)), np.zeros(3))
    assert run.kinds == ["gyroscope_offset"]
    assert run.starts_anew_after(run.events[0])
    bias = IMU_ROTATION @ (trial().gyroscope_bias[-1] + 0.05)
    np.testing.assert_allclose(run.last.nav.gyroscope_bias, bias, atol=0.01)
    assert run.attitude_error_rad < 0.04
    assert np.linalg.norm(se3.log(run.last.nav.T_world_body)[3:]) > 0.3


@pytest.mark.long
@pytest.mark.parametrize("delay_s", [0.4, -0.4])
def test_a_large_delay_of_images_is_found_by_search_and_corrected(delay_s: float) -> None:
    run = Run(with_late_images(stream(), delay_s), np.zeros(3))
    assert run.kinds == ["image_delay"]
    found = re.search(r"stamps of images are (\S+) \+- 5.0 ms (late|early)", run.events[0].detail)
    assert found is not None
    assert float(found[1]) == pytest.approx(400.0, abs=10.0)
    assert found[2] == ("late" if delay_s > 0.0 else "early")
    recorded = [one.stamp_ns for one in stream() if isinstance(one, StereoTracks)]
    last = next(each for each in reversed(run.smoother.pushed) if isinstance(each, StereoTracks))
    assert min(abs(last.stamp_ns - stamp_ns) for stamp_ns in recorded) < 0.02 * NS_PER_S


def test_an_imu_of_wrong_sign_is_set_aside_and_used_again_when_it_is_right() -> None:
    run = Run(with_reversed_gyroscope(stream(), 4.5, 6.5), np.zeros(3))
    events = [each for each in run.events if each.kind.startswith(("imu", "gyroscope"))]
    kinds = ["imu_set_aside", "gyroscope_offset", "imu_set_aside", "imu_used_again", "imu_used_again"]
    assert [each.kind for each in events] == kinds
    by_gravity, _, aside, *ends = events  # the filter leaves it out by itself, and cameras undo the harm
    assert "accelerometer" in by_gravity.detail
    assert by_gravity.stamp_ns < 4.8 * NS_PER_S
    (again,) = (each for each in ends if "agrees with the cameras" in each.detail)
    assert "was off by another amount" in aside.detail
    assert run.starts_anew_after(aside)
    assert again.stamp_ns > 6.5 * NS_PER_S
    left_out = run.counts["imu_set_aside"] / trial_rate()
    assert left_out == pytest.approx((again.stamp_ns - aside.stamp_ns) / NS_PER_S, abs=0.05)
    assert run.attitude_error_rad < 0.04


def trial_rate() -> float:
    """Readings of the IMU in a second."""
    stamps = [one.stamp_ns for one in stream() if isinstance(one, ImuSample)]
    return (len(stamps) - 1) / (stamps[-1] - stamps[0]) * NS_PER_S

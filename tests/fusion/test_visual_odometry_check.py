# SPDX-License-Identifier: BSD-3-Clause
"""Visual-inertial odometry whose cameras have another clock, or another mounting, than their calibration says."""

import re
from collections.abc import Iterable

import numpy as np
import pytest
from rotating_walk import stream, trial, turned_rig, with_late_images, with_reversed_gyroscope
from walk_among_points import DAISY, outputs_of, states

from coclo_vio.backend.window.config import PixelNoiseConfig, SmootherConfig
from coclo_vio.backend.window.inertial_source import InertialSource
from coclo_vio.backend.window.smoother import SlidingWindowSmoother
from coclo_vio.fusion.rotation_check import RotationCheck
from coclo_vio.fusion.visual_odometry import VisualOdometry
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.measurements import ImuSample, Measurement
from coclo_vio.values.outputs import Event, Output
from coclo_vio.values.units import NS_PER_S

IMU = DAISY.description.imu
WALK = SmootherConfig(noise=PixelNoiseConfig(ample_tracks=1))  # few tracks, all of points of the world


def run(measurements: Iterable[Measurement], turn: Array | None = None, *, checks: bool = True) -> list[Output]:
    rig = turned_rig(np.zeros(3) if turn is None else turn)
    smoother = SlidingWindowSmoother(rig, WALK, IMU, [InertialSource(IMU, WALK)])
    check = RotationCheck(rig, IMU.T_body_imu[:3, :3]) if checks else None
    return outputs_of(VisualOdometry("vins", smoother, None, imu_kind=ImuSample, check=check), measurements)


def events(outputs: Iterable[Output]) -> list[Event]:
    return [each for each in outputs if isinstance(each, Event)]


def error_m(state: StateEstimate) -> float:
    """Distance from the truth."""
    truth = trial().truth
    row = min(int(np.searchsorted(truth.stamps_ns, state.stamp_ns)), len(truth.stamps_ns) - 1)
    start = truth.T_world_body[0]
    turned = so3.about_z(float(so3.yaw(start[:3, :3]))) @ state.nav.T_world_body[:3, 3]
    return float(np.linalg.norm(turned + start[:3, 3] - truth.T_world_body[row][:3, 3]))


def tilt_rms_rad(outputs: list[Output], since_ns: int) -> float:
    """Root mean square error of the upward direction."""
    truth, squared = trial().truth, []
    for state in states(outputs, "vins"):
        row = int(np.searchsorted(truth.stamps_ns, state.stamp_ns))
        if state.stamp_ns >= since_ns and row < len(truth.stamps_ns):
            up, true_up = state.nav.T_world_body[2, :3], truth.T_world_body[row][2, :3]
            squared.append(float((up - true_up) @ (up - true_up)))
    return float(np.sqrt(np.mean(squared)))


@pytest.mark.long
def test_nothing_is_found_where_clock_and_mounting_are_right() -> None:
    assert events(run(stream())) == []


@pytest.mark.long
@pytest.mark.parametrize("late_s", [0.06, -0.06, 0.4])
def test_a_delay_is_reported_and_corrected_and_the_window_starts_anew(late_s: float) -> None:
    late = with_late_images(stream(), late_s)
    corrected, as_they_come = run(late), run(late, checks=False)
    found = [event for event in events(corrected) if not event.kind.startswith("vision_")]
    assert [event.kind for event in found] == ["image_delay", "window_restart"]
    measured = re.search(r"are ([\d.]+) \+- [\d.]+ ms (late|early)", found[0].detail)
    assert measured is not None
    assert float(measured[1]) == pytest.approx(1e3 * abs(late_s), abs=10.0)
    assert measured[2] == ("late" if late_s > 0.0 else "early")
    assert found[1].stamp_ns > found[0].stamp_ns - 1_000_000_000
    stamps = [state.stamp_ns for state in states(corrected, "vins")]
    assert np.all(np.diff(stamps) > 0)
    settled_ns = found[0].stamp_ns + 1_000_000_000
    assert tilt_rms_rad(corrected, settled_ns) < 0.5 * tilt_rms_rad(as_they_come, settled_ns)


@pytest.mark.long
def test_an_imu_that_contradicts_the_cameras_is_set_aside_until_it_agrees() -> None:
    """All its axes have the wrong sign for 4 s; without a comparison gravity turns the path over."""
    reversed_imu = with_reversed_gyroscope(stream(), 3.0, 7.0)
    compared, as_they_come = run(reversed_imu), run(reversed_imu, checks=False)
    kinds = [event.kind for event in events(compared) if event.kind.startswith("imu_") and event.kind != "imu_gap"]
    assert kinds == ["imu_set_aside", "imu_used_again"]
    aside, again = (event for event in events(compared) if event.kind in {"imu_set_aside", "imu_used_again"})
    assert 3.0 < aside.stamp_ns / NS_PER_S < 7.0 < again.stamp_ns / NS_PER_S
    assert error_m(states(compared, "vins")[-1]) < 0.2 * error_m(states(as_they_come, "vins")[-1])


@pytest.mark.long
def test_a_turned_mounting_is_reported() -> None:
    turn = np.radians([-1.7, 1.7, 1.7])
    found = [event for event in events(run(stream(), turn)) if event.kind == "camera_mounting_off"]
    assert len(found) == 1
    assert "mend the cameras' calibration" in found[0].detail

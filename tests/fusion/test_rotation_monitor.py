# SPDX-License-Identifier: BSD-3-Clause
"""Faults of rotation through the combined estimator and the tight one: one event each, and the estimate holds."""

from collections.abc import Iterable

import numpy as np
import pytest
from rotating_walk import stream, trial, turned_rig, with_late_images, with_offset_gyroscope
from walk_among_points import DAISY, NOISE_PX, outputs_of, states

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.leg_source import LegSource
from coclo_vio.backend.window.smoother import SlidingWindowSmoother
from coclo_vio.filter.leg_preintegration import start_block
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.fusion.combined import CombinedOdometry
from coclo_vio.fusion.rotation_check import RotationCheck
from coclo_vio.fusion.streaming import StreamingEstimator
from coclo_vio.fusion.tight import TightOdometry
from coclo_vio.fusion.vision_chain import Smoother
from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.leg_motion import LegState
from coclo_vio.values.measurements import Measurement
from coclo_vio.values.outputs import Calibration, Event, Output

SMOOTHER = SmootherConfig.parse({"noise": {"track_px": NOISE_PX, "disparity_px": NOISE_PX}}, "test")


def combined(rig: RectifiedStereo, *, checks: bool = True) -> CombinedOdometry:
    leg_filter = LegOdometryFilter(DAISY, remembers_frames=True)
    check = RotationCheck(rig, leg_filter.imu_rotation) if checks else None
    return CombinedOdometry(leg_filter, SlidingWindowSmoother(rig, SMOOTHER), None, check=check)


def tight(rig: RectifiedStereo) -> TightOdometry:
    leg_filter = LegOdometryFilter(DAISY, extra_blocks=[start_block(len(DAISY.leg_names))])

    def make_smoother(state: LegState, rotation: Array) -> tuple[Smoother, LegSource]:
        source = LegSource(state)
        turned = rig.moved(se3.transform(rotation.T, np.zeros(3)))
        return SlidingWindowSmoother(turned, SMOOTHER, sources=[source]), source

    return TightOdometry(leg_filter, make_smoother, None, check=RotationCheck(rig, leg_filter.imu_rotation))


def run(odometry: StreamingEstimator, measurements: Iterable[Measurement]) -> list[Output]:
    return outputs_of(odometry, measurements)  # type: ignore[arg-type]


def kinds(outputs: list[Output]) -> list[str]:
    return [each.kind for each in outputs if isinstance(each, Event)]


def error_m(outputs: list[Output], name: str) -> float:
    """Distance of the last estimate from the truth, whose start is that of the estimate's world."""
    last, truth = states(outputs, name)[-1], trial().truth
    start = truth.T_world_body[0]
    T_start = se3.transform(so3.about_z(float(so3.yaw(start[:3, :3]))), start[:3, 3])
    row = int(np.searchsorted(truth.stamps_ns, last.stamp_ns))
    T_true = se3.inverse(T_start) @ truth.T_world_body[min(row, len(truth.stamps_ns) - 1)]
    return float(np.linalg.norm(last.nav.T_world_body[:3, 3] - T_true[:3, 3]))


def test_the_comparison_changes_nothing_where_all_is_well() -> None:
    rig = turned_rig(np.zeros(3))
    with_check, without = run(combined(rig), stream()), run(combined(rig, checks=False), stream())
    assert kinds(with_check) == kinds(without) == []
    last, other = (states(outputs, "combined_coclo")[-1] for outputs in (with_check, without))
    np.testing.assert_array_equal(last.nav.T_world_body, other.nav.T_world_body)


def test_combined_finds_and_absorbs_a_turned_mounting() -> None:
    turn = np.radians([-1.7, 1.7, 1.7])
    outputs = run(combined(turned_rig(turn)), stream())
    assert kinds(outputs) == ["camera_mounting_off", "window_restart"]
    found = [each for each in outputs if isinstance(each, Calibration)][-1]
    assert np.linalg.norm(found.rotation_body - turn) < np.radians(0.7)
    without = run(combined(turned_rig(turn), checks=False), stream())
    assert error_m(outputs, "combined_coclo") < 0.5 * error_m(without, "combined_coclo")
    assert error_m(outputs, "combined_coclo") < 0.02


def test_combined_corrects_late_stamps_of_images() -> None:
    outputs = run(combined(turned_rig(np.zeros(3))), with_late_images(stream(), 0.03))
    assert kinds(outputs)[:2] == ["image_delay", "window_restart"]
    assert kinds(outputs).count("image_delay") == 1
    assert error_m(outputs, "combined_coclo") < 0.02


@pytest.mark.parametrize("mode", ["combined", "tight"])
def test_an_offset_of_the_gyroscope_is_absorbed(mode: str) -> None:
    rig, faulty = turned_rig(np.zeros(3)), with_offset_gyroscope(stream(), 5.5, np.full(3, 0.05))
    outputs = run(combined(rig) if mode == "combined" else tight(rig), faulty)
    name = "combined_coclo" if mode == "combined" else "tight"
    assert kinds(outputs).count("gyroscope_offset") == 1
    assert error_m(outputs, name) < 0.025
    bias = DAISY.description.imu.T_body_imu[:3, :3] @ (trial().gyroscope_bias[-1] + 0.05)
    np.testing.assert_allclose(states(outputs, name)[-1].nav.gyroscope_bias, bias, atol=0.004)


def test_tight_finds_and_absorbs_a_turned_mounting() -> None:
    turn = np.radians([-1.7, 1.7, 1.7])
    outputs = run(tight(turned_rig(turn)), stream())
    assert kinds(outputs) == ["camera_mounting_off"]
    found = [each for each in outputs if isinstance(each, Calibration)][-1]
    assert np.linalg.norm(found.rotation_body - turn) < np.radians(0.7)
    assert error_m(outputs, "tight") < 0.02

# SPDX-License-Identifier: BSD-3-Clause
"""Rotations by cameras, gyroscope and feet compared on an analytic walk: silent where all is well, else it is named."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from rotating_walk import (
    in_order,
    stream,
    trial,
    turned_rig,
    with_late_images,
    with_moving_scene,
    with_offset_gyroscope,
)
from walk_among_points import DAISY

from coclo_vio.fusion.rotation_check import RotationCheck
from coclo_vio.fusion.rotation_findings import (
    CameraMounting,
    Finding,
    GyroscopeOffset,
    ImageDelay,
    VisionAgrees,
    VisionSuspect,
)
from coclo_vio.robot.leg_sensing import LegSensing
from coclo_vio.robot.standstill import StandstillConfig
from coclo_vio.values.arrays import Array
from coclo_vio.values.measurements import ImuSample, JointSample, Measurement, StereoTracks
from coclo_vio.values.units import NS_PER_S

IMU_ROTATION = DAISY.description.imu.T_body_imu[:3, :3]


def findings(
    measurements: Iterable[Measurement], turn: Array, *, has_legs: bool = True, gyroscope_delay_s: float = 0.0
) -> list[tuple[float, Finding]]:
    """What is found, with its time in seconds; a filter follows what is found of the gyroscope."""
    check = RotationCheck(turned_rig(turn), IMU_ROTATION)
    check.gyroscope_delay_s = gyroscope_delay_s
    sensing = LegSensing(DAISY, DAISY.description.contact, StandstillConfig(), force_timeout_s=0.1)
    bias = IMU_ROTATION @ trial().gyroscope_bias[0]
    found: list[tuple[float, Finding]] = []
    for one in measurements:
        match one:
            case ImuSample():
                check.push_gyroscope(one)
            case StereoTracks():
                finding = check.push_tracks(one, bias)
                if finding is not None:
                    found.append((one.stamp_ns / NS_PER_S, finding))
                if isinstance(finding, GyroscopeOffset):
                    bias = finding.bias
        reading = sensing.push(one, None) if has_legs else None
        if reading is not None and isinstance(one, JointSample):
            check.push_feet(reading.stamp_ns, reading.feet.position_body, reading.is_stance)
    return found


@pytest.mark.long
def test_nothing_is_found_where_all_is_well() -> None:
    assert findings(stream(), np.zeros(3)) == []


def test_a_small_error_of_the_mounting_is_none_to_report() -> None:
    assert findings(stream(), np.radians([0.2, -0.2, 0.1])) == []


@pytest.mark.parametrize("degrees", [(3.0, 0.0, 0.0), (-1.7, 1.7, 1.7), (0.0, 0.0, 5.0)])
def test_a_turned_mounting_is_found(degrees: tuple[float, float, float]) -> None:
    turn = np.radians(degrees)
    ((_, finding),) = findings(stream(), turn)
    assert isinstance(finding, CameraMounting)
    off = finding.rotation - turn
    assert off @ np.linalg.solve(finding.covariance, off) < 16.3  # 0.999 of chi-square with three degrees of freedom
    assert np.linalg.norm(off) < np.radians(1.0)


def test_late_images_are_found() -> None:
    ((_, finding),) = findings(with_late_images(stream(), 0.03), np.zeros(3))[:1]
    assert isinstance(finding, ImageDelay)
    assert finding.delay_s == pytest.approx(0.03, abs=0.005)


def test_a_delay_of_the_gyroscope_that_the_legs_know_is_none_of_the_images() -> None:
    late = in_order(
        replace(one, stamp_ns=one.stamp_ns + 30_000_000) if isinstance(one, ImuSample) else one for one in stream()
    )
    assert findings(late, np.zeros(3), gyroscope_delay_s=0.03) == []
    ((_, finding),) = findings(late, np.zeros(3))[:1]
    assert isinstance(finding, ImageDelay)
    assert finding.delay_s == pytest.approx(-0.03, abs=0.011), "without the legs"


@pytest.mark.parametrize("offset", [(0.05, 0.05, 0.05), (0.0, 0.0, -0.08), (0.0, 0.04, 0.0)])
def test_an_offset_of_the_gyroscope_is_distinguished_from_wrong_cameras_by_the_legs(offset: tuple[float, ...]) -> None:
    ((at_s, finding),) = findings(with_offset_gyroscope(stream(), 5.5, np.array(offset)), np.zeros(3))
    assert isinstance(finding, GyroscopeOffset)
    assert 5.5 < at_s < 6.5
    assert finding.witness == "legs"
    assert finding.start_ns <= 5.5 * NS_PER_S
    np.testing.assert_allclose(finding.change, IMU_ROTATION @ np.array(offset), atol=0.01)


def test_without_a_third_sensor_nobody_is_named() -> None:
    faulty = with_offset_gyroscope(stream(), 5.5, np.full(3, 0.05))
    ((_, finding),) = findings(faulty, np.zeros(3), has_legs=False)
    assert isinstance(finding, VisionSuspect)
    assert finding.witness is None


def test_a_scene_that_turns_makes_the_cameras_suspect_until_they_agree_again() -> None:
    turning = [one for one in with_moving_scene(stream(), 5.5, 0.1) if one.stamp_ns < 6.5 * NS_PER_S]
    still = [one for one in stream() if one.stamp_ns >= 6.5 * NS_PER_S]
    found = [finding for _, finding in findings([*turning, *still], np.zeros(3))]
    assert isinstance(found[0], VisionSuspect)
    assert found[0].witness == "legs"
    assert isinstance(found[-1], VisionAgrees)
    assert len(found) == 2

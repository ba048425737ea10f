# SPDX-License-Identifier: BSD-3-Clause
"""What each mode lacks of its needs: nothing where a recording has everything, otherwise the lack by name."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tiny_recordings import tiny_cameras

from coclo_vio.datasets.read_report import ReadReport, StreamReport
from coclo_vio.geometry import se3
from coclo_vio.robot.description import load_robot
from coclo_vio.runs.equipment import Equipment
from coclo_vio.runs.mode_requirements import Holdings, camera_angle_deg, missing_needs
from coclo_vio.runs.modes.mode import Mode, Need
from coclo_vio.runs.modes.registry import mode_of, modes
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.calibration import ImuCalibration, SensorCalibrations, StereoCalibration, matrix4
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.outputs import Estimator
from coclo_vio.values.units import NS_PER_S

DAISY, GO1 = load_robot("daisy"), load_robot("go1")
ALL_STREAMS = ("joints", "imu", "foot_force", "stereo", "camera_imu", "body_twist")


def report(*streams: str, start_s: float = 0.0) -> ReadReport:
    return ReadReport("made", tuple(stream(name, start_s) for name in streams), {}, ())


def stream(name: str, start_s: float) -> StreamReport:
    start_ns = round(start_s * NS_PER_S)
    return StreamReport(name, 11, 10.0, start_ns, start_ns + NS_PER_S, 0, 0.1, start_ns, 0, 0, 0)


def opposite_cameras() -> StereoCalibration:
    T_body_behind = se3.transform(np.diag([-1.0, 1.0, -1.0]), np.array([0.3, 0.0, 0.0]))
    return tiny_cameras().model_copy(update={"body_right_camera": matrix4(T_body_behind)})


CALIBRATIONS = SensorCalibrations(stereo=tiny_cameras(), imu=ImuCalibration(), camera_imu=ImuCalibration())
EVERYTHING = Holdings(DAISY, report(*ALL_STREAMS), (), True, True, CALIBRATIONS, False, "a robot")
NO_STEREO = replace(CALIBRATIONS, stereo=None)
NO_IMU = replace(CALIBRATIONS, imu=None, camera_imu=None)

LACKS: dict[Need, list[tuple[dict[str, Any], str]]] = {
    Need.LEGS: [
        ({"robot": None, "robot_hint": "a robot (name one with --robot)"}, "a robot (name one with --robot)"),
        ({"missing_joints": ("knee", "hip")}, "2 of daisy's 18 joints"),
        ({"fits_urdf": False}, "a description of daisy that fits its URDF (see problems)"),
        ({"report": report("imu", "stereo", "camera_imu", "body_twist")}, "joint samples"),
        ({"has_effort": False}, "joint torques, from which daisy's contacts are estimated"),
        (
            {"robot": GO1, "report": report("joints", "imu", "stereo", "camera_imu", "body_twist")},
            "foot forces, from which go1's contacts are estimated",
        ),
        ({"report": report("joints", "stereo", "camera_imu", "body_twist")}, "the body's IMU"),
    ],
    Need.CAMERAS: [
        ({"report": report("joints", "imu", "camera_imu", "body_twist")}, "stereo images"),
        ({"calibrations": NO_STEREO}, "calibration of the cameras"),
        (
            {"calibrations": replace(CALIBRATIONS, stereo=opposite_cameras())},
            "cameras that look in the same direction",
        ),
    ],
    Need.IMU: [
        ({"report": report("joints", "stereo", "body_twist")}, "an IMU"),
        ({"robot": None, "calibrations": NO_IMU}, "the mounting of its IMU"),
    ],
    Need.BODY_TWIST: [
        (
            {"report": report("joints", "imu", "stereo", "camera_imu")},
            "a body twist: the body's velocities, measured by another source",
        ),
    ],
}


def unmade(equipment: Equipment, config: RunConfig) -> Estimator:
    raise ConfigError("it is only declared")


def mode_needing(*needs: Need) -> Mode:
    return Mode("toy", "", frozenset(needs), unmade)


@pytest.mark.parametrize("name", modes())
def test_a_recording_that_has_everything_is_enough_for_every_mode(name: str) -> None:
    assert missing_needs(mode_of(name), EVERYTHING) == ()
    assert missing_needs(mode_of(name), replace(EVERYTHING, robot=GO1, has_effort=False)) == ()


def test_every_need_has_a_lack_in_the_table() -> None:
    assert set(LACKS) == set(Need)


@pytest.mark.parametrize(("need", "changes", "lack"), [(need, *row) for need, rows in LACKS.items() for row in rows])
def test_each_lack_is_named_by_the_modes_that_need_it_and_by_no_other(
    need: Need, changes: dict[str, Any], lack: str
) -> None:
    holdings = replace(EVERYTHING, **changes)
    assert missing_needs(mode_needing(need), holdings) == (lack,)
    for mode in modes().values():
        assert (lack in missing_needs(mode, holdings)) == (need in mode.needs), mode.name


@pytest.mark.parametrize("needs", [(), (Need.IMU,), (Need.BODY_TWIST,), tuple(Need)])
def test_needs_of_any_combination_can_be_declared(needs: tuple[Need, ...]) -> None:
    assert missing_needs(mode_needing(*needs), EVERYTHING) == ()
    empty = Holdings(None, report(), (), False, False, SensorCalibrations(), False, "joints")
    assert len(missing_needs(mode_needing(*needs), empty)) >= len(needs)


def test_missing_joints_may_be_allowed() -> None:
    partial = replace(EVERYTHING, missing_joints=("knee",), allows_partial=True)
    assert missing_needs(mode_of("coclo"), partial) == ()
    assert missing_needs(mode_of("coclo"), replace(partial, has_joints=False)) == ("1 of daisy's 18 joints",)


def test_tracks_are_as_good_as_images() -> None:
    assert missing_needs(mode_of("stereo"), replace(EVERYTHING, report=report("stereo_tracks"))) == ()


def test_the_robots_description_makes_up_for_a_mounting_that_was_not_recorded() -> None:
    body_imu = replace(EVERYTHING, report=report("imu", "stereo"), calibrations=NO_IMU)
    assert missing_needs(mode_of("vins"), body_imu) == ()
    assert missing_needs(mode_of("vins"), replace(body_imu, robot=None)) == ("the mounting of its IMU",)


@pytest.mark.parametrize(
    ("name", "late", "lack"),
    [
        ("stereo_twist", "body_twist", "stereo_tracks and body_twist at one time: their stamps are 2 s apart"),
        ("combined", "stereo_tracks", "joints and stereo_tracks at one time: their stamps are 2 s apart"),
        ("vins", "camera_imu", "stereo_tracks and camera_imu at one time: their stamps are 2 s apart"),
        ("coclo", "imu", "joints and imu at one time: their stamps are 2 s apart"),
    ],
)
def test_streams_that_were_never_recorded_together_are_named(name: str, late: str, lack: str) -> None:
    streams = [
        stream(one, 3.0 if one == late else 0.0)
        for one in ("joints", "imu", "stereo_tracks", "camera_imu", "body_twist")
    ]
    holdings = replace(EVERYTHING, report=ReadReport("made", tuple(streams), {}, ()))
    assert missing_needs(mode_of(name), holdings) == (lack,)
    assert missing_needs(mode_of("stereo"), holdings) == ()


def test_the_angle_of_the_cameras_is_that_of_their_optical_axes() -> None:
    assert camera_angle_deg(tiny_cameras()) == pytest.approx(0.0, abs=1e-5)
    assert camera_angle_deg(opposite_cameras()) == pytest.approx(180.0)

# SPDX-License-Identifier: BSD-3-Clause
"""The modes of the package: each estimates, no two alike, and each names what it lacks."""

import subprocess
import sys
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from coclo_vio.fusion.combined import CombinedOdometry
from coclo_vio.fusion.leg_odometry import LegOdometry
from coclo_vio.fusion.visual_odometry import VisualOdometry
from coclo_vio.geometry import se3
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs.equipment import Equipment
from coclo_vio.runs.modes.mode import Need
from coclo_vio.runs.modes.registry import mode_of, modes
from coclo_vio.runs.run_config import resolve
from coclo_vio.simulation.analytic import AnalyticTrial, AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.calibration import CameraCalibration, ImuCalibration, StereoCalibration, matrix4
from coclo_vio.values.errors import CalibrationMissing, CocloError, ConfigError, TopicNotFound
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.measurements import (
    LEG_SENSORS,
    CameraImuSample,
    FootForceSample,
    ImuSample,
    JointSample,
    Measurement,
    StereoFrame,
)
from coclo_vio.values.outputs import Estimate, Estimator

ROBOT = RobotModel(load_robot("daisy"))
WALK = BodyMotionConfig(rest_s=0.8, walk_s=1.2, stop_s=0.0, ramp_s=0.4)
LEGS_ONLY = Equipment(robot=ROBOT)
LEG_MODES = [name for name, mode in modes().items() if mode.has_legs and not mode.has_cameras]
VISUAL_MODES = [name for name, mode in modes().items() if not mode.has_legs]


def cameras() -> StereoCalibration:
    lens = CameraCalibration(width_px=64, height_px=48, focal_px=(40.0, 40.0), principal_point_px=(31.5, 23.5))
    T_body_right = se3.transform(np.eye(3), np.array([0.05, 0.0, 0.0]))
    return StereoCalibration(
        left=lens, right=lens, body_left_camera=matrix4(np.eye(4)), body_right_camera=matrix4(T_body_right)
    )


VISION = Equipment(stereo=cameras(), imu=ImuCalibration(), sensors=frozenset({StereoFrame, ImuSample}))


@cache
def trial() -> AnalyticTrial:
    return generate(AnalyticTrialConfig(body=WALK), ROBOT, seed=3)


def estimates(estimator: Estimator, measurements: Iterable[Measurement]) -> list[Estimate]:
    outputs = [*(output for one in measurements for output in estimator.push(one)), *estimator.finish()]
    return [output for output in outputs if isinstance(output, Estimate)]


@cache
def walked(name: str, *settings: str) -> tuple[StateEstimate, StateEstimate]:
    """First and last estimate of a mode on the walk."""
    found = estimates(mode_of(name).make(LEGS_ONLY, resolve("daisy", settings=settings)), trial().measurements)
    assert {one.name for one in found} == {name}
    return found[0].state, found[-1].state


def test_the_modes_of_the_design_are_there() -> None:
    assert set(modes()) == {
        *("coclo", "coclo_leg_scale", "coclo_paper", "combined", "tight", "inekf", "vins", "stereo", "stereo_twist"),
        *("naive", "naive_rolling", "naive_weighted"),
    }
    assert [name for name, mode in modes().items() if mode.table] == ["coclo", "vins", "combined"]
    assert [name for name, mode in modes().items() if mode.has_feedback] == ["combined"]


def test_combined_gives_the_trajectories_of_both_estimators_each_against_its_own_standalone_mode() -> None:
    combined = mode_of("combined")
    assert combined.trajectory_names == ("combined_coclo", "combined_vins")
    assert [kind.standalone for kind in combined.trajectories] == ["coclo", "vins"]


@pytest.mark.parametrize("name", LEG_MODES)
def test_each_mode_of_legs_follows_a_short_walk(name: str) -> None:
    start, end = walked(name)
    assert end.stamp_ns == trial().truth.stamps_ns[-1]
    travelled_m = trial().truth.positions[-1, 0] - trial().truth.positions[0, 0]
    assert travelled_m > 0.1
    assert end.nav.T_world_body[0, 3] - start.nav.T_world_body[0, 3] == pytest.approx(travelled_m, rel=0.15)


def test_no_two_modes_of_legs_are_the_same() -> None:
    """A mode that ran another one's estimator would give the same path."""
    ends = {name: tuple(walked(name)[1].nav.T_world_body[:3, 3]) for name in LEG_MODES}
    assert len(set(ends.values())) == len(LEG_MODES) == 7


def test_coclo_paper_is_coclo_with_the_profile_of_the_paper() -> None:
    configured = walked("coclo", "filter.profile=paper")[1]
    assert (configured.nav.T_world_body == walked("coclo_paper")[1].nav.T_world_body).all()


@pytest.mark.parametrize(
    ("name", "kind"), [("coclo", LegOdometry), ("inekf", LegOdometry), ("combined", CombinedOdometry)]
)
def test_a_mode_makes_a_fresh_estimator(name: str, kind: type) -> None:
    equipment = replace(VISION, robot=ROBOT)
    first, second = (mode_of(name).make(equipment, resolve("daisy")) for _ in range(2))
    assert isinstance(first, kind)
    assert first is not second


@pytest.mark.parametrize("name", [*LEG_MODES, "combined"])
def test_a_mode_of_legs_without_a_robot_asks_for_one(name: str) -> None:
    words = r"no robot is given: name one .*--robot.* known robots are: .*daisy, .*go1.*; visual modes need none"
    with pytest.raises(ConfigError, match=words):
        mode_of(name).make(replace(VISION, robot=None), resolve())


@pytest.mark.parametrize("name", LEG_MODES)
def test_a_mode_of_legs_reads_no_camera(name: str) -> None:
    assert mode_of(name).sensors_of(replace(LEGS_ONLY, sensors=LEG_SENSORS)) == LEG_SENSORS
    everything = replace(VISION, robot=ROBOT, sensors=LEG_SENSORS | {StereoFrame, CameraImuSample})
    uses_both_imus = name in {"coclo", "coclo_leg_scale"}
    assert mode_of(name).sensors_of(everything) == LEG_SENSORS | ({CameraImuSample} if uses_both_imus else set())


@pytest.mark.parametrize("name", ["coclo", "combined"])
def test_the_cameras_imu_is_a_state_of_the_filter_where_it_is_there_and_calibrated(name: str) -> None:
    def states(equipment: Equipment) -> set[str]:
        estimator = mode_of(name).make(equipment, resolve("daisy"))
        return {block.name for block in estimator._filter._profile.layout.blocks}  # type: ignore[attr-defined]

    sensors = LEG_SENSORS | {StereoFrame, CameraImuSample}
    both = replace(VISION, robot=ROBOT, camera_imu=ImuCalibration(), sensors=sensors)
    assert "camera_gyroscope_bias" in states(both)
    assert "camera_gyroscope_bias" not in states(replace(both, sensors=sensors - {CameraImuSample}))
    assert "camera_gyroscope_bias" not in states(replace(both, camera_imu=None))


@pytest.mark.parametrize("name", VISUAL_MODES)
def test_a_visual_mode_reads_the_one_imu_that_goes_with_the_cameras(name: str) -> None:
    sensors_of = mode_of(name).sensors_of
    assert sensors_of(VISION) == {ImuSample, StereoFrame}
    both = replace(VISION, camera_imu=ImuCalibration(), sensors=VISION.sensors | {CameraImuSample})
    assert sensors_of(both) == {CameraImuSample, StereoFrame}
    with_legs = replace(VISION, sensors=VISION.sensors | {JointSample, FootForceSample})
    assert sensors_of(with_legs) == {ImuSample, StereoFrame}
    assert sensors_of(replace(VISION, imu=None)) == {StereoFrame}


@pytest.mark.parametrize("name", ["vins", "stereo"])
def test_a_visual_mode_makes_visual_odometry(name: str) -> None:
    assert isinstance(mode_of(name).make(VISION, resolve()), VisualOdometry)


@pytest.mark.parametrize(
    ("name", "lacking", "error", "words"),
    [
        (
            "vins",
            {"sensors": frozenset({ImuSample})},
            TopicNotFound,
            r"the walk has no stereo images; coclo-vio inspect",
        ),
        ("stereo", {"stereo": None}, CalibrationMissing, r"the walk has no calibration .*cam0/sensor\.yaml"),
        ("vins", {"imu": None}, CalibrationMissing, r"the walk has no mounting of its IMU: .*imu0/sensor\.yaml"),
        (
            "vins",
            {"sensors": frozenset({StereoFrame})},
            TopicNotFound,
            "the walk has no IMU; a mode of stereo alone needs none",
        ),
        ("stereo_twist", {}, TopicNotFound, "the walk has no body twist; a mode of stereo alone needs none"),
        ("combined", {"stereo": None}, CalibrationMissing, r"the walk has no calibration .*cam0/sensor\.yaml"),
    ],
)
def test_a_mode_names_what_it_lacks_and_the_next_step(
    name: str, lacking: dict[str, Any], error: type[CocloError], words: str
) -> None:
    equipment = replace(VISION, name="the walk", robot=ROBOT if Need.LEGS in mode_of(name).needs else None, **lacking)
    with pytest.raises(error, match=words):
        mode_of(name).make(equipment, resolve("daisy"))


def test_gtsam_is_loaded_for_modes_that_use_it_only() -> None:
    code = (
        "import sys; from coclo_vio.runs.modes.registry import mode_of; "
        "from coclo_vio.runs.equipment import Equipment; from coclo_vio.runs.run_config import resolve; "
        "from coclo_vio.robot.description import load_robot; from coclo_vio.robot.model import RobotModel; "
        "mode_of('coclo').make(Equipment(robot=RobotModel(load_robot('daisy'))), resolve('daisy')); "
        "sys.exit('gtsam' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

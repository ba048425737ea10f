# SPDX-License-Identifier: BSD-3-Clause
import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from coclo_vio.backend.inekf import InvariantLegOdometry
from coclo_vio.filter.naive import NaiveLegOdometry
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.geometry import se3
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs.equipment import Equipment
from coclo_vio.runs.estimators import ESTIMATORS, make_estimator
from coclo_vio.runs.run_config import resolve
from coclo_vio.simulation.analytic import AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.calibration import CameraCalibration, ImuCalibration, StereoCalibration, matrix4
from coclo_vio.values.errors import CalibrationMissing, CocloError, ConfigError, TopicNotFound
from coclo_vio.values.measurements import (
    LEG_SENSORS,
    CameraImuSample,
    FootForceSample,
    ImuSample,
    JointSample,
    StereoFrame,
)

ROBOT = RobotModel(load_robot("daisy"))
WALK = BodyMotionConfig(rest_s=0.8, walk_s=1.2, stop_s=0.0, ramp_s=0.4)
EQUIPMENT = Equipment(robot=ROBOT)
LEG_MODES = [name for name, kind in ESTIMATORS.items() if kind.has_legs and not kind.has_eyes]
VISUAL_MODES = [name for name, kind in ESTIMATORS.items() if not kind.has_legs]
KINDS = {"coclo": LegOdometryFilter, "inekf": InvariantLegOdometry, "naive": NaiveLegOdometry}


def test_the_design_s_modes_are_there() -> None:
    assert {"coclo", "coclo_paper", "inekf", "naive", "vins", "stereo"} <= set(ESTIMATORS)


def cameras() -> StereoCalibration:
    lens = CameraCalibration(width_px=64, height_px=48, focal_px=(40.0, 40.0), principal_point_px=(31.5, 23.5))
    T_body_right = se3.transform(np.eye(3), np.array([0.05, 0.0, 0.0]))
    return StereoCalibration(
        left=lens, right=lens, body_left_camera=matrix4(np.eye(4)), body_right_camera=matrix4(T_body_right)
    )


@pytest.mark.parametrize("name", LEG_MODES)
def test_each_follows_a_short_walk(name: str) -> None:
    trial = generate(AnalyticTrialConfig(body=WALK), ROBOT, seed=3)
    estimator = make_estimator(name, EQUIPMENT, resolve("daisy"))
    assert isinstance(estimator, KINDS[name.partition("_")[0]])
    estimates = [estimate for sample in trial.measurements if (estimate := estimator.push(sample)) is not None]
    end = estimates[-1]
    assert end.stamp_ns == trial.truth.stamps_ns[-1]
    travelled_m = trial.truth.positions[-1, 0] - trial.truth.positions[0, 0]
    assert travelled_m > 0.1
    moved_m = end.nav.T_world_body[0, 3] - estimates[0].nav.T_world_body[0, 3]
    assert moved_m == pytest.approx(travelled_m, rel=0.15)


def test_no_two_are_the_same() -> None:
    """A row that runs another row's estimator would show the same path."""
    trial = generate(AnalyticTrialConfig(body=WALK), ROBOT, seed=3)
    ends = {}
    for name in LEG_MODES:
        estimator = make_estimator(name, EQUIPMENT, resolve("daisy"))
        estimates = [estimate for sample in trial.measurements if (estimate := estimator.push(sample)) is not None]
        ends[name] = tuple(estimates[-1].nav.T_world_body[:3, 3])
    assert len(set(ends.values())) == len(LEG_MODES)


def test_the_paper_s_profile_is_the_configured_one_where_asked() -> None:
    asked = make_estimator("coclo", EQUIPMENT, resolve("daisy", settings=["filter.profile=paper"]))
    named = make_estimator("coclo_paper", EQUIPMENT, resolve("daisy"))
    trial = generate(AnalyticTrialConfig(body=WALK), ROBOT, seed=3)
    last = [
        [one for sample in trial.measurements if (one := each.push(sample)) is not None][-1] for each in (asked, named)
    ]
    assert (last[0].nav.T_world_body == last[1].nav.T_world_body).all()


def test_an_unknown_name_lists_the_names() -> None:
    with pytest.raises(ConfigError, match=r"no mode 'cocolo'; the modes are: coclo, coclo_leg_scale, .*naive_weighted"):
        make_estimator("cocolo", EQUIPMENT, resolve("daisy"))


@pytest.mark.parametrize("name", LEG_MODES)
def test_legs_without_a_robot_ask_for_one(name: str) -> None:
    with pytest.raises(ConfigError, match=r"which robot is it\? Give --robot .*daisy, go1; the modes vins and stereo"):
        make_estimator(name, Equipment(), resolve())


@pytest.mark.parametrize("name", LEG_MODES)
def test_legs_open_no_eyes(name: str) -> None:
    assert ESTIMATORS[name].taken(EQUIPMENT) == LEG_SENSORS


SEEING = Equipment(stereo=cameras(), imu=ImuCalibration(), sensors=frozenset({StereoFrame, ImuSample}))


@pytest.mark.parametrize("name", VISUAL_MODES)
def test_eyes_take_the_one_imu_that_goes_with_them(name: str) -> None:
    taken = ESTIMATORS[name].taken
    assert not taken(SEEING) & {CameraImuSample, JointSample, FootForceSample}
    assert {ImuSample, StereoFrame} <= taken(SEEING)
    both = Equipment(
        camera_imu=ImuCalibration(), imu=ImuCalibration(), sensors=frozenset({StereoFrame, ImuSample, CameraImuSample})
    )
    assert CameraImuSample in taken(both)
    assert ImuSample not in taken(both)
    assert not taken(Equipment(sensors=frozenset({StereoFrame, ImuSample}))) & {ImuSample, CameraImuSample}


@pytest.mark.parametrize(
    ("name", "lacking", "error", "words"),
    [
        ("vins", {"sensors": frozenset({ImuSample})}, TopicNotFound, "the walk has no stereo images to see with"),
        ("stereo", {"stereo": None}, CalibrationMissing, r"the walk does not say how its cameras .*cam0/sensor\.yaml"),
        ("vins", {"imu": None}, CalibrationMissing, r"the walk does not say how its IMU .*imu0/sensor\.yaml"),
        ("vins", {"sensors": frozenset({StereoFrame})}, TopicNotFound, "the walk has no IMU; the mode stereo"),
        ("stereo_twist", {}, TopicNotFound, "the walk has no body twist; the mode stereo"),
    ],
)
def test_what_a_visual_mode_lacks_is_told(
    name: str, lacking: dict[str, Any], error: type[CocloError], words: str
) -> None:
    with pytest.raises(error, match=words):
        make_estimator(name, replace(SEEING, name="the walk", **lacking), resolve())


def test_gtsam_is_loaded_for_modes_that_use_it_only() -> None:
    code = (
        "import sys; from coclo_vio.runs.estimators import ESTIMATORS, make_estimator; "
        "from coclo_vio.runs.equipment import Equipment; from coclo_vio.runs.run_config import resolve; "
        "from coclo_vio.robot.description import load_robot; from coclo_vio.robot.model import RobotModel; "
        "make_estimator('coclo', Equipment(robot=RobotModel(load_robot('daisy'))), resolve('daisy')); "
        "sys.exit('gtsam' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

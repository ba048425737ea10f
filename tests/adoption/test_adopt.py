# SPDX-License-Identifier: BSD-3-Clause
"""Robots whose description exists, adopted from their URDF and a simulated log: the same in what matters."""

import re
from pathlib import Path

import numpy as np
import pytest

from coclo_vio.adoption.adopt import adopt
from coclo_vio.adoption.adoption import Adoption
from coclo_vio.datasets.writer import RecordedJoints
from coclo_vio.robot.description import RobotDescription, load_robot, robot_names
from coclo_vio.robot.description_check import check_description
from coclo_vio.values.errors import ConfigError, DatasetError, RobotModelError

ROUND_FEET = {"a1", "anymal_b", "anymal_c", "b1", "daisy", "hyq", "laikago"}  # whose URDF has their collision sphere
QUICK = {"anymal_b", "daisy", "go2", "g1"}
TURN_OF_IMU = (0.0, 3.141593, 0.5235988)  # upside down and turned by 30 degrees


def assert_same(adoption: Adoption, robot: RobotDescription) -> None:
    found = adoption.description
    assert {leg.name.lower(): (leg.joints, leg.foot_frame) for leg in found.legs} == {
        leg.name.lower(): (leg.joints, leg.foot_frame) for leg in robot.legs
    }
    assert found.joint_names == robot.joint_names
    assert found.contact.source == robot.contact.source
    low, high = 0.6, 2.0  # thresholds by hand are shares of the weight, found ones of what the feet carry
    assert low * robot.contact.on_force < found.contact.on_force < high * robot.contact.on_force
    assert found.contact.off_force < found.contact.on_force
    np.testing.assert_allclose(found.imu.T_body_imu[:3, :3], robot.imu.T_body_imu[:3, :3], atol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in robot_names()]
)
def test_a_packaged_robot_is_found_as_it_was_described(name, write_walk, tmp_path) -> None:
    urdf, log, robot = write_walk(name)
    adoption = adopt(urdf, log)
    assert_same(adoption, robot)
    if name in ROUND_FEET:
        for mine, theirs in zip(adoption.description.legs, robot.legs, strict=True):
            assert (mine.foot_radius_m, mine.foot_centre_m) == (theirs.foot_radius_m, theirs.foot_centre_m)
    loaded = load_robot(adoption.write(tmp_path / "found" / "robot.yaml"))
    assert loaded.model_dump(exclude={"urdf"}) == adoption.description.model_dump(exclude={"urdf"})
    assert Path(loaded.urdf).samefile(adoption.description.urdf)
    assert not any(finding.is_error for finding in check_description(loaded))


def test_names_of_another_driver_become_aliases(write_walk) -> None:
    def renamed(text: str) -> str:
        places = {"hip_joint": "0", "thigh_joint": "1", "calf_joint": "2"}
        return re.sub(r"([FR][LR])_(hip_joint|thigh_joint|calf_joint)", lambda m: f"{m[1]}_{places[m[2]]}", text)

    urdf, log, robot = write_walk("go1", edit=renamed)
    adoption = adopt(urdf, log)
    assert_same(adoption, robot)
    assert adoption.description.joint_aliases["RL_2"] == "RL_calf_joint"
    assert adoption.confidence("joints") == 0.8


def test_joints_without_speaking_names_are_found_by_the_data(write_walk) -> None:
    names = load_robot("go1").joint_names
    by_leg = [names[joint] for leg in (1, 0, 3, 2) for joint in range(3 * leg, 3 * leg + 3)]  # FL FR RL RR

    def unnamed(text: str) -> str:
        for number, joint in enumerate(by_leg):
            text = text.replace(f"{joint}.", f"q{number:02d}.")
        header, rows = text.split("\n", 1)
        columns = header.split(",")
        order = sorted(range(len(columns)), key=lambda column: (not columns[column].startswith("q"), columns[column]))
        cells = [line.split(",") for line in rows.splitlines()]
        return "\n".join(",".join(row[column] for column in order) for row in (columns, *cells)) + "\n"

    urdf, log, robot = write_walk("go1", edit=unnamed)
    adoption = adopt(urdf, log)
    found = {joint: log_name for log_name, joint in adoption.description.joint_aliases.items()}
    assert set(found) == set(robot.joint_names)
    places = [int(found[joint][1:]) for joint in robot.joint_names]
    assert {tuple(places[k : k + 3]) for k in range(0, 12, 3)} == {(0, 1, 2), (3, 4, 5), (6, 7, 8), (9, 10, 11)}
    joints = next(field for field in adoption.fields if field.key == "joints")
    assert not joints.is_sure  # front and rear look alike
    assert f"# ? joints = {joints.value}" in adoption.to_yaml(log.parent)


@pytest.mark.long
@pytest.mark.parametrize("rotation", [(0.0, 0.0, 1.570796), (3.141593, 0.0, 0.0), (1.570796, 0.0, 0.0)])
def test_an_imu_along_other_axes_is_found(rotation, write_walk) -> None:
    urdf, log, robot = write_walk("daisy", rotation=rotation)
    adoption = adopt(urdf, log)
    assert_same(adoption, robot)
    assert adoption.confidence("imu.rotation_body_imu_rpy_rad") > 0.7
    assert "imu.position_body_m" in {field.key for field in adoption.questions}  # nothing in the log states it


def test_an_imu_that_is_turned_by_no_right_angle_is_measured_and_asked_back(write_walk) -> None:
    urdf, log, robot = write_walk("daisy", rotation=TURN_OF_IMU)
    adoption = adopt(urdf, log)
    apart = adoption.description.imu.T_body_imu[:3, :3].T @ robot.imu.T_body_imu[:3, :3]
    assert np.degrees(np.arccos((np.trace(apart) - 1.0) / 2.0)) < 6.0
    assert "near to no axis" in next(f for f in adoption.questions if f.key.startswith("imu.rotation")).reason


def test_without_a_turn_the_heading_of_the_imu_is_asked_back(write_walk) -> None:
    urdf, log, _ = write_walk("anymal_b", curvature_per_m=0.0, joints=RecordedJoints(with_velocity=False))
    field = next(field for field in adopt(urdf, log).fields if field.key.startswith("imu.rotation"))
    assert field.confidence <= 0.8


def test_a_urdf_without_legs_is_an_error_with_the_reasons(tmp_path, write_walk) -> None:
    path = tmp_path / "box.urdf"
    path.write_text('<robot name="box"><link name="box"/></robot>', encoding="utf-8")
    with pytest.raises(RobotModelError, match="has no legs that could be found"):
        adopt(path, tmp_path)


def test_a_log_of_another_robot_is_an_error(write_walk) -> None:
    urdf, _, _ = write_walk("go1")
    _, log, _ = write_walk("daisy")
    with pytest.raises(DatasetError, match=r"18 joint entries .*leg1_base.* cannot be matched .* 12 joints"):
        adopt(urdf, log)


def test_the_yaml_has_to_end_in_yaml(write_walk, tmp_path) -> None:
    urdf, log, _ = write_walk("daisy")
    with pytest.raises(ConfigError, match=r"does not end in \.yaml"):
        adopt(urdf, log).write(tmp_path / "robot.txt")

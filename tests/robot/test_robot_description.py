# SPDX-License-Identifier: BSD-3-Clause
from importlib import metadata
from pathlib import Path

import pytest

from coclo_vio.robot.description import load_robot, robot_names, urdf_path
from coclo_vio.values.errors import ConfigError, RobotModelError

OWN_ROBOT = """
name: mine
urdf: mine.urdf
legs:
  - {name: left, joints: [l1, l2], foot_frame: l_foot, foot_radius_m: 0.03}
  - {name: right, joints: [r1, r2], foot_frame: r_foot}
joint_aliases: {left_one: l1}
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_packaged_robots_are_listed() -> None:
    assert robot_names() == (
        "a1", "anymal_b", "anymal_c", "b1", "bolt", "daisy", "g1", "go1", "go2", "hyq", "laikago", "solo12",
    )  # fmt: skip


@pytest.mark.parametrize("name", robot_names())
def test_every_packaged_robot_loads_with_a_model(name, preset) -> None:
    model = preset(name)
    assert model.description.name == name
    joints_of_a_leg = 6 if name == "g1" else 3
    assert len(model.joint_names) == joints_of_a_leg * len(model.leg_names)


def test_order_is_that_of_the_legs(tmp_path) -> None:
    robot = load_robot(write(tmp_path, OWN_ROBOT))
    assert robot.leg_names == ("left", "right")
    assert robot.joint_names == ("l1", "l2", "r1", "r2")
    assert [leg.foot_radius_m for leg in robot.legs] == [0.03, 0.0]


def test_the_go1_log_names_lead_to_joints() -> None:
    robot = load_robot("go1")
    assert robot.leg_names == ("FR", "FL", "RR", "RL")
    assert len(robot.joint_aliases) == 12
    assert robot.joint_aliases["RL_calf"] == "RL_calf_joint"


def test_a_relative_urdf_is_beside_its_yaml(tmp_path, monkeypatch) -> None:
    path = write(tmp_path, OWN_ROBOT)
    monkeypatch.chdir(tmp_path.parent)
    (tmp_path / "mine.urdf").touch()
    assert urdf_path(load_robot(path.relative_to(tmp_path.parent))) == tmp_path / "mine.urdf"


def test_an_absolute_urdf_stays(tmp_path) -> None:
    elsewhere = tmp_path / "elsewhere" / "robot.urdf"
    path = write(tmp_path, OWN_ROBOT.replace("mine.urdf", str(elsewhere)))
    assert load_robot(path).urdf == str(elsewhere)


def test_an_unknown_robot_is_answered_with_those_known() -> None:
    with pytest.raises(ConfigError, match=r"'dasiy'.*a1, anymal_b, .*daisy, .*go1, .*\.yaml"):
        load_robot("dasiy")


def test_a_missing_yaml_is_named(tmp_path) -> None:
    with pytest.raises(ConfigError, match=r"nothing\.yaml"):
        load_robot(tmp_path / "nothing.yaml")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("foot_radius_m: 0.03", "foot_radius: 0.03"), r"no legs\.0\.foot_radius"),
        (("r1, r2", "l2, r2"), "joint l2 is listed twice"),
        (("name: right", "name: left"), "leg left is listed twice"),
        (("left_one: l1", "left_one: l9"), "lead to l9.*l1, l2, r1, r2"),
        (("0.03", "-0.03"), "greater than or equal to 0"),
        (("[r1, r2]", "[]"), r"legs\.1\.joints"),
    ],
)
def test_a_wrong_description_is_refused_with_the_reason(change, message, tmp_path) -> None:
    assert change[0] in OWN_ROBOT
    with pytest.raises(ConfigError, match=message):
        load_robot(write(tmp_path, OWN_ROBOT.replace(*change)))


def test_a_missing_urdf_is_named(tmp_path) -> None:
    with pytest.raises(RobotModelError, match=r"mine\.urdf.*correct `urdf`"):
        urdf_path(load_robot(write(tmp_path, OWN_ROBOT)))


def test_without_the_extra_the_error_gives_the_install_command(monkeypatch) -> None:
    def absent(name: str) -> None:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "files", absent)
    with pytest.raises(RobotModelError, match=r"pip install coclo-vio\[robots\]"):
        urdf_path(load_robot("a1"))


def test_a_path_that_the_extra_does_not_have_is_answered_with_those_it_has(tmp_path, preset) -> None:
    preset("a1")
    robot = load_robot(write(tmp_path, OWN_ROBOT.replace("mine.urdf", "example-robot-data:a2/a2.urdf")))
    with pytest.raises(RobotModelError, match=r"a2/a2\.urdf.*a1_description/urdf/a1\.urdf"):
        urdf_path(robot)

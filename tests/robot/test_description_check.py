# SPDX-License-Identifier: BSD-3-Clause
"""Each contradiction of a description and its URDF is found and named; descriptions that are right raise none."""

import re
from pathlib import Path

import pytest

from coclo_vio.robot.description import LegDescription, RobotDescription, load_robot, robot_names, urdf_path
from coclo_vio.robot.description_check import DescriptionFinding, check_description
from coclo_vio.values.calibration import ImuCalibration

GO1 = load_robot("go1")
_MASS = '<inertial><mass value="{}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def kinds(description: RobotDescription) -> list[tuple[str, bool]]:
    return [(finding.kind, finding.is_error) for finding in check_description(description)]


def only(description: RobotDescription, kind: str) -> DescriptionFinding:
    findings = check_description(description)
    assert [finding.kind for finding in findings] == [kind]
    return findings[0]


def with_leg(index: int = 0, robot: RobotDescription = GO1, **changes: object) -> RobotDescription:
    legs = list(robot.legs)
    legs[index] = legs[index].model_copy(update=changes)
    return robot.model_copy(update={"legs": tuple(legs)})


def with_urdf(folder: Path, *replacements: tuple[str, str], robot: RobotDescription = GO1) -> RobotDescription:
    text = urdf_path(robot).read_text(encoding="utf-8")
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    path = folder / "changed.urdf"
    path.write_text(text, encoding="utf-8")
    return robot.model_copy(update={"urdf": str(path)})


@pytest.mark.parametrize("name", robot_names())
def test_packaged_robots_agree_with_their_urdf(name, preset) -> None:
    assert check_description(preset(name).description) == ()


def test_the_real_biped_has_its_turned_body_frame_only(shared_data) -> None:
    robot = load_robot(shared_data / "icub_sway" / "icub.yaml")
    assert kinds(robot) == [("body_frame_turned", False)]


def test_a_urdf_that_is_missing_is_a_finding(tmp_path) -> None:
    finding = only(GO1.model_copy(update={"urdf": str(tmp_path / "go1.urdf")}), "urdf_missing")
    assert finding.is_error
    assert "there is no URDF file" in finding.sentence
    assert finding.remedy == ("urdf",)


def test_a_urdf_that_cannot_be_read_is_a_finding(tmp_path) -> None:
    path = tmp_path / "broken.urdf"
    path.write_text("<robot name='a'><link", encoding="utf-8")
    assert only(GO1.model_copy(update={"urdf": str(path)}), "urdf_missing").is_error


def test_a_moving_joint_that_no_leg_lists_is_an_error() -> None:
    finding = only(with_leg(joints=("FR_hip_joint", "FR_calf_joint")), "joint_in_no_leg")
    assert finding.is_error
    assert "the moving joint FR_thigh_joint lies between the body and 'FR_foot'" in finding.sentence
    assert finding.remedy == ("legs[FR].joints: [FR_hip_joint, FR_thigh_joint, FR_calf_joint]",)


def test_a_joint_of_another_leg_is_named_with_its_owner() -> None:
    legs = list(GO1.legs)
    legs[0] = legs[0].model_copy(update={"joints": ("FR_hip_joint", "FR_thigh_joint", "FL_calf_joint")})
    legs[1] = legs[1].model_copy(update={"joints": ("FL_hip_joint", "FL_thigh_joint", "FR_calf_joint")})
    findings = check_description(GO1.model_copy(update={"legs": tuple(legs)}))
    swapped = [finding for finding in findings if finding.kind == "joint_of_another_chain"]
    assert [finding.is_error for finding in swapped] == [True, True]
    assert "FL_calf_joint does not move its foot 'FR_foot' but that of the leg FL" in swapped[0].sentence


def test_joints_in_another_order_are_worth_a_look() -> None:
    finding = only(with_leg(joints=("FR_calf_joint", "FR_hip_joint", "FR_thigh_joint")), "joint_order")
    assert not finding.is_error


def test_a_fixed_or_misspelt_joint_is_an_error() -> None:
    joints = ("FR_hip_joint", "FR_thigh_joint", "FR_calf_joint")
    misspelt = only(with_leg(joints=("FR_hip_jont", *joints[1:])), "joint_unknown")
    assert "did you mean 'FR_hip_joint'?" in misspelt.sentence
    fixed = next(f for f in check_description(with_leg(joints=(*joints, "imu_joint"))) if f.kind == "joint_is_fixed")
    assert fixed.is_error


@pytest.mark.parametrize("frame", ["FR_calf", "FR_thigh", "FR_hip"])
def test_a_foot_frame_above_the_foot_is_an_error(frame) -> None:
    findings = check_description(with_leg(foot_frame=frame))
    finding = next(finding for finding in findings if finding.kind == "foot_frame_above_foot")
    assert finding.is_error
    assert finding.remedy == ("legs[FR].foot_frame: FR_foot",)


def test_an_ankle_above_a_sole_is_worth_a_look(tmp_path) -> None:
    sole = '<link name="FR_sole"/><joint name="FR_sole_fixed" type="fixed"><parent link="FR_foot"/>'
    sole += '<child link="FR_sole"/><origin xyz="0 0 -0.05"/></joint>'
    finding = only(with_urdf(tmp_path, ("</robot>", f"{sole}</robot>")), "foot_frame_above_foot")
    assert (finding.is_error, finding.remedy) == (False, ("legs[FR].foot_frame: FR_sole",))


def test_a_foot_that_two_legs_share_is_an_error() -> None:
    assert ("foot_frame_shared", True) in kinds(with_leg(foot_frame="FL_foot"))


@pytest.mark.parametrize(
    ("radius_m", "kind"), [(0.0, "foot_radius_left_out"), (0.2, "foot_radius_differs"), (0.01, "foot_radius_differs")]
)
def test_the_radius_of_the_foot_is_that_of_its_sphere(radius_m, kind) -> None:
    assert only(with_leg(foot_radius_m=radius_m), kind).remedy == ("legs[FR].foot_radius_m: 0.02",)


def test_a_sphere_beside_the_foot_frame_gives_the_centre(tmp_path) -> None:
    sphere = '<collision><geometry><sphere radius="0.02"/></geometry></collision>'
    moved = sphere.replace("<collision>", '<collision><origin xyz="0 0.01 0.03"/>')
    findings = check_description(with_urdf(tmp_path, (sphere, moved)))
    assert {finding.kind for finding in findings} == {"foot_centre_differs"}
    assert findings[0].remedy == ("legs[FR].foot_centre_m: [0, 0.01, 0.03]",)


def test_a_flat_foot_with_a_radius_is_worth_a_look(tmp_path) -> None:
    changed = with_urdf(tmp_path, ('<sphere radius="0.02"/>', '<box size="0.1 0.05 0.02"/>'))
    assert set(kinds(changed)) == {("foot_is_flat", False)}


def test_a_massless_world_above_the_body_is_found_with_the_body(tmp_path) -> None:
    world = '<robot name="go1">\n  <link name="world"/><joint name="float" type="{}"><parent link="world"/>'
    world += '<child link="trunk"/><origin xyz="0 0 0.3"/></joint>'
    for kind in ("fixed", "floating"):
        finding = only(with_urdf(tmp_path, ('<robot name="go1">', world.format(kind))), "root_without_mass")
        assert finding.remedy == ("body_frame: trunk",)
        corrected = with_urdf(tmp_path, ('<robot name="go1">', world.format(kind)))
        assert check_description(corrected.model_copy(update={"body_frame": "trunk"})) == ()


def test_masses_that_are_missing_or_implausible_are_found(tmp_path) -> None:
    torque = GO1.model_copy(update={"contact": load_robot("a1").contact})
    assert ("contact_threshold_above_weight", False) not in kinds(torque)
    heavy = torque.model_copy(update={"contact": torque.contact.model_copy(update={"on_force": 40.0})})
    assert only(heavy, "contact_threshold_above_weight").remedy == ("contact.on_force: 19", "contact.off_force: 9.6")
    negative = with_urdf(tmp_path, ('<mass value="5.56"/>', '<mass value="-5.56"/>'))
    assert ("mass_negative", True) in kinds(negative)
    light = with_urdf(tmp_path)
    path = Path(light.urdf)
    path.write_text(re.sub(r'<mass value="[^"]*"', '<mass value="0.001"', path.read_text("utf-8")), "utf-8")
    assert [kind for kind, _ in kinds(light)] == ["mass_implausible"]


def test_an_imu_of_the_urdf_that_the_description_omits_or_contradicts_is_found() -> None:
    position = ("imu.position_body_m: [-0.01592, -0.06659, -0.00617]", "imu.rotation_body_imu_rpy_rad: [0, 0, 0]")
    omitted = only(GO1.model_copy(update={"imu": ImuCalibration()}), "imu_mounting_left_out")
    assert (omitted.is_error, omitted.remedy) == (False, position)
    turned = ImuCalibration(position_body_m=(-0.01592, -0.06659, -0.00617), rotation_body_imu_rpy_rad=(0.0, 0.0, 1.57))
    differs = only(GO1.model_copy(update={"imu": turned}), "imu_mounting_differs")
    assert "90.0 degrees away" in differs.sentence


def test_a_leg_that_the_description_omits_is_found() -> None:
    finding = only(GO1.model_copy(update={"legs": GO1.legs[:3]}), "leg_left_out")
    assert "the leg RL with the joints RL_hip_joint, RL_thigh_joint, RL_calf_joint" in finding.sentence


def test_a_leg_on_the_other_side_than_its_name_is_found() -> None:
    legs = tuple(leg.model_copy(update={"name": {"FR": "FL", "FL": "FR"}.get(leg.name, leg.name)}) for leg in GO1.legs)
    assert only(GO1.model_copy(update={"legs": legs}), "leg_on_other_side").remedy == ("legs[FL]", "legs[FR]")


def test_a_joint_without_range_is_found(tmp_path) -> None:
    text = urdf_path(GO1).read_text(encoding="utf-8")
    limit = next(line for line in text.splitlines() if "<limit" in line).strip().split("<limit ")[1].split(" effort")[0]
    changed = with_urdf(tmp_path, (limit, 'lower="0.5" upper="-0.5"'))
    assert ("joint_without_range", True) in kinds(changed)


def test_what_the_check_does_not_know_but_the_model_refuses_is_a_finding(tmp_path) -> None:
    link = f'<link name="a">{_MASS.format(9)}</link><link name="b">{_MASS.format(1)}</link>'
    joint = '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 -0.3"/></joint>'
    path = tmp_path / "no_limits.urdf"
    path.write_text(f'<robot name="r">{link}{joint}</robot>', encoding="utf-8")
    leg = LegDescription(name="leg", joints=("j",), foot_frame="b")
    finding = only(RobotDescription(name="r", urdf=str(path), legs=(leg,)), "urdf_refused")
    assert "does not specify limits" in finding.sentence

# SPDX-License-Identifier: BSD-3-Clause
"""Legs and feet of a URDF without a description: those that people described by hand."""

import pytest

from coclo_vio.robot.description import EXTRA_SCHEME, load_robot, robot_names, urdf_path
from coclo_vio.robot.leg_search import find_legs
from coclo_vio.robot.urdf_tree import UrdfTree, read_urdf_tree
from coclo_vio.values.errors import RobotModelError


def tree_of(urdf: str) -> UrdfTree:
    robot = load_robot("go1").model_copy(update={"urdf": urdf})
    try:
        return read_urdf_tree(urdf_path(robot))
    except RobotModelError:
        pytest.skip("pip install coclo-vio[robots] for this URDF")


@pytest.mark.parametrize("name", robot_names())
def test_legs_of_the_packaged_robots_are_found(name) -> None:
    robot = load_robot(name)
    found = find_legs(tree_of(robot.urdf))
    assert found.body_frame is None
    assert {(leg.joints, leg.foot_frame) for leg in found.legs} == {(leg.joints, leg.foot_frame) for leg in robot.legs}
    assert {leg.name.lower() for leg in found.legs} == {leg.name.lower() for leg in robot.legs}
    by_joints = {leg.joints: leg for leg in robot.legs}
    for leg in found.legs:
        if leg.foot_kind == "sphere" and name != "go1":
            assert leg.foot_radius_m == by_joints[leg.joints].foot_radius_m
            assert leg.foot_centre_m == pytest.approx(by_joints[leg.joints].foot_centre_m)


@pytest.mark.parametrize(
    ("urdf", "legs", "ignored"),
    [
        ("b1_description/urdf/b1-z1.urdf", {"FR", "FL", "RR", "RL"}, "arm, a head"),
        ("anymal_b_simple_description/robots/anymal-kinova.urdf", {"LF", "RF", "LH", "RH"}, "arm, a head"),
        ("talos_data/robots/talos_full_v2.urdf", {"left", "right"}, "carry other chains"),
        ("icub_description/robots/icub.urdf", {"left", "right"}, "carry other chains"),
        ("centauro_description/urdf/centauro.urdf", set(), "ends in a wheel"),
        ("ur_description/urdf/ur5_robot.urdf", set(), "arm, a head"),
    ],
)
def test_arms_heads_and_wheels_are_ignored_with_a_reason(urdf, legs, ignored) -> None:
    found = find_legs(tree_of(EXTRA_SCHEME + urdf))
    assert {leg.name for leg in found.legs} == legs
    assert any(ignored in reason for reason in found.ignored.values())


def test_flat_feet_have_no_radius() -> None:
    soles = find_legs(tree_of(EXTRA_SCHEME + "icub_description/robots/icub.urdf")).legs
    corners = find_legs(tree_of(load_robot("g1").urdf)).legs
    for leg in (*soles, *corners):
        assert (leg.foot_kind, leg.foot_radius_m) == ("flat", 0.0)
    assert {leg.foot_frame for leg in soles} == {"l_sole", "r_sole"}


def test_legs_without_speaking_names_are_found_by_their_reach(tmp_path) -> None:
    inertial = '<inertial><mass value="1"/></inertial>'
    parts = [f'<link name="b0">{inertial}</link>']
    for number, (x, y, reach) in enumerate([(1, 1, -1), (1, -1, -1), (-1, 1, -1), (-1, -1, -1), (0, 0, 1)]):
        places = ((x, y, 0), (0, 0, 0.3 * reach), (0, 0, 0.3 * reach))
        for k, place in enumerate(places):
            kind = "fixed" if k == 2 else "revolute"
            parent = "b0" if k == 0 else f"c{number}{k - 1}"
            parts.append(
                f'<link name="c{number}{k}">{inertial}</link><joint name="q{number}{k}" type="{kind}">'
                f'<parent link="{parent}"/><child link="c{number}{k}"/><axis xyz="0 1 0"/>'
                f'<origin xyz="{place[0]} {place[1]} {place[2]}"/>'
                '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
            )
    path = tmp_path / "plain.urdf"
    path.write_text(f"<robot name='plain'>{''.join(parts)}</robot>", encoding="utf-8")
    found = find_legs(read_urdf_tree(path))
    assert [leg.joints for leg in found.legs] == [(f"q{number}0", f"q{number}1") for number in range(4)]
    assert [leg.foot_frame for leg in found.legs] == ["c02", "c12", "c22", "c32"]
    assert len({leg.name for leg in found.legs}) == 4
    assert found.ignored == {"c41": "its end cannot be below the body"}

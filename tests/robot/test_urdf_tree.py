# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from coclo_vio.robot.description import robot_names, urdf_path
from coclo_vio.robot.urdf_tree import read_urdf_tree
from coclo_vio.values.errors import RobotModelError


@pytest.mark.parametrize("name", robot_names())
def test_links_are_where_pinocchio_has_them(name, preset) -> None:
    model = preset(name)
    tree = read_urdf_tree(urdf_path(model.description))
    angles = np.random.default_rng(1).uniform(-1.0, 1.0, len(model.joint_names))
    feet = model.feet(angles, np.zeros_like(angles))
    placed = tree.placements(dict(zip(model.joint_names, angles.tolist(), strict=True)))
    for row, leg in enumerate(model.description.legs):
        T_root_foot = placed[leg.foot_frame]
        np.testing.assert_allclose(T_root_foot[:3, :3], feet.rotation_body_foot[row], atol=1e-9)
        centre = T_root_foot[:3, :3] @ leg.foot_centre_m + T_root_foot[:3, 3]
        np.testing.assert_allclose(centre, feet.position_body[row], atol=1e-9)
    assert tree.mass_kg == pytest.approx(model.mass_kg, rel=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot><link", "not a URDF that can be read"),
        ("<robot/>", "has no link"),
        ("<robot><link name='a'/><link name='b'/></robot>", "one root link, but this has: a, b"),
        ("<robot><link name='a'/><joint name='j' type='fixed'><parent link='a'/><child link='b'/></joint></robot>",
         "joint 'j' names the link 'b', which it does not have"),
        ("<robot><link name='a'><inertial><mass value='x'/></inertial></link></robot>", "could not convert"),
        ("<robot><link name='a'/><link name='b'/><joint name='j' type='fixed'><origin xyz='0 1'/><parent link='a'/>"
         "<child link='b'/></joint></robot>", "'0 1' must hold three numbers"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_tree_is_named_with_the_reason(text, message, tmp_path) -> None:
    path = tmp_path / "odd.urdf"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(RobotModelError, match=rf"odd\.urdf.*{message}"):
        read_urdf_tree(path)


def test_rigid_links_and_descendants(two_links) -> None:
    tree = read_urdf_tree(urdf_path(two_links()))
    assert tree.rigid_with("foot") == ("lower", "foot")
    assert set(tree.rigid_with("trunk")) == {"root", "trunk"}
    assert tree.descendants("upper") == ("lower", "foot")
    assert tree.descendants("upper", only_fixed=True) == ()
    assert [joint.name for joint in tree.moving_chain("foot")] == ["hip", "knee"]
    assert (tree.joints["hip"].lower, tree.joints["knee"].upper) == (-3.0, np.inf)

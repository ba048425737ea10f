# SPDX-License-Identifier: BSD-3-Clause
"""Every packaged robot: its stand, mass, Jacobians, foot radii, IMU and contact thresholds against its URDF."""

from xml.etree import ElementTree

import numpy as np
import pytest

from coclo_vio.geometry import so3
from coclo_vio.robot.description import load_robot, robot_names, urdf_path
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import STANDING_RAD
from coclo_vio.values.units import GRAVITY_MPS2

MASS_KG = {
    "a1": 13.0,
    "anymal_b": 30.0,
    "anymal_c": 52.0,
    "b1": 55.0,
    "bolt": 1.3,
    "daisy": 19.6,
    "g1": 34.0,
    "go1": 13.0,
    "go2": 15.0,
    "hyq": 87.0,
    "laikago": 25.0,
    "solo12": 2.5,
}  # fmt: skip -- of the makers, kg
STANDING_HEIGHT_M = (0.15, 0.8)
STEP = 1e-6


@pytest.fixture(params=robot_names())
def model(request, preset) -> RobotModel:
    return preset(request.param)


def stand(model: RobotModel) -> np.ndarray:
    return np.concatenate(STANDING_RAD[model.description.name])


def test_mass_is_that_of_the_maker_within_a_tenth(model) -> None:
    assert model.mass_kg == pytest.approx(MASS_KG[model.description.name], rel=0.1)


def test_feet_of_a_stand_are_on_one_plane_below_body_and_hips_and_mirrored_left_to_right(model) -> None:
    feet = model.feet(stand(model), np.zeros(len(model.joint_names))).position_body
    low, high = STANDING_HEIGHT_M
    assert (-high < feet[:, 2]).all()
    assert (feet[:, 2] < -low).all() or model.description.name == "daisy"  # its body is low between its feet
    assert np.ptp(feet[:, 2]) < 1e-3 + 0.02 * (model.description.name == "daisy")
    assert (feet[:, 2] < model.hip_position_body[:, 2]).all()
    mirrored = feet * [1.0, -1.0, 1.0]
    for foot in feet:
        assert np.linalg.norm(mirrored - foot, axis=1).min() < 2e-3


def test_jacobians_of_a_stand_are_the_derivatives_by_finite_differences(model) -> None:
    position, count = stand(model), len(model.joint_names)
    jacobian = model.feet(position, np.zeros(count)).jacobian
    for column, direction in enumerate(np.eye(count)):
        after, before = (model.feet(position + sign * STEP * direction, np.zeros(count)) for sign in (1, -1))
        moved = (after.position_body - before.position_body) / (2 * STEP)
        turned = so3.log(after.rotation_body_foot @ np.swapaxes(before.rotation_body_foot, 1, 2)) / (2 * STEP)
        np.testing.assert_allclose(jacobian[:, 3:, column], moved, atol=1e-8)
        np.testing.assert_allclose(jacobian[:, :3, column], turned, atol=1e-8)


def test_joints_of_a_leg_are_in_the_order_of_its_chain(model) -> None:
    root = ElementTree.parse(urdf_path(model.description)).getroot()
    parents = {joint.find("child").get("link"): joint for joint in root.findall("joint")}
    moving = set(model.joint_names)
    for leg in model.description.legs:
        chain, link = [], leg.foot_frame
        while link in parents:
            chain.insert(0, parents[link].get("name"))
            link = parents[link].find("parent").get("link")
        assert tuple(name for name in chain if name in moving) == leg.joints


@pytest.mark.parametrize("name", sorted(set(robot_names()) - {"go1"}))  # whose YAML states why it has another
def test_a_foot_has_the_radius_of_its_collision_sphere(name, preset) -> None:
    model = preset(name)
    root = ElementTree.parse(urdf_path(model.description)).getroot()
    links = {link.get("name"): link for link in root.findall("link")}
    for leg in model.description.legs:
        spheres = [float(sphere.get("radius")) for sphere in links[leg.foot_frame].findall("collision/geometry/sphere")]
        if len(spheres) == 1:
            assert leg.foot_radius_m == pytest.approx(spheres[0], abs=1.1e-3)
        elif len(spheres) > 1:  # a flat foot that stands on its corners
            assert leg.foot_radius_m == 0.0


@pytest.mark.parametrize(
    ("name", "link"),
    [("go1", "imu_link"), ("go2", "imu"), ("a1", "imu_link"), ("b1", "imu_link"), ("anymal_b", "imu_link"),
     ("anymal_c", "imu_link"), ("hyq", "trunk_imu"), ("g1", "imu_in_pelvis")],
)  # fmt: skip
def test_the_imu_is_mounted_as_in_the_urdf(name, link, preset) -> None:
    body = preset(name)
    imu = RobotModel(body.description.model_copy(update={"body_frame": link}))
    zero = np.zeros(len(body.joint_names))
    T_body_imu = body.description.imu.T_body_imu
    feet_imu = imu.feet(stand(body), zero).position_body
    feet_body = body.feet(stand(body), zero).position_body
    np.testing.assert_allclose(feet_imu @ T_body_imu[:3, :3].T + T_body_imu[:3, 3], feet_body, atol=1e-9)


@pytest.mark.parametrize("name", sorted(set(robot_names()) - {"go1"}))  # whose thresholds are in raw counts
def test_a_standing_leg_loads_its_foot_above_the_contact_threshold(name, preset) -> None:
    model = preset(name)
    contact = model.description.contact
    share_n = model.mass_kg * GRAVITY_MPS2 / len(model.leg_names)
    assert 0.2 * share_n < contact.off_force < 0.6 * share_n
    assert contact.off_force < contact.on_force < 0.7 * share_n


def test_aliases_lead_to_the_joint_of_the_same_place(model) -> None:
    for alias, joint in model.description.joint_aliases.items():
        kind = "knee" if "knee" in joint else joint.removesuffix("_joint").split("_", 1)[1]
        same = {"thigh": ("thigh", "upper_leg"), "calf": ("calf", "lower_leg")}.get(kind, (kind,))
        assert any(word in alias for word in same), (alias, joint)


def test_the_robots_that_are_inferred_from_their_path_share_their_joint_names() -> None:
    robots = [load_robot(name) for name in robot_names()]
    for robot in robots:
        if robot.inferred_from == "path":
            others = [other for other in robots if other.inferred_from == "joints"]
            assert any(set(other.joint_names) == set(robot.joint_names) for other in others)

# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coclo_vio.geometry import so3
from coclo_vio.robot.description import LegDescription, RobotDescription, load_robot, robot_names
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.errors import RobotModelError

STEP = 1e-6


def random_joints(model: RobotModel, seed: int, scale: float) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    count = len(model.joint_names)
    return rng.uniform(-scale, scale, count), rng.normal(0.0, 2.0, count)


def assert_rates_match(model: RobotModel, position: np.ndarray, velocity: np.ndarray) -> None:
    feet = model.feet(position, velocity)
    after, before = (model.feet(position + sign * STEP * velocity, velocity) for sign in (1, -1))
    difference = (after.position_body - before.position_body) / (2 * STEP)
    np.testing.assert_allclose(feet.velocity_body, difference, atol=1e-7)
    turn = after.rotation_body_foot @ np.swapaxes(before.rotation_body_foot, 1, 2)
    np.testing.assert_allclose(feet.angular_velocity_body, so3.log(turn) / (2 * STEP), atol=1e-7)


@pytest.mark.parametrize("name", robot_names())
def test_foot_velocities_are_the_derivatives_of_positions(name, preset) -> None:
    model = preset(name)
    for seed in range(5):
        assert_rates_match(model, *random_joints(model, seed, np.pi))


DAISY = RobotModel(load_robot("daisy"))


@settings(max_examples=30, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), scale=st.sampled_from([0.0, 1e-9, 1e-3, 1.0, np.pi]))
def test_jacobian_columns_are_the_derivatives_joint_by_joint(seed, scale) -> None:
    position, _ = random_joints(DAISY, seed, scale)
    jacobian = DAISY.feet(position, np.zeros(18)).jacobian
    for column, direction in enumerate(np.eye(18)):
        feet = DAISY.feet(position, direction)
        np.testing.assert_allclose(jacobian[:, :3, column], feet.angular_velocity_body, atol=1e-12)
        np.testing.assert_allclose(jacobian[:, 3:, column], feet.velocity_body, atol=1e-12)
        assert_rates_match(DAISY, position, direction)


def test_columns_of_other_legs_are_zero(preset) -> None:
    model = preset("daisy")
    jacobian = model.feet(*random_joints(model, 1, 1.0)).jacobian
    for leg, own in enumerate(model.leg_joint_slices):
        others = np.ones(18, dtype=bool)
        others[own] = False
        assert not jacobian[leg][:, others].any()
        assert np.linalg.matrix_rank(jacobian[leg][:, own]) == 3


@pytest.mark.parametrize("source", ["recording", "example-robot-data"])
def test_our_go1_has_the_kinematics_of_the_published_ones(source, request, preset) -> None:
    ours = preset("go1")
    if source == "recording":
        urdf = str(request.getfixturevalue("shared_data") / "go1_mocap" / "go1.urdf")
    else:
        preset("a1")
        urdf = "example-robot-data:go1_description/urdf/go1.urdf"
    theirs = RobotModel(ours.description.model_copy(update={"urdf": urdf}))
    for seed in range(20):
        joints = random_joints(ours, seed, 2.0)
        np.testing.assert_allclose(ours.feet(*joints).position_body, theirs.feet(*joints).position_body, atol=1e-6)
    assert ours.mass_kg == pytest.approx(theirs.mass_kg, rel=0.01)


def test_go1_and_anymal_imu_mounting_is_that_of_their_urdf(preset) -> None:
    for name in ("go1", "anymal_b"):
        robot = preset(name).description
        first = robot.legs[0].model_copy(update={"foot_frame": "imu_link"})
        with pytest.raises(RobotModelError, match="are: none"):  # no joint between body and imu: it is fixed
            RobotModel(robot.model_copy(update={"legs": (first,)}))
        imu_as_body = RobotModel(robot.model_copy(update={"body_frame": "imu_link"}))
        joints = random_joints(imu_as_body, 2, 1.0)
        T_body_imu = robot.imu.T_body_imu
        feet_imu = imu_as_body.feet(*joints).position_body
        feet_body = RobotModel(robot).feet(*joints).position_body
        np.testing.assert_allclose(feet_imu @ T_body_imu[:3, :3].T + T_body_imu[:3, 3], feet_body, atol=1e-9)


@pytest.mark.parametrize("joint", [0, 7, 17])
def test_a_joint_without_position_makes_its_own_leg_unknown_only(joint, preset) -> None:
    model = preset("daisy")
    position, velocity = random_joints(model, 3, 1.0)
    whole = model.feet(position, velocity)
    position[joint] = np.nan
    feet = model.feet(position, velocity)
    for field in ("position_body", "velocity_body", "angular_velocity_body", "rotation_body_foot", "jacobian"):
        rows = getattr(feet, field)
        assert np.isnan(rows[joint // 3]).all()
        others = np.arange(6) != joint // 3
        np.testing.assert_array_equal(rows[others], getattr(whole, field)[others])


def test_a_joint_without_velocity_keeps_the_position_of_the_foot(preset) -> None:
    model = preset("daisy")
    position, velocity = random_joints(model, 4, 1.0)
    whole = model.feet(position, velocity)
    velocity[4] = np.nan
    feet = model.feet(position, velocity)
    np.testing.assert_array_equal(feet.position_body, whole.position_body)
    np.testing.assert_array_equal(feet.jacobian, whole.jacobian)
    assert np.isnan(feet.velocity_body[1]).all()
    assert np.isnan(feet.angular_velocity_body[1]).all()
    assert np.isfinite(np.delete(feet.velocity_body, 1, axis=0)).all()


def test_a_planar_leg_with_a_continuous_knee(two_links) -> None:
    model = RobotModel(two_links())
    assert model.joint_names == ("hip", "knee")
    assert model.mass_kg == pytest.approx(5 * 0.3)
    feet = model.feet(np.array([0.4, 2 * np.pi + 0.3]), np.array([1.0, -2.0]))
    expected = [-0.3 * np.sin(0.4) - 0.2 * np.sin(0.7), 0.0, -0.3 * np.cos(0.4) - 0.2 * np.cos(0.7)]
    np.testing.assert_allclose(feet.position_body[0], expected, atol=1e-12)
    np.testing.assert_allclose(feet.angular_velocity_body[0], [0.0, -1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(feet.rotation_body_foot[0], so3.exp(np.array([0.0, 0.7, 0.0])), atol=1e-12)


def test_the_body_frame_can_be_another_link(two_links) -> None:
    joints = np.array([0.4, 0.3]), np.array([1.0, -2.0])
    root, trunk = RobotModel(two_links()).feet(*joints), RobotModel(two_links(body="trunk")).feet(*joints)
    R_root_trunk = so3.about_z(np.pi / 2)
    moved = (root.position_body - [0.1, 0.0, 0.05]) @ R_root_trunk
    np.testing.assert_allclose(trunk.position_body, moved, atol=1e-12)
    np.testing.assert_allclose(trunk.velocity_body, root.velocity_body @ R_root_trunk, atol=1e-12)
    np.testing.assert_allclose(trunk.rotation_body_foot[0], R_root_trunk.T @ root.rotation_body_foot[0], atol=1e-12)


def test_the_centre_of_a_foot_may_be_beside_its_frame(two_links) -> None:
    description = two_links()
    leg = description.legs[0].model_copy(update={"foot_centre_m": (0.05, 0.01, 0.02)})
    moved = RobotModel(description.model_copy(update={"legs": (leg,)}))
    joints = np.array([0.4, 0.3]), np.array([1.0, -2.0])
    frame, centre = RobotModel(description).feet(*joints), moved.feet(*joints)
    offset = frame.rotation_body_foot[0] @ [0.05, 0.01, 0.02]
    np.testing.assert_allclose(centre.position_body[0], frame.position_body[0] + offset, atol=1e-12)
    by_rotation = np.cross(frame.angular_velocity_body[0], offset)
    np.testing.assert_allclose(centre.velocity_body[0], frame.velocity_body[0] + by_rotation, atol=1e-12)
    by_pinocchio = RobotModel(moved.description, is_compiled=False).feet(*joints)
    np.testing.assert_allclose(centre.jacobian, by_pinocchio.jacobian, atol=1e-12)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"joints": ("hip", "kneee")}, "no moving joint kneee; it has: hip, knee, neck, turret"),
        ({"joints": ("hip", "ankle")}, "no moving joint ankle"),
        ({"foot": "fot"}, "no link or frame 'fot'; its links are: foot, head, lower, radar, root, trunk, upper"),
        ({"body": "torso"}, "no link or frame 'torso'"),
        ({"body": "upper"}, "'upper' moves with a leg"),
        ({"joints": ("hip", "neck")}, "listed as hip, neck, but .* between the body and 'foot' are: hip;"),
        ({"joints": ("turret",), "foot": "radar"}, "'turret' has more than one degree of freedom"),
    ],
)
def test_a_wrong_name_is_answered_with_those_that_exist(wrong, message, two_links) -> None:
    with pytest.raises(RobotModelError, match=message):
        RobotModel(two_links(**wrong))


def test_a_file_that_is_no_urdf_is_named(tmp_path) -> None:
    path = tmp_path / "broken.urdf"
    leg = LegDescription(name="leg", joints=("a",), foot_frame="b")
    for text in ("<robot", "<robot name='empty'/>"):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(RobotModelError, match=r"broken\.urdf is not a URDF"):
            RobotModel(RobotDescription(name="broken", urdf=str(path), legs=(leg,)))


def test_joint_limits_are_those_of_the_urdf() -> None:
    robot = RobotModel(load_robot("daisy"))
    assert robot.position_limits[:, :3] == pytest.approx(np.array([[-1.57, -1.57, -2.6], [1.57, 1.57, 2.6]]))
    assert robot.effort_limits[:3] == pytest.approx([20.0, 38.0, 20.0])

# SPDX-License-Identifier: BSD-3-Clause
"""One robot for both: the physics' ideal Daisy is the estimators' Daisy, joint by joint, foot by foot, gram by gram."""

import mujoco
import numpy as np
import pytest

from coclo_vio.geometry import so3
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.trial.imperfection import IDEAL, draw_imperfection
from coclo_vio.simulation.trial.robot_spec import BodyConfig, make_spec
from coclo_vio.simulation.trial.terrain import make_terrain

DAISY = load_robot("daisy")
ROBOT = RobotModel(DAISY)
BODY = BodyConfig()


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    spec = make_spec(DAISY, BODY, draw_imperfection(IDEAL, 6, 18, np.random.default_rng(0)), make_terrain("flat"))
    return spec.compile()


@pytest.fixture(params=[1, 2, 3])
def posed(request, model):
    """The robot high in the air at any angles and any attitude: data, angles (18,) and ``R_world_body``."""
    rng = np.random.default_rng(request.param)
    data = mujoco.MjData(model)
    angles, rotation = rng.uniform(-1.5, 1.5, 18), so3.exp(rng.normal(0.0, 0.5, 3))
    for name, angle in zip(DAISY.joint_names, angles, strict=True):
        data.joint(name).qpos[0] = angle
    data.qpos[:3] = [0.3, -0.2, 3.0]
    data.qpos[3:7] = so3.to_quat_xyzw(rotation)[[3, 0, 1, 2]]
    mujoco.mj_forward(model, data)
    return data, angles, rotation


def test_feet_are_where_the_estimators_kinematics_have_them(posed) -> None:
    data, angles, rotation = posed
    feet = np.array([data.body(leg.foot_frame).xpos for leg in DAISY.legs])
    in_body = (feet - data.qpos[:3]) @ rotation
    np.testing.assert_allclose(in_body, ROBOT.feet(angles, np.zeros(18)).position_body, atol=1e-9)


def test_mass_and_its_centre_are_those_of_the_estimators(posed, model) -> None:
    data, angles, rotation = posed
    assert model.body_mass.sum() == pytest.approx(ROBOT.mass_kg, abs=1e-9)
    centre = (data.subtree_com[1] - data.qpos[:3]) @ rotation
    np.testing.assert_allclose(centre, ROBOT.centre_of_mass_body(angles), atol=1e-9)


def test_legs_weigh_on_their_joints_as_the_estimators_have_it(posed, model) -> None:
    """Gravity's torques on resting legs in the air: MuJoCo's bias forces, Pinocchio's inverse dynamics."""
    data, angles, rotation = posed
    dofs = [model.joint(name).dofadr[0] for name in DAISY.joint_names]
    weight = 9.81 * rotation.T @ [0.0, 0.0, 1.0]
    expected = ROBOT.holding_torques(angles, np.zeros((6, 3)), weight)
    np.testing.assert_allclose(data.qfrc_bias[dofs], expected, atol=1e-9)
    assert np.abs(expected).max() > 1.0


def test_feet_are_balls_of_the_described_radius(model) -> None:
    for leg in DAISY.legs:
        ball = model.geom(leg.foot_frame)
        assert ball.type[0] == mujoco.mjtGeom.mjGEOM_SPHERE
        assert ball.size[0] == leg.foot_radius_m == 0.02


def test_springs_come_first_and_dampers_after_in_the_order_of_joints(model) -> None:
    names = [model.actuator(index).name for index in range(model.nu)]
    assert names == [f"{joint}_{kind}" for kind in ("spring", "damper") for joint in DAISY.joint_names]
    np.testing.assert_allclose(model.actuator_gainprm[:18, 0], np.tile(BODY.spring_nm_per_rad, 6))
    np.testing.assert_allclose(model.actuator_gainprm[18:, 0], BODY.spring_damping)


def test_feet_and_legs_touch_what_they_should() -> None:
    """Feet and legs meet the ground and each other; the trunk meets the ground, not its own legs."""
    model = make_spec(DAISY, BODY, draw_imperfection(IDEAL, 6, 18, np.random.default_rng(0)), make_terrain("stairs"))
    compiled = model.compile()
    geoms = [compiled.geom(index) for index in range(compiled.ngeom)]
    ground = [geom for geom in geoms if geom.name.startswith("ground")]
    feet = [geom for geom in geoms if geom.name.endswith("_foot")]
    legs = [geom for geom in geoms if geom.type[0] == mujoco.mjtGeom.mjGEOM_CAPSULE and geom.contype[0]]
    assert (len(ground), len(feet), len(legs)) == (6, 6, 12)

    def meet(first, second) -> bool:
        return bool(first.contype[0] & second.conaffinity[0] or second.contype[0] & first.conaffinity[0])

    assert all(meet(part, block) for part in (*feet, *legs) for block in ground)
    assert all(meet(foot, leg) for foot in feet for leg in legs)
    assert all(meet(leg, other) for leg in legs for other in legs)

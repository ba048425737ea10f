# SPDX-License-Identifier: BSD-3-Clause
"""The compiled kinematics and forces of the legs equal those by Pinocchio, which are the readable form."""

from dataclasses import fields

import numpy as np
import pytest

from coclo_vio.geometry.compiled import IS_COMPILED
from coclo_vio.robot import leg_kernels
from coclo_vio.robot.description import LegDescription, RobotDescription, load_robot, robot_names
from coclo_vio.robot.model import FeetKinematics, RobotModel, damped_forces
from coclo_vio.robot.pinocchio_legs import PinocchioLegs

pytestmark = pytest.mark.skipif(not IS_COMPILED, reason="numba is not there, or switched off")

_INERTIAL = (
    '<inertial><origin xyz="0.01 -0.02 0.03" rpy="0.1 0.2 0.3"/><mass value="0.7"/>'
    '<inertia ixx="2e-3" iyy="3e-3" izz="4e-3" ixy="1e-4" ixz="-2e-4" iyz="3e-4"/></inertial>'
)
# A leg whose joints slide and turn about tilted axes, its foot turned against the last link; the body is not the root.
SLIDING = f"""<robot name="sliding">
<link name="root">{_INERTIAL}</link>
<joint name="mount" type="fixed"><parent link="root"/><child link="trunk"/>
  <origin xyz="0.1 -0.2 0.05" rpy="0.3 0.2 1.5"/></joint>
<link name="trunk"/>
<joint name="hip" type="revolute"><parent link="root"/><child link="upper"/><origin xyz="0.2 0.1 0" rpy="0.1 0 0.2"/>
  <axis xyz="0.6 0.8 0"/><limit lower="-3" upper="3" effort="9" velocity="9"/>
  <dynamics damping="0.2" friction="0.5"/></joint>
<link name="upper">{_INERTIAL}</link>
<joint name="slide" type="prismatic"><parent link="upper"/><child link="middle"/><origin xyz="0 0.05 -0.2" rpy="0 1 0"/>
  <axis xyz="0 0.6 -0.8"/><limit lower="-1" upper="1" effort="9" velocity="9"/>
  <dynamics damping="0.1" friction="0.3"/></joint>
<link name="middle">{_INERTIAL}</link>
<joint name="knee" type="continuous"><parent link="middle"/><child link="lower"/>
  <origin xyz="0 0 -0.3" rpy="0.4 0 0"/><axis xyz="0 1 0"/></joint>
<link name="lower">{_INERTIAL}</link>
<joint name="ankle" type="fixed"><parent link="lower"/><child link="foot"/><origin xyz="0 0 -0.2" rpy="1 2 3"/></joint>
<link name="foot"/>
</robot>"""


@pytest.fixture(params=[*robot_names(), "sliding"])
def models(request, preset, tmp_path) -> tuple[RobotModel, RobotModel]:
    """A robot by the kernels and by Pinocchio."""
    if request.param == "sliding":
        (tmp_path / "sliding.urdf").write_text(SLIDING, encoding="utf-8")
        leg = LegDescription(name="leg", joints=("knee", "hip", "slide"), foot_frame="foot")
        urdf = str(tmp_path / "sliding.urdf")
        description = RobotDescription(name="sliding", urdf=urdf, body_frame="trunk", legs=(leg,))
    else:
        description = preset(request.param).description
    return RobotModel(description, is_compiled=True), RobotModel(description, is_compiled=False)


def assert_equal_feet(models: tuple[RobotModel, RobotModel], position: np.ndarray, velocity: np.ndarray) -> None:
    ours, theirs = (model.feet(position, velocity) for model in models)
    for field in fields(FeetKinematics):
        expected = getattr(theirs, field.name)
        np.testing.assert_allclose(getattr(ours, field.name), expected, atol=1e-12, rtol=1e-12, err_msg=field.name)


@pytest.mark.parametrize("scale", [0.0, 1e-9, 1.0, np.pi, 30.0])
def test_kinematics(models, scale) -> None:
    rng = np.random.default_rng(31)
    for _ in range(20):
        count = len(models[0].joint_names)
        assert_equal_feet(models, rng.uniform(-scale, scale, count), rng.normal(0.0, 5.0, count))


@pytest.mark.parametrize("is_velocity", [False, True])
def test_unknown_joints(models, is_velocity) -> None:
    rng = np.random.default_rng(32)
    count = len(models[0].joint_names)
    for joint in range(count):
        position, velocity = rng.normal(size=count), rng.normal(size=count)
        (velocity if is_velocity else position)[joint] = np.nan
        assert_equal_feet(models, position, velocity)


@pytest.mark.parametrize("is_moving", [False, True])
@pytest.mark.parametrize("has_weight", [False, True])
def test_foot_forces(models, has_weight, is_moving) -> None:
    rng = np.random.default_rng(33)
    count = len(models[0].joint_names)
    for case in range(40):
        scale = 1e-3 if case % 2 else 1.5  # near zero the legs of some robots are stretched
        position, velocity, effort = rng.uniform(-scale, scale, count), rng.normal(0, 5, count), rng.normal(0, 9, count)
        arguments = {
            "specific_force_body": rng.normal(0, 5, 3) if has_weight else None,
            "angular_velocity_body": rng.normal(0, 2, 3),
            "acceleration": rng.normal(0, 50, count) if is_moving else None,
        }
        if case % 5 == 4:
            for unknown in (position, velocity, effort)[: 1 + case % 3]:
                unknown[rng.integers(count)] = np.nan
        ours, theirs = (model.foot_forces(position, velocity, effort, **arguments) for model in models)
        largest = np.abs(np.nan_to_num(theirs)).max()
        np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-12 * max(largest, 1.0))
        assert np.isfinite(theirs).all() or case % 5 == 4


def test_forces_of_stretched_legs() -> None:
    """Jacobians of every rank, and singular values on both sides of the limit from which a direction is damped."""
    rng = np.random.default_rng(34)
    chains = PinocchioLegs(load_robot("daisy")).chains()
    assert chains is not None
    for _ in range(50):
        jacobian, torque = np.zeros((6, 6, 18)), rng.normal(0.0, 9.0, 18)
        for leg in range(6):
            sizes = 10.0 ** rng.uniform(-4.0, 0.0, 3) * (rng.random(3) < 0.7)
            turn, other = np.linalg.qr(rng.normal(size=(3, 3)))[0], np.linalg.qr(rng.normal(size=(3, 3)))[0]
            jacobian[leg, 3:, 3 * leg : 3 * leg + 3] = turn @ np.diag(sizes) @ other
        expected = damped_forces(jacobian[:, 3:], torque)
        largest = np.abs(expected).max()
        np.testing.assert_allclose(leg_kernels.damped_forces(jacobian, torque, chains), expected, atol=1e-12 * largest)

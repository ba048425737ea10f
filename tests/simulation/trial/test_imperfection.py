# SPDX-License-Identifier: BSD-3-Clause
"""How a robot differs from its description: drawn as configured, and applied in the physics."""

from dataclasses import asdict, replace

import mujoco
import numpy as np
import pytest

from coclo_vio.geometry import se3, so3
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.trial.imperfection import IDEAL, Imperfection, ImperfectionConfig, draw_imperfection
from coclo_vio.simulation.trial.mounting import MountingConfig, perturbed
from coclo_vio.simulation.trial.robot_spec import BodyConfig, make_spec
from coclo_vio.simulation.trial.terrain import make_terrain
from coclo_vio.values.arrays import Array

DAISY = load_robot("daisy")
LEGS, JOINTS = 6, 18
NONE = draw_imperfection(IDEAL, LEGS, JOINTS, np.random.default_rng(0))
CHANGED_LEG = 2  # and its middle joint
CHANGED_JOINT = 3 * CHANGED_LEG + 1
CUT_AT_TWO_SIGMA = 0.959  # standard deviation of a unit Gaussian held to [-2, 2]


def feet_of(imperfection: Imperfection, angle: float = 0.3) -> Array:
    """Foot centres, m, trunk's axes, (6, 3), with all joints at one angle."""
    model = make_spec(DAISY, BodyConfig(), imperfection, make_terrain("flat")).compile()
    data = mujoco.MjData(model)
    for name in DAISY.joint_names:
        data.joint(name).qpos[0] = angle
    mujoco.mj_kinematics(model, data)
    return np.array([data.body(leg.foot_frame).xpos for leg in DAISY.legs])


def changed(field: str, place: int, value: float | Array) -> Imperfection:
    """An imperfection with a single difference."""
    values = np.array(getattr(NONE, field))
    values[place] = value
    return replace(NONE, **{field: values})


def test_the_ideal_robot_differs_in_nothing() -> None:
    for name, value in asdict(NONE).items():
        np.testing.assert_array_equal(value, 1.0 if name.endswith("_scale") else 0.0)


def test_differences_are_spread_as_configured_and_cut_at_two_sigma() -> None:
    config = ImperfectionConfig()
    many = draw_imperfection(config, 3000, 9000, np.random.default_rng(1))
    mean_m = config.foot_compliance_m
    for drawn, sigma in (
        (many.link_scale - 1.0, config.link_length),
        (many.joint_zero_rad, config.joint_zero_rad),
        (many.leg_base_m, config.leg_base_m),
        (many.foot_radius_m, config.foot_radius_m),
        (many.link_mass_scale - 1.0, config.mass),
        (many.foot_compliance_m / mean_m - 1.0, config.foot_compliance_spread),
    ):
        assert np.std(drawn) == pytest.approx(CUT_AT_TWO_SIGMA * sigma, rel=0.05)
        assert np.abs(drawn).max() == pytest.approx(2.0 * sigma)
    assert many.foot_compliance_m.mean() == pytest.approx(mean_m, rel=0.02)


def test_a_stretched_link_moves_its_foot_and_no_other() -> None:
    before, after = feet_of(NONE), feet_of(changed("link_scale", CHANGED_JOINT, 1.02))
    moved = np.linalg.norm(after - before, axis=1)
    assert 0.001 < moved[CHANGED_LEG] < 0.02
    np.testing.assert_allclose(np.delete(moved, CHANGED_LEG), 0.0, atol=1e-12)


def test_a_leg_stretched_as_a_whole_is_larger_by_its_scale() -> None:
    stretched = replace(NONE, link_scale=np.full(JOINTS, 1.05))
    hips = RobotModel(DAISY).hip_position_body
    np.testing.assert_allclose(feet_of(stretched) - hips, 1.05 * (feet_of(NONE) - hips), atol=1e-9)


def test_a_shifted_leg_base_shifts_its_foot() -> None:
    shift = np.array([0.002, -0.003, 0.001])
    moved = feet_of(changed("leg_base_m", CHANGED_LEG, shift)) - feet_of(NONE)
    np.testing.assert_allclose(moved[CHANGED_LEG], shift, atol=1e-12)
    np.testing.assert_allclose(np.delete(moved, CHANGED_LEG, axis=0), 0.0, atol=1e-12)


def test_masses_are_scaled_trunk_and_links() -> None:
    heavy = replace(NONE, body_mass_scale=1.1, link_mass_scale=np.full(JOINTS, 1.2))
    plain, scaled = (
        make_spec(DAISY, BodyConfig(), imperfection, make_terrain("flat")).compile() for imperfection in (NONE, heavy)
    )
    trunk = plain.body("base_link").mass[0]
    assert scaled.body("base_link").mass[0] == pytest.approx(1.1 * trunk)
    links = [int(plain.jnt_bodyid[plain.joint(name).id]) for name in DAISY.joint_names]
    np.testing.assert_allclose(scaled.body_mass[links], 1.2 * plain.body_mass[links])
    np.testing.assert_allclose(scaled.body_inertia[links], 1.2 * plain.body_inertia[links])


def test_a_foot_has_its_own_radius_and_compliance_under_its_share_of_weight() -> None:
    imperfection = replace(
        changed("foot_radius_m", CHANGED_LEG, 0.001), foot_compliance_m=np.linspace(0.001, 0.004, LEGS)
    )
    model = make_spec(DAISY, BodyConfig(), imperfection, make_terrain("flat")).compile()
    radii = np.array([model.geom(leg.foot_frame).size[0] for leg in DAISY.legs])
    np.testing.assert_allclose(radii, 0.02 + imperfection.foot_radius_m)
    share_n = RobotModel(DAISY).mass_kg * 9.81 / 5.0  # five of six feet stand
    for leg, deflection_m in zip(DAISY.legs, imperfection.foot_compliance_m, strict=True):
        assert model.joint(f"{leg.foot_frame}_compliance").stiffness[0] * deflection_m == pytest.approx(share_n)
    rigid = make_spec(DAISY, BodyConfig(), NONE, make_terrain("flat")).compile()
    assert rigid.njnt == 1 + JOINTS


def test_the_cameras_are_off_their_place_together_and_a_little_apart() -> None:
    nominal = MountingConfig().stereo()
    for side in ("T_body_left_camera", "T_body_right_camera"):
        np.testing.assert_allclose(getattr(perturbed(nominal, NONE), side), getattr(nominal, side), atol=1e-12)
    true = perturbed(nominal, draw_imperfection(ImperfectionConfig(), LEGS, JOINTS, np.random.default_rng(4)))
    moved = se3.log(se3.inverse(nominal.T_body_left_camera) @ true.T_body_left_camera)
    assert 0.0005 < np.linalg.norm(moved[3:]) < 2.0 * 0.002 * np.sqrt(3.0)
    assert 0.0005 < np.linalg.norm(moved[:3]) < 2.0 * 0.00349 * np.sqrt(3.0)
    assert abs(true.baseline_m - 0.05) < 2.0 * 0.0002 * np.sqrt(3.0)
    turned = so3.log(true.T_body_left_camera[:3, :3].T @ true.T_body_right_camera[:3, :3])
    assert 0.0 < np.linalg.norm(turned) < 2.0 * 0.00035 * np.sqrt(3.0)


def test_the_camera_looks_forward_and_a_little_down() -> None:
    nominal = MountingConfig(camera_pitch_rad=0.3).stereo()
    T_body_left = nominal.T_body_left_camera
    np.testing.assert_allclose(T_body_left[:3, 2], [np.cos(0.3), 0.0, -np.sin(0.3)], atol=1e-12)
    np.testing.assert_allclose(T_body_left[:3, 0], [0.0, -1.0, 0.0], atol=1e-12)
    assert nominal.baseline_m == pytest.approx(0.05)

# SPDX-License-Identifier: BSD-3-Clause
"""Path, ground, swing, force distribution and foot sensor of a trot, each against what is known by hand."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from trot_settings import GO1

from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.trial.imperfection import IDEAL
from coclo_vio.simulation.trial.motion import Motion
from coclo_vio.simulation.trot.foot_sensor import FootSensorConfig, foot_force_samples
from coclo_vio.simulation.trot.force_distribution import distributed
from coclo_vio.simulation.trot.ground import RAMP_RISE_M, STEP_HEIGHT_M, make_ground
from coclo_vio.simulation.trot.loop_path import LoopPath
from coclo_vio.simulation.trot.quadruped import QUADRUPED_PARTS, QUADRUPEDS
from coclo_vio.simulation.trot.quadruped_body import QuadrupedBody
from coclo_vio.simulation.trot.quadruped_spec import TrotBodyConfig, make_trot_spec
from coclo_vio.simulation.trot.swing import swing_motion
from coclo_vio.simulation.trot.trot_gait import TrotGait, TrotGaitConfig
from coclo_vio.simulation.trot.trot_imperfection import TrotImperfectionConfig, draw_trot_imperfection
from coclo_vio.values.units import GRAVITY_MPS2

PATH = LoopPath(4.0, 1.5, 1.0, 50.0)
QUIET = FootSensorConfig(gain_spread=0.0, offset=0.0, drift=0.0, noise=0.0, hysteresis=0.0, counts_per_n=7.0)


def ideal(**changes) -> TrotImperfectionConfig:
    return TrotImperfectionConfig.parse({**IDEAL.model_dump(), **changes}, "test")


def drawn(**changes):
    return draw_trot_imperfection(ideal(**changes), 4, np.random.default_rng(1))


def test_a_lap_closes_and_its_points_are_as_far_apart_as_the_way_is_long() -> None:
    metres = np.arange(0.0, PATH.lap_m, 0.01)
    points = np.array([PATH.at(each).position for each in metres])
    assert np.hypot(*np.diff(points, axis=0).T) == pytest.approx(0.01, rel=1e-3)
    assert PATH.at(PATH.lap_m).position == pytest.approx([0.0, 0.0], abs=1e-9)
    assert PATH.at(PATH.lap_m + 0.5).heading_rad == pytest.approx(2.0 * np.pi)
    steps = np.diff([PATH.at(each).heading_rad for each in metres]) / 0.01
    assert np.unique(steps.round(1)).min() == 0.0
    assert steps.max() == pytest.approx(1.0, rel=0.01)
    xmin, xmax, ymin, ymax = PATH.bounds_m
    assert (points[:, 0].min(), points[:, 0].max()) == pytest.approx((xmin, xmax), abs=1e-3)
    assert (points[:, 1].min(), points[:, 1].max()) == pytest.approx((ymin, ymax), abs=1e-3)


@pytest.mark.parametrize(("name", "top_m"), [("flat", 0.0), ("ramp", RAMP_RISE_M), ("stairs", 4 * STEP_HEIGHT_M)])
def test_the_map_has_the_height_of_the_ground(name, top_m) -> None:
    ground = make_ground(name, 10.0, np.random.default_rng(1))
    assert ground.map.height.max() == pytest.approx(top_m, abs=0.003)
    assert ground.map.heights(np.zeros((1, 2))) == 0.0
    if name == "ramp":
        along = ground.map.heights(np.array([[1.4, 0.0], [2.4, 0.0]]))
        assert np.diff(along) == pytest.approx([0.2], abs=0.003)


def test_the_map_of_stones_is_what_a_ray_from_above_meets() -> None:
    ground = make_ground("rough", 10.0, np.random.default_rng(5))
    spec = make_trot_spec(GO1, TrotBodyConfig(), drawn(), ground)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[0] = -50.0  # out of the rays' way
    mujoco.mj_forward(model, data)
    points = np.random.default_rng(2).uniform([-1.0, -0.5], [5.0, 4.0], (300, 2))
    groups = np.array([0, 0, 0, 1, 0, 0], dtype=np.uint8)
    met = [
        2.0
        - mujoco.mj_ray(
            model, data, np.array([*point, 2.0]), np.array([0.0, 0.0, -1.0]), groups, 1, -1, np.zeros(1, np.int32), None
        )
        for point in points
    ]
    heights = ground.map.heights(points)
    assert (np.abs(heights - met) < 1e-6).mean() > 0.95  # but for edges within a cell
    assert 0.01 < heights.max() <= 0.04


def test_footholds_keep_away_from_the_edges_of_steps() -> None:
    ground = make_ground("stairs", 10.0, np.random.default_rng(1))
    edge = np.array([0.9, 0.0])
    foothold = ground.map.foothold(edge)
    assert 0.04 <= np.linalg.norm(foothold - edge) < 0.1
    assert ground.map.foothold(np.array([-0.5, 0.3])) == pytest.approx([-0.5, 0.3])


def test_velocity_and_acceleration_of_a_swing_are_the_derivatives_of_its_position() -> None:
    start, goal, step = np.array([0.0, 0.1, 0.02]), np.array([0.2, 0.12, 0.05]), 1e-6
    for elapsed in (0.03, 0.08, 0.15, 0.19, 0.23):
        before, now, after = (swing_motion(start, goal, 0.12, 0.2, 0.5, elapsed + each) for each in (-step, 0.0, step))
        assert (after.position - before.position) / (2.0 * step) == pytest.approx(now.velocity, abs=1e-4)
        assert (after.velocity - before.velocity) / (2.0 * step) == pytest.approx(now.acceleration, abs=1e-2)
    end = swing_motion(start, goal, 0.12, 0.2, 0.5, 0.2)
    assert end.position == pytest.approx(goal)
    assert end.velocity == pytest.approx([0.0, 0.0, -0.5])


def test_four_feet_bear_a_wrench_exactly_and_two_the_weight() -> None:
    levers = np.array([[x, y, -0.3] for x in (0.2, -0.2) for y in (0.1, -0.1)])
    wrench = np.array([5.0, -3.0, 130.0, 1.0, -2.0, 0.5])
    forces = distributed(wrench, levers, np.ones(4), 0.6)
    assert forces.sum(axis=0) == pytest.approx(wrench[:3], rel=0.01)
    assert np.cross(levers, forces).sum(axis=0) == pytest.approx(wrench[3:], abs=0.05)
    pair = distributed(np.array([0.0, 0.0, 130.0, 0.0, 0.0, 0.0]), levers[[0, 3]], np.ones(2), 0.6)
    assert pair[:, 2] == pytest.approx([65.0, 65.0], rel=0.01)
    cut = distributed(np.array([200.0, 0.0, 130.0, 0.0, 0.0, 0.0]), levers, np.ones(4), 0.6)
    assert (np.hypot(cut[:, 0], cut[:, 1]) <= 0.6 * cut[:, 2] + 1e-9).all()
    unloaded = distributed(wrench, levers, np.array([1.0, 1.0, 1.0, 0.05]), 0.6)
    assert unloaded[3, 2] < 0.3 * forces[3, 2]


def test_the_strides_of_a_gait_differ_and_diagonal_legs_share_their_phase() -> None:
    hips = np.array([[0.2, -0.1, 0.0], [0.2, 0.1, 0.0], [-0.2, -0.1, 0.0], [-0.2, 0.1, 0.0]])
    gait = TrotGait(TrotGaitConfig(), hips, np.random.default_rng(1))
    assert [leg.offset for leg in gait.legs] == [0.5, 0.0, 0.0, 0.5]
    periods = set()
    for _ in range(1000):
        gait.advance(0.002)
        periods.add(gait.period_s)
    assert 4 <= len(periods) <= 6
    assert all(period == pytest.approx(0.45, rel=0.07) for period in periods)


def pressed(force: np.ndarray) -> Motion:
    count = len(force)
    rest = {name: np.zeros((count, 1)) for name in ("qpos", "qvel", "trunk_acceleration", "spring_torque")}
    columns = np.zeros(1, dtype=np.int64)
    return Motion(
        time_s=0.001 * np.arange(count),
        joint_columns=columns,
        joint_velocity_columns=columns,
        foot_force=np.repeat(force[:, None], 4, axis=1),
        self_contacts=0,
        ground_contacts=0,
        max_penetration_m=0.0,
        **rest,
    )


def readings(force: np.ndarray, **changes) -> np.ndarray:
    config = QUIET.model_copy(update=changes)
    samples = foot_force_samples(pressed(force), config, 500.0, np.random.default_rng(1))
    return np.array([sample.force for sample in samples])


def test_a_foot_reads_its_load_late_and_lingers_at_lift_off() -> None:
    force = np.zeros(1000)
    force[200:500] = 60.0
    counts = readings(force)[:, 0]
    assert (counts[99], counts[245]) == (0.0, 420.0)
    assert 0.5 < counts[104] / 420.0 < 0.9  # 8 ms after touch-down
    assert 0.2 < counts[256] / 420.0 < 0.6  # 12 ms after lift-off
    assert counts[275] > 3.0  # 50 ms after it
    assert counts[-1] == 0.0


def test_saturation_hysteresis_and_a_dead_foot() -> None:
    force = np.full(500, 300.0)
    assert readings(force)[-1].tolist() == [1200.0] * 4
    assert readings(force, dead_foot=2)[-1].tolist() == [1200.0, 1200.0, 0.0, 1200.0]
    wave = 50.0 + 0.3 * np.sin(np.linspace(0.0, 60.0, 2000))
    assert np.ptp(readings(wave, hysteresis=6.0)[500:, 0]) == 0.0  # within its play
    assert readings(force, is_present=False).size == 0


@pytest.mark.parametrize("name", QUADRUPEDS)
def test_each_quadruped_stands_below_its_hips_with_its_described_mass(name) -> None:
    description, parts = load_robot(name), QUADRUPED_PARTS[name]
    robot = RobotModel(description, is_compiled=False)
    body = QuadrupedBody.of(robot, parts, parts.height_m)
    feet = robot.feet(body.standing, np.zeros(12)).position_body
    assert feet[:, 2] == pytest.approx(robot.foot_radii_m - parts.height_m, abs=1e-6)
    assert feet[:, 0] == pytest.approx(robot.hip_position_body[:, 0], abs=1e-6)
    ground = make_ground("flat", 10.0, np.random.default_rng(1))
    model = make_trot_spec(description, TrotBodyConfig(), drawn(), ground).compile()
    assert model.body_mass.sum() == pytest.approx(robot.mass_kg, rel=1e-4)
    assert (model.nq, model.nu) == (19, 12)


def test_each_cause_adds_its_own_springs_and_lengths() -> None:
    ground = make_ground("flat", 10.0, np.random.default_rng(1))

    def model_of(**changes):
        return make_trot_spec(GO1, TrotBodyConfig(), drawn(**changes), ground).compile()

    bent = model_of(joint_bending_rad_per_nm=(0.0, 0.0, 0.01))
    springs = [bent.joint(f"{leg}_calf_joint_bending").stiffness[0] for leg in GO1.leg_names]
    assert (bent.nv, springs) == (22, [100.0] * 4)
    soft = model_of(foot_compliance_m=0.005, foot_shear_m=0.002, foot_creep=0.5)
    weight_n = RobotModel(GO1, is_compiled=False).mass_kg * GRAVITY_MPS2
    assert soft.nv == 18 + 4 * 4
    assert soft.joint("FR_foot_compliance").stiffness[0] == pytest.approx(weight_n / 2.0 / 0.005)
    assert soft.joint("FR_foot_compliance_creep").stiffness[0] == pytest.approx(weight_n / 0.005)
    short, plain = model_of(link_length_error=-0.05), model_of()
    assert short.body("FR_calf").pos[2] == pytest.approx(0.95 * plain.body("FR_calf").pos[2])
    assert model_of(foot_radius_error_m=0.005).geom("FR_foot").size[0] == pytest.approx(0.028)


def test_spreads_of_zero_draw_an_ideal_robot() -> None:
    robot = drawn()
    assert (robot.link_scale == 1.0).all()
    assert not robot.joint_bending_rad_per_nm.any()
    assert (robot.foot_creep, robot.foot_shear_m, robot.body_mass_scale) == (0.0, 0.0, 1.0)
    assert replace(robot, foot_creep=1.0).foot_creep == 1.0

# SPDX-License-Identifier: BSD-3-Clause
"""Trials of the analytic generator obey rolling and rigid-body physics, and the sensors agree with the truth."""

import numpy as np
import pytest

from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial, AnalyticTrialConfig, SensorNoiseConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.simulation.gait import GaitConfig
from coclo_vio.values.errors import ConfigError, RobotModelError
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample
from coclo_vio.values.units import GRAVITY_MPS2

PERFECT = SensorNoiseConfig(noise_scale=0.0)
BRIEF = BodyMotionConfig(rest_s=0.1, walk_s=1.4, stop_s=0.1, ramp_s=0.5, curvature_per_m=0.4)
SHORT = BodyMotionConfig(rest_s=0.3, walk_s=3.2, stop_s=0.2, ramp_s=0.6, curvature_per_m=0.4)


def walk(robot: RobotModel, **changes: object) -> AnalyticTrial:
    values: dict[str, object] = {"body": SHORT, "sensors": PERFECT, "substeps": 2, **changes}
    return generate(AnalyticTrialConfig.model_validate(values), robot, seed=3)


@pytest.fixture(scope="module", params=["daisy", "go1"])
def robot(request: pytest.FixtureRequest) -> RobotModel:
    return RobotModel(load_robot(request.param))


@pytest.fixture(scope="module")
def trial(robot: RobotModel) -> AnalyticTrial:
    return walk(robot)


@pytest.fixture(scope="module")
def daisy() -> RobotModel:
    return RobotModel(load_robot("daisy"))


def foot_twists(robot: RobotModel, trial: AnalyticTrial, sample: int) -> tuple[np.ndarray, np.ndarray]:
    """Angular velocity of the foot links and velocity of the foot centres, world, (legs, 3)."""
    feet = robot.feet(trial.joint_position[sample], trial.joint_velocity[sample])
    rate, rotation = trial.body.angular_velocity[sample], trial.body.rotation[sample]
    velocity = np.cross(rate, feet.position_body) + feet.velocity_body
    return (rate + feet.angular_velocity_body) @ rotation.T, trial.body.velocity[sample] + velocity @ rotation.T


def test_contact_point_of_a_stance_foot_is_at_rest(robot: RobotModel, trial: AnalyticTrial) -> None:
    down = np.column_stack((np.zeros((len(robot.foot_radii_m), 2)), -robot.foot_radii_m))
    assert trial.stance.all(axis=1).any()
    assert not trial.stance.all()
    for sample in range(len(trial.truth)):
        spin, velocity = foot_twists(robot, trial, sample)
        contact_velocity = velocity + np.cross(spin, down)
        assert np.abs(contact_velocity[trial.stance[sample]]).max() < 1e-9


def test_stance_feet_stay_on_the_ground_and_swing_feet_above_it(robot: RobotModel, trial: AnalyticTrial) -> None:
    clearance = trial.feet_world[:, :, 2] - robot.foot_radii_m
    assert np.abs(clearance[trial.stance]).max() < 1e-10
    assert clearance[~trial.stance].min() > 0.0
    assert clearance.max() == pytest.approx(0.05, abs=1e-3)


def test_kinematics_of_the_true_joints_reproduce_the_feet(robot: RobotModel, trial: AnalyticTrial) -> None:
    for sample in range(0, len(trial.truth), 7):
        feet = robot.feet(trial.joint_position[sample], trial.joint_velocity[sample]).position_body
        T_world_body = trial.truth.T_world_body[sample]
        np.testing.assert_allclose(
            T_world_body[:3, 3] + feet @ T_world_body[:3, :3].T, trial.feet_world[sample], rtol=0, atol=1e-12
        )


@pytest.mark.long
def test_joint_velocity_is_the_derivative_of_joint_position(robot: RobotModel) -> None:
    fine = walk(robot, rate_hz=500.0, substeps=1, body=BRIEF)
    differences = (fine.joint_position[2:] - fine.joint_position[:-2]) / 4e-3
    assert np.abs(fine.joint_velocity).max() > 1.0
    assert (
        np.abs(differences - fine.joint_velocity[1:-1]).max() < 5e-3
    )  # a jump of joint acceleration by 10 rad/s^2, times 2 ms / 4


def test_rolling_moves_the_foot_centre(robot: RobotModel, trial: AnalyticTrial) -> None:
    """A model of feet as points at rest would be wrong by millimetres in each stance."""
    both = trial.stance[1:] & trial.stance[:-1]
    steps = np.linalg.norm(np.diff(trial.feet_world, axis=0), axis=2) * both
    assert steps.sum(axis=0).min() > 2e-3


def test_imu_is_consistent_with_the_truth_by_finite_differences(daisy: RobotModel) -> None:
    mounted = load_robot("daisy").model_copy(
        update={
            "imu": daisy.description.imu.model_copy(
                update={"position_body_m": (0.1, -0.05, 0.2), "rotation_body_imu_rpy_rad": (0.3, -0.2, 1.0)}
            )
        }
    )
    trial = walk(RobotModel(mounted), rate_hz=500.0, substeps=1, body=BRIEF)
    T_world_imu = trial.truth.T_world_body @ mounted.imu.T_body_imu
    position, rotation = T_world_imu[:, :3, 3], T_world_imu[:, :3, :3]
    acceleration = (position[2:] - 2.0 * position[1:-1] + position[:-2]) * 500.0**2
    force = np.einsum("kji,kj->ki", rotation[1:-1], acceleration + np.array([0.0, 0.0, GRAVITY_MPS2]))
    turn = np.swapaxes(rotation[:-2], 1, 2) @ rotation[2:]
    rate = (
        0.5
        * 500.0
        * np.stack((turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]), 1)
        / 2.0
    )
    imu = [sample for sample in trial.measurements if isinstance(sample, ImuSample)][1:-1]
    np.testing.assert_allclose([sample.specific_force for sample in imu], force, rtol=0, atol=2e-3)
    np.testing.assert_allclose([sample.angular_velocity for sample in imu], rate, rtol=0, atol=1e-4)


def test_true_velocity_is_the_derivative_of_position(trial: AnalyticTrial) -> None:
    differences = (trial.truth.positions[2:] - trial.truth.positions[:-2]) * 50.0
    assert trial.truth.velocity_world is not None
    np.testing.assert_allclose(trial.truth.velocity_world[1:-1], differences, rtol=0, atol=1e-3)


def test_loads_sum_to_the_weight_and_rest_on_stance_feet_only(robot: RobotModel, trial: AnalyticTrial) -> None:
    weight = robot.mass_kg * GRAVITY_MPS2
    np.testing.assert_allclose(trial.load_n.sum(axis=1), weight, rtol=1e-12)
    assert np.all(trial.load_n[~trial.stance] == 0.0)
    changes = np.diff(trial.stance.astype(int), axis=0)
    assert (changes == 1).any()
    assert np.all(trial.load_n[1:][changes == 1] < 0.01 * weight)  # touchdown
    assert np.all(trial.load_n[:-1][changes == -1] < 0.01 * weight)  # lift-off


def test_foot_forces_recover_the_loads_from_the_torques(robot: RobotModel, trial: AnalyticTrial) -> None:
    specific_force = trial.body.specific_force_at(np.zeros(3))
    joints = [sample for sample in trial.measurements if isinstance(sample, JointSample)]
    for sample in range(0, len(joints), 5):
        force = robot.foot_forces(
            joints[sample].position,
            joints[sample].velocity,
            joints[sample].effort,
            specific_force_body=specific_force[sample],
            angular_velocity_body=trial.body.angular_velocity[sample],
            acceleration=trial.joint_acceleration[sample],
        )
        world = force @ trial.body.rotation[sample].T
        np.testing.assert_allclose(world[:, 2], trial.load_n[sample], rtol=0, atol=1e-8)
        np.testing.assert_allclose(world[:, :2], 0.0, rtol=0, atol=1e-8)


def test_measurements_come_in_time_order_force_imu_joints(trial: AnalyticTrial) -> None:
    kinds = [FootForceSample, ImuSample, JointSample]
    assert len(trial.measurements) == 3 * len(trial.truth)
    for number, sample in enumerate(trial.measurements):
        assert type(sample) is kinds[number % 3]
        assert sample.stamp_ns == trial.truth.stamps_ns[number // 3]


def raw(trial: AnalyticTrial) -> bytes:
    parts = []
    for sample in trial.measurements:
        match sample:
            case ImuSample():
                parts += [sample.angular_velocity, sample.specific_force]
            case JointSample():
                parts += [sample.position, sample.velocity, sample.effort]
            case FootForceSample():
                parts += [sample.force]
    return b"".join(part.tobytes() for part in (*parts, trial.truth.T_world_body, trial.feet_world))


def test_a_seed_repeats_to_the_byte_and_another_differs(daisy: RobotModel) -> None:
    config = AnalyticTrialConfig(body=BRIEF, substeps=1)
    first = generate(config, daisy, seed=1)
    assert raw(first) == raw(generate(config, daisy, seed=1))
    assert raw(first) != raw(generate(config, daisy, seed=2))


def test_noise_has_the_configured_size(daisy: RobotModel) -> None:
    standing = BodyMotionConfig(rest_s=10.0, walk_s=0.0, stop_s=0.0)
    trial = generate(AnalyticTrialConfig(body=standing, substeps=1), daisy, seed=5)
    imu = [sample for sample in trial.measurements if isinstance(sample, ImuSample)]
    joints = [sample for sample in trial.measurements if isinstance(sample, JointSample)]
    gyro = np.array([sample.angular_velocity for sample in imu]) - trial.gyroscope_bias
    assert gyro.std() == pytest.approx(daisy.description.imu.gyroscope_noise_density * 10.0, rel=0.05)
    encoder = np.array([sample.position for sample in joints]) - trial.joint_position
    assert encoder.std() == pytest.approx(daisy.description.encoder_noise_rad, rel=0.05)
    assert np.abs(trial.gyroscope_bias[0]).max() > 1e-4


def test_standing_still_is_exactly_still(daisy: RobotModel) -> None:
    trial = walk(daisy, body=BodyMotionConfig(rest_s=0.5, walk_s=0.0, stop_s=0.2))
    assert trial.stance.all()
    assert np.ptp(trial.joint_position, axis=0).max() < 1e-12
    assert np.abs(trial.joint_velocity).max() < 1e-12


@pytest.mark.long
@pytest.mark.parametrize("name", ["daisy", "go1"])
def test_wave_gait_lifts_one_foot_at_a_time(name: str) -> None:
    robot = RobotModel(load_robot(name))
    legs = len(robot.leg_names)
    gait = GaitConfig(order="wave", duty=1.0 - 0.8 / legs, cycle_s=2.4)
    trial = walk(robot, gait=gait, body=SHORT.model_copy(update={"walk_s": 4.8, "speed_mps": 0.1}), substeps=1)
    assert (~trial.stance).sum(axis=1).max() == 1
    assert (~trial.stance).any(axis=0).all()


def test_alternating_gait_of_six_legs_is_a_tripod(daisy: RobotModel) -> None:
    trial = walk(daisy)
    swings = {tuple(np.flatnonzero(~row)) for row in trial.stance}
    assert swings == {(), (0, 3, 4), (1, 2, 5)}


@pytest.mark.long
def test_a_walk_of_ten_metres_keeps_rolling(daisy: RobotModel) -> None:
    body = BodyMotionConfig(walk_s=51.0, speed_mps=0.2)
    trial = walk(daisy, body=body, rate_hz=15.0, substeps=3)
    assert trial.truth.path_length_m() > 10.0
    assert np.abs((trial.feet_world[:, :, 2] - 0.02)[trial.stance]).max() < 1e-8
    assert np.abs(np.linalg.norm(trial.feet_world - trial.truth.positions[:, None], axis=2)).max() < 1.0


def test_an_unknown_robot_needs_a_stand_and_a_long_step_is_refused(daisy: RobotModel) -> None:
    unknown_robot = RobotModel(load_robot("daisy").model_copy(update={"name": "unknown_robot"}))
    with pytest.raises(ConfigError, match="standing_rad, 18 joint angles"):
        walk(unknown_robot)
    with pytest.raises(ConfigError, match="has 2 angles"):
        walk(unknown_robot, standing_rad=(0.0, 1.0))
    with pytest.raises(RobotModelError, match="misses its foothold"):
        walk(daisy, body=SHORT.model_copy(update={"speed_mps": 2.0}))
    with pytest.raises(RobotModelError, match="leaves its path"):
        walk(daisy, body=BodyMotionConfig(walk_s=10.0, speed_mps=0.3), rate_hz=30.0)

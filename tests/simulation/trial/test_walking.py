# SPDX-License-Identifier: BSD-3-Clause
"""The first steps of the three trials: the robot walks, stays upright, stands on its feet, and repeats exactly."""

import numpy as np
import pytest

from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.simulated_recording import IDEAL_ROBOT, simulation_config
from coclo_vio.simulation.trial.gait_controller import planned_path
from coclo_vio.simulation.trial.imperfection import ImperfectionConfig
from coclo_vio.simulation.trial.sensors import EPOCH_NS
from coclo_vio.simulation.trial.terrain import TERRAINS
from coclo_vio.simulation.trial.trial import Trial, simulate
from coclo_vio.values.errors import SimulationError
from coclo_vio.values.measurements import CameraImuSample, ImuSample, JointSample

ROBOT = RobotModel(load_robot("daisy"))
WEIGHT_N = 9.81 * ROBOT.mass_kg
UP = np.array([0.0, 0.0, 9.81])
FEW_S = 6.0
SOON = {"trial": {"stand_s": 1.0}}
UNTIL_S = 2.4


def readings(trial: Trial, kind: type, name: str) -> np.ndarray:
    """One kind's readings, a row each."""
    return np.array([getattr(sample, name) for sample in trial.measurements if type(sample) is kind])


def same_measurements(first: Trial, second: Trial) -> bool:
    kinds = {ImuSample: "specific_force", CameraImuSample: "angular_velocity", JointSample: "effort"}
    return all(
        np.array_equal(readings(first, kind, name), readings(second, kind, name)) for kind, name in kinds.items()
    )


@pytest.mark.long
@pytest.mark.parametrize("name", TERRAINS)
def test_the_robot_walks_its_path_on_its_feet(name, walk) -> None:
    trial = walk(name, until_s=FEW_S)
    gait = simulation_config(name).trial.gait
    path = planned_path(trial.terrain, gait)
    planned, end = path.pose_at(FEW_S - 2.0)[:3, 3], trial.truth.trajectory.positions[-1]
    np.testing.assert_allclose(end, planned, atol=0.06)
    assert end[0] > 0.1
    assert trial.truth.self_contacts == trial.truth.ground_contacts == 0
    assert trial.truth.max_penetration_m < 0.003
    feet_down = trial.truth.contact.sum(axis=1)
    assert (feet_down[:2000] == 6).all()
    assert np.mean(feet_down[2000:] >= 5) > 0.95
    assert np.mean(feet_down[2000:] == 5) > 0.3


@pytest.mark.long
def test_standing_feet_carry_the_weight_and_springs_show_it(walk) -> None:
    """Estimators have no touch sensors, but the springs' torques through the described kinematics."""
    trial = walk("flat", IDEAL_ROBOT, SOON, until_s=UNTIL_S)
    standing = [sample for sample in trial.measurements if type(sample) is JointSample][:95]
    for sample in standing[::10]:
        forces = ROBOT.foot_forces(sample.position, sample.velocity, sample.effort, specific_force_body=UP)
        assert forces[:, 2].sum() == pytest.approx(WEIGHT_N, rel=0.03)
        assert (forces[:, 2] > 0.05 * WEIGHT_N).all()


def test_an_imu_on_a_standing_robot_measures_gravity_and_no_rotation(walk) -> None:
    trial = walk("flat", until_s=FEW_S)
    force, rate = readings(trial, ImuSample, "specific_force"), readings(trial, ImuSample, "angular_velocity")
    bias = trial.truth.imu
    np.testing.assert_allclose((force - bias.accelerometer_bias)[:190].mean(axis=0), [0.0, 0.0, 9.81], atol=0.1)
    np.testing.assert_allclose((rate - bias.gyroscope_bias)[:190].mean(axis=0), 0.0, atol=2e-3)


def test_the_gyroscope_measures_the_true_rotation(walk) -> None:
    trial = walk("ramp", until_s=FEW_S)
    rotations = trial.truth.trajectory.rotations
    rate = readings(trial, ImuSample, "angular_velocity") - trial.truth.imu.gyroscope_bias
    turned = np.einsum("nji,njk->nik", rotations[:-2], rotations[2:])
    exact = np.stack((turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]), axis=1) / 0.02
    assert np.sqrt(np.mean((rate[1:-1] - exact) ** 2)) < 0.25 * exact.std()


def test_sensors_have_their_rates_and_one_clock(walk) -> None:
    trial = walk("stairs", until_s=FEW_S)
    stamps = [sample.stamp_ns for sample in trial.measurements]
    assert stamps == sorted(stamps)
    assert stamps[0] == trial.frame_ns[0] == EPOCH_NS
    for kind, rate_hz in ((ImuSample, 100), (CameraImuSample, 200), (JointSample, 100)):
        count = sum(type(sample) is kind for sample in trial.measurements)
        assert count == pytest.approx(FEW_S * rate_hz, abs=1)
    assert len(trial.frame_ns) == pytest.approx(FEW_S * 15, abs=1)
    assert trial.frame_qpos.shape == (len(trial.frame_ns), 7 + 18 + 6)  # with the springs of the feet
    assert trial.frame_qvel.shape == (len(trial.frame_ns), 6 + 18 + 6)


def test_velocity_of_the_truth_is_that_of_its_positions(walk) -> None:
    truth = walk("flat", until_s=FEW_S).truth.trajectory
    by_differences = (truth.positions[2:] - truth.positions[:-2]) / 0.02
    np.testing.assert_allclose(truth.velocity_world[1:-1], by_differences, atol=0.03)


@pytest.mark.long
def test_a_seed_repeats_the_trial_and_another_seed_differs(walk) -> None:
    first = walk("flat", SOON, until_s=UNTIL_S)
    again = simulate("flat", first.robot, simulation_config("flat", SOON).trial, 1, until_s=UNTIL_S)
    other = walk("flat", SOON, until_s=UNTIL_S, seed=2)
    assert same_measurements(first, again)
    np.testing.assert_array_equal(first.truth.trajectory.T_world_body, again.truth.trajectory.T_world_body)
    np.testing.assert_array_equal(first.vicon.trajectory.T_world_body, again.vicon.trajectory.T_world_body)
    np.testing.assert_array_equal(first.frame_qpos, again.frame_qpos)
    assert not same_measurements(first, other)
    assert np.abs(first.truth.imperfection.link_scale - other.truth.imperfection.link_scale).max() > 1e-3
    assert first.truth.vicon_offset_s != other.truth.vicon_offset_s
    assert not np.array_equal(first.truth.contact, other.truth.contact)


@pytest.mark.long
def test_each_part_has_its_own_random_stream(walk) -> None:
    """Another Vicon changes neither the motion nor the measurements of the robot."""
    slow_vicon = {"trial": {"vicon": {"rate_hz": 50.0, "dropout_s": 0.0}}}
    first, other = walk("flat", SOON, until_s=UNTIL_S), walk("flat", SOON, slow_vicon, until_s=UNTIL_S)
    assert same_measurements(first, other)
    assert len(other.vicon.trajectory) < 0.6 * len(first.vicon.trajectory)


def test_an_ideal_robot_is_the_described_one(walk) -> None:
    trial = walk("flat", IDEAL_ROBOT, SOON, until_s=UNTIL_S)
    imperfection = trial.truth.imperfection
    assert not np.any(imperfection.joint_zero_rad)
    assert (imperfection.link_scale == 1.0).all()
    np.testing.assert_allclose(trial.truth.stereo.T_body_left_camera, trial.stereo.T_body_left_camera, atol=1e-12)
    assert trial.frame_qpos.shape[1] == 7 + 18
    feet = feet_in_the_world(trial)
    contact = trial.truth.contact[::10]
    heights = feet[:95, :, 2][contact[:95]]
    np.testing.assert_allclose(heights, 0.02, atol=0.002)  # of the centres of standing feet: their radius


def test_an_imperfect_robots_encoders_and_legs_are_off(walk) -> None:
    """By the described kinematics its standing feet are millimetres above or below the ground."""
    trial = walk("flat", SOON, until_s=UNTIL_S)
    heights = feet_in_the_world(trial)[:95, :, 2].mean(axis=0)
    assert np.ptp(heights) > 0.003
    assert np.abs(trial.truth.imperfection.joint_zero_rad).max() < 2.0 * ImperfectionConfig().joint_zero_rad + 1e-12
    assert not np.array_equal(trial.truth.stereo.T_body_left_camera, trial.stereo.T_body_left_camera)


def feet_in_the_world(trial: Trial) -> np.ndarray:
    """Foot centres by the joints as measured, the description, and the true pose, m, (N, legs, 3)."""
    poses = trial.truth.trajectory.T_world_body
    feet = np.array(
        [ROBOT.feet(angles, np.zeros(18)).position_body for angles in readings(trial, JointSample, "position")]
    )
    return np.einsum("nij,nlj->nli", poses[:, :3, :3], feet) + poses[:, None, :3, 3]


@pytest.mark.long
def test_pushes_shake_the_trunk(walk) -> None:
    hard = {"trial": {"push": {"force_n": 60.0, "torque_nm": 5.0, "every_s": 0.2}}}
    plain, pushed = walk("flat", SOON, until_s=UNTIL_S), walk("flat", SOON, hard, until_s=UNTIL_S)
    apart = np.linalg.norm(plain.truth.trajectory.positions - pushed.truth.trajectory.positions, axis=1)
    assert (apart[:100] == 0.0).all()  # no push while the robot stands
    assert 0.005 < apart.max() < 0.2


@pytest.mark.long
def test_progress_is_reported(walk) -> None:
    reports: list[float] = []
    config = simulation_config("flat", SOON).trial
    simulate("flat", ROBOT.description, config, 1, until_s=UNTIL_S, progress=reports.append)
    assert reports == sorted(reports)
    assert reports[0] <= 1.01
    assert reports[-1] > 1.9


@pytest.mark.long
def test_a_robot_with_soft_joints_falls_and_the_error_gives_time_and_position() -> None:
    soft = {"trial": {"body": {"spring_nm_per_rad": (1.0, 1.0, 1.0)}}}
    with pytest.raises(SimulationError, match=r"the robot fell after .* s at x = "):
        simulate("flat", ROBOT.description, simulation_config("flat", soft).trial, 1, until_s=5.0)

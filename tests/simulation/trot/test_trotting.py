# SPDX-License-Identifier: BSD-3-Clause
"""A Go1 trots on flat ground: how it moves, what its sensors measure, and what a reader gets of its recording."""

import numpy as np
import pytest
from trot_settings import GO1, SHORT, SPEED_MPS, STAND_S

from coclo_vio.api.recording import open_recording
from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.simulated_recording import IDEAL_ROBOT
from coclo_vio.simulation.simulated_trot import simulate_trot, trot_config
from coclo_vio.simulation.trot.trot_walk import TrotWalk
from coclo_vio.values.errors import SimulationError
from coclo_vio.values.measurements import ALL_SENSORS, CameraImuSample, FootForceSample, ImuSample, JointSample

STEADY_S = STAND_S + 1.0


def test_it_trots_straight_at_the_wanted_speed(trot) -> None:
    motion = trot[2]
    steady = motion.time_s > STEADY_S
    speed = motion.qvel[steady, 0].mean()
    assert speed == pytest.approx(SPEED_MPS, rel=0.06)
    assert np.abs(motion.qpos[steady, 1]).max() < 0.1
    assert motion.qpos[steady, 2] == pytest.approx(0.29, abs=0.02)
    assert (motion.self_contacts, motion.ground_contacts) == (0, 0)
    assert motion.max_penetration_m < 0.005


def test_diagonal_feet_stand_together_and_four_feet_at_the_start(trot) -> None:
    motion = trot[2]
    contact = motion.foot_force > 1.0
    assert contact[motion.time_s < STAND_S].all()
    steady = contact[motion.time_s > STEADY_S]
    pairs = np.array([[True, False, False, True], [False, True, True, False]])  # FR and RL, FL and RR
    share = [(steady == pair).all(axis=1).mean() for pair in pairs]
    assert min(share) > 0.35
    assert sum(share) > 0.8
    landings = np.diff(steady[:, 0].astype(int)) == 1
    assert 5 <= landings.sum() <= 14  # strides of 0.45 s in 3 s; a foot may bounce


def test_touch_downs_are_impacts_in_both_imus(trot) -> None:
    samples = trot[1].measurements
    for kind in (ImuSample, CameraImuSample):
        upward = np.array([sample.specific_force for sample in samples if isinstance(sample, kind)])
        norms = np.linalg.norm(upward, axis=1)
        walking = norms[int(len(norms) * STEADY_S / 5.0) :]
        assert walking.max() > 18.0
        assert walking.mean() == pytest.approx(9.81, rel=0.1)


def test_counts_of_the_feet_separate_stance_from_swing(trot) -> None:
    motion, samples = trot[2], trot[1].measurements
    counts = np.array([sample.force for sample in samples if isinstance(sample, FootForceSample)])
    loaded = motion.foot_force[::2][: len(counts)] > 15.0
    for foot in range(4):
        stance, swing = counts[loaded[:, foot], foot], counts[~loaded[:, foot], foot]
        assert np.percentile(stance, 25) > 150.0
        assert np.percentile(swing, 75) < 100.0
    assert (counts == np.rint(counts)).all()


def test_a_standing_foot_stays_where_it_is_by_the_measured_angles() -> None:
    """Of an ideal robot, in pairs of the true pose and the angles; but for the rolling of its sphere."""
    config = trot_config(SHORT, IDEAL_ROBOT).trial
    motion = TrotWalk.draw(GO1, config, 2, 3.5).motion()
    robot = RobotModel(GO1, is_compiled=False)
    loaded = motion.foot_force[:, 0] > 20.0
    starts = np.flatnonzero(loaded[1:] & ~loaded[:-1]) + 1
    spans = [(start, start + int(np.argmin(loaded[start:]))) for start in starts if start > 1500]
    spans = [(start, end) for start, end in spans if end - start > 120]
    assert len(spans) >= 3
    for start, end in spans:
        rows = np.arange(start + 30, end - 10, 5)
        feet = [
            motion.T_world_body[row, :3, :3]
            @ robot.feet(motion.joint_position[row], motion.joint_velocity[row]).position_body[0]
            + motion.T_world_body[row, :3, 3]
            for row in rows
        ]
        assert np.ptp(np.array(feet), axis=0).max() < 0.03
        assert np.array(feet)[:, 2] == pytest.approx(0.023, abs=0.003)


def test_torques_hold_the_weight(trot) -> None:
    samples = [sample for sample in trot[1].measurements if isinstance(sample, JointSample)]
    robot = RobotModel(GO1, is_compiled=False)
    gravity = np.array([0.0, 0.0, 9.81])
    forces = [
        robot.foot_forces(sample.position, sample.velocity, sample.effort, specific_force_body=gravity)[:, 2].sum()
        for sample in samples[50:400]
    ]
    assert np.mean(forces) == pytest.approx(robot.mass_kg * 9.81, rel=0.15)


@pytest.mark.long
def test_the_recording_is_read_with_the_name_of_the_robot_only(trot) -> None:
    path, trial, _ = trot
    recording = open_recording(path, robot="go1")
    inspection = recording.inspect()
    assert inspection.missing["coclo"] == ()
    assert inspection.problems == ()
    read = list(open_dataset(path, GO1).measurements(ALL_SENSORS))
    for kind in (ImuSample, JointSample, FootForceSample, CameraImuSample):
        mine = [sample for sample in read if isinstance(sample, kind)]
        wrote = [sample for sample in trial.measurements if isinstance(sample, kind)]
        assert len(mine) == len(wrote) > 0
        for name in type(mine[7]).__slots__ or ("angular_velocity", "specific_force"):
            assert np.array_equal(getattr(mine[7], name), getattr(wrote[7], name))


@pytest.mark.long
def test_the_same_seed_makes_the_same_bytes(tmp_path) -> None:
    config = trot_config(SHORT)
    for folder in ("one", "two"):
        simulate_trot(tmp_path / folder / "go1.bag", config, 3, images=False, until_s=1.5)
    assert (tmp_path / "one" / "go1.bag").read_bytes() == (tmp_path / "two" / "go1.bag").read_bytes()


def test_a_recording_without_velocities_and_torques_keeps_the_feet(tmp_path) -> None:
    config = trot_config(SHORT, {"trial": {"joints": {"has_velocity": False, "has_effort": False}}})
    path = tmp_path / "go1.mcap"
    simulate_trot(path, config, 3, images=False, until_s=0.2)
    samples = list(open_dataset(path, GO1).measurements())
    joints = next(sample for sample in samples if isinstance(sample, JointSample))
    assert np.isnan(joints.effort).all()
    feet = next(sample for sample in samples if isinstance(sample, FootForceSample))
    assert (feet.force > 100.0).all()


def test_a_robot_that_falls_says_where(tmp_path) -> None:
    config = trot_config(SHORT, {"trial": {"body": {"friction": 0.05}}})
    with pytest.raises(SimulationError, match=r"the robot (fell|got stuck) after"):
        TrotWalk.draw(GO1, config.trial, 1, 12.0).motion()


@pytest.mark.slow
@pytest.mark.parametrize("ground", ["flat", "rough", "ramp", "stairs", "slippery"])
def test_a_go1_reaches_the_end_on_every_ground(ground) -> None:
    config = trot_config({"trial": {"ground": ground, "gait": {"distance_m": 10.0}}}).trial
    motion = TrotWalk.draw(GO1, config, 11, None).motion()
    assert (motion.foot_force[-300:] > 1.0).all()
    assert motion.self_contacts < 10

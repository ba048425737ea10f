# SPDX-License-Identifier: BSD-3-Clause
"""The true motion: an IMU anywhere on the trunk, its file, and what shares one motion."""

import mujoco
import numpy as np
import pytest

from coclo_vio.geometry import se3
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.simulated_recording import simulation_config
from coclo_vio.simulation.trial.config import motion_key
from coclo_vio.simulation.trial.gait_controller import GaitController
from coclo_vio.simulation.trial.motion import read_motion, write_motion
from coclo_vio.simulation.trial.physics import Simulator
from coclo_vio.simulation.trial.trial import simulate
from coclo_vio.simulation.trial.walk import Walk
from coclo_vio.values.errors import DatasetError

DAISY = load_robot("daisy")
T_BODY_IMU = se3.exp(np.array([0.4, -0.2, 1.1, 0.2, -0.05, 0.13]))
UNTIL_S = 1.6
SOON = {"trial": {"stand_s": 1.0}}


def test_an_imu_measures_what_mujocos_sensors_measure_at_its_place(monkeypatch) -> None:
    """MuJoCo's own accelerometer and gyroscope, on a trunk that sways on its springs."""
    walk = Walk.draw("flat", DAISY, simulation_config("flat", SOON).trial, 2, UNTIL_S)
    spec, model = walk.spec(), RobotModel(DAISY)
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(T_BODY_IMU[:3, :3]).ravel())
    spec.bodies[1].add_site(name="imu", pos=T_BODY_IMU[:3, 3], quat=quat)
    for kind in (mujoco.mjtSensor.mjSENS_GYRO, mujoco.mjtSensor.mjSENS_ACCELEROMETER):
        spec.add_sensor(type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="imu")
    simulator = Simulator(spec.compile(), model)
    measured = []
    step = mujoco.mj_step

    def stepped(compiled, data, *count) -> None:
        step(compiled, data, *count)
        if not count:
            measured.append(data.sensordata[-6:].copy())

    monkeypatch.setattr(mujoco, "mj_step", stepped)
    gait = walk.config.gait
    controller = GaitController(model, walk.terrain, gait, simulator.spring, walk.generators["gait"], 1.0)
    motion = simulator.walk(controller, 1.0, walk.config.push, walk.generators["push"], until_s=UNTIL_S)
    assert np.ptp(np.array(measured)[:, 3:], axis=0).max() > 1.0
    np.testing.assert_allclose(motion.inertial(T_BODY_IMU), measured, atol=1e-9)


@pytest.mark.long
def test_a_motion_from_its_file_makes_the_same_trial(tmp_path) -> None:
    config = simulation_config("ramp", SOON).trial
    direct = simulate("ramp", DAISY, config, 4, until_s=UNTIL_S)
    first = simulate("ramp", DAISY, config, 4, until_s=UNTIL_S, motions=tmp_path)
    stored = list(tmp_path.iterdir())
    again = simulate("ramp", DAISY, config, 4, until_s=UNTIL_S, motions=tmp_path)
    assert [file.name for file in stored] == [f"{motion_key('ramp', config, 4, UNTIL_S)}.npz"]
    for other in (first, again):
        np.testing.assert_array_equal(other.frame_qpos, direct.frame_qpos)
        for mine, its in zip(other.measurements, direct.measurements, strict=True):
            assert type(mine) is type(its)
            assert mine.stamp_ns == its.stamp_ns
            for name in ("angular_velocity", "specific_force", "position", "velocity", "effort"):
                np.testing.assert_array_equal(getattr(mine, name, 0.0), getattr(its, name, 0.0))
        np.testing.assert_array_equal(other.vicon.trajectory.T_world_body, direct.vicon.trajectory.T_world_body)
        assert other.truth.ground_contacts == direct.truth.ground_contacts


def test_the_trials_are_those_of_before_there_were_conditions() -> None:
    """Sums of what the sensors measured in a trial of commit b61df84: no option that is off may change a recording."""
    config = simulation_config("ramp", SOON).trial
    trial = simulate("ramp", DAISY, config, 6, until_s=2.0)
    sums: dict[str, float] = {"vicon": float(np.abs(trial.vicon.trajectory.T_world_body).sum())}
    for sample in trial.measurements:
        for name in ("angular_velocity", "specific_force", "position", "velocity", "effort"):
            key = f"{type(sample).__name__}.{name}"
            sums[key] = sums.get(key, 0.0) + float(np.abs(getattr(sample, name, 0.0)).sum())
    expected = {
        "vicon": 1197.1150219651026,
        "ImuSample.angular_velocity": 9.993217,
        "ImuSample.specific_force": 2032.2048,
        "CameraImuSample.angular_velocity": 18.784519,
        "CameraImuSample.specific_force": 4858.2528,
        "JointSample.position": 2149.7638977581337,
        "JointSample.velocity": 438.90466198460496,
        "JointSample.effort": 13781.861584934619,
    }
    assert {key: sums[key] for key in expected} == pytest.approx(expected, rel=1e-6)


def test_a_stored_motion_is_used_for_other_sensors_and_not_for_another_walk(tmp_path, monkeypatch) -> None:
    config = simulation_config("flat", SOON).trial
    simulate("flat", DAISY, config, 4, until_s=1.2, motions=tmp_path)

    def fail(*_: object, **__: object) -> None:
        raise AssertionError("simulated again")

    monkeypatch.setattr(Simulator, "walk", fail)
    sensors = {
        "imperfection": {"camera_turn_rad": 0.05, "wrong_zero_rad": 0.08, "joint_zero_rad": 0.0},
        "imu": {"accelerometer_bias": 0.15},
        "frame_delay_s": 0.03,
    }
    simulate("flat", DAISY, simulation_config("flat", SOON, {"trial": sensors}).trial, 4, until_s=1.2, motions=tmp_path)
    for change in ({"body": {"friction": 0.6}}, {"slip": {"touch_down_s": 0.3}}, {"imperfection": {"mass": 0.0}}):
        other = simulation_config("flat", SOON, {"trial": change}).trial
        with pytest.raises(AssertionError, match="simulated again"):
            simulate("flat", DAISY, other, 4, until_s=1.2, motions=tmp_path)


def test_a_damaged_file_is_named(tmp_path) -> None:
    path = tmp_path / "motion.npz"
    motion = Walk.draw("flat", DAISY, simulation_config("flat", SOON).trial, 1, 1.05).motion()
    write_motion(motion, path)
    assert read_motion(path).ground_contacts == motion.ground_contacts
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(DatasetError, match=r"cannot read the motion .*motion\.npz"):
        read_motion(path)

# SPDX-License-Identifier: BSD-3-Clause
"""Units, axes, clocks and orders that a recording has wrong are corrected as configured, in every format."""

from pathlib import Path

import numpy as np
import pytest

from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.corrections import Corrections, axes_matrix, axes_name, upright
from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.writer import write_leg_log
from coclo_vio.geometry import se3, so3
from coclo_vio.robot.description import load_robot
from coclo_vio.values.errors import ConfigError, DatasetError, TimestampError
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample, Measurement
from coclo_vio.values.trajectory import GroundTruth, Trajectory

_STAMPS_NS = range(5_000_000_000, 5_200_000_000, 10_000_000)
_ROBOT = load_robot("go1")
_ANGLES = np.linspace(-1.0, 1.0, 12)
_RATE, _FORCE = np.array([0.1, -0.2, 0.3]), np.array([0.5, 1.0, 9.7])


def _samples() -> list[Measurement]:
    samples: list[Measurement] = []
    for stamp_ns in _STAMPS_NS:
        samples += [ImuSample(stamp_ns, _RATE, _FORCE), JointSample(stamp_ns, _ANGLES, 0.1 * _ANGLES, 2.0 * _ANGLES)]
    return samples


def _truth() -> GroundTruth:
    stamps_ns = np.array(_STAMPS_NS)
    turns = so3.exp(np.linspace([0.0, 0.0, 0.1], [0.3, 0.2, 1.0], len(stamps_ns)))
    places = np.linspace([0.0, 0.0, 0.3], [1.0, 0.5, 0.3], len(stamps_ns))
    return GroundTruth(Trajectory(stamps_ns, se3.transform(turns, places)), has_stamps=True, source="truth")


def _config(corrections: dict[str, object]) -> DatasetConfig:
    return DatasetConfig.parse({"corrections": corrections}, "test")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return write_leg_log(tmp_path, _ROBOT, _samples(), _truth())


def _read(log: Path, corrections: dict[str, object]) -> list[Measurement]:
    return list(open_dataset(log, _ROBOT, _config(corrections)).measurements())


def test_units_of_an_imu_become_si(log: Path) -> None:
    imu = next(
        s for s in _read(log, {"imu": {"acceleration_unit": "g", "rate_unit": "deg/s"}}) if isinstance(s, ImuSample)
    )
    assert imu.specific_force == pytest.approx(9.81 * _FORCE, rel=1e-3)
    assert imu.angular_velocity == pytest.approx(np.deg2rad(_RATE))


def test_axes_of_an_imu_are_turned_and_its_sign_changed(log: Path) -> None:
    imu = next(s for s in _read(log, {"imu": {"axes": "x -y -z", "acceleration_sign": -1}}) if isinstance(s, ImuSample))
    assert imu.angular_velocity == pytest.approx([0.1, 0.2, -0.3])
    assert imu.specific_force == pytest.approx([-0.5, 1.0, 9.7])


def test_joints_in_degrees_have_velocities_in_degrees_unless_another_unit_is_set(log: Path) -> None:
    joints = next(s for s in _read(log, {"joints": {"position_unit": "deg"}}) if isinstance(s, JointSample))
    assert joints.position == pytest.approx(np.deg2rad(_ANGLES))
    assert joints.velocity == pytest.approx(np.deg2rad(0.1 * _ANGLES))
    in_rpm = {"joints": {"position_unit": "deg", "velocity_unit": "rpm", "effort_factor": -0.5}}
    joints = next(s for s in _read(log, in_rpm) if isinstance(s, JointSample))
    assert joints.velocity == pytest.approx(0.1 * _ANGLES * 2.0 * np.pi / 60.0)
    assert joints.effort == pytest.approx(-_ANGLES)


def test_a_stream_that_is_late_is_merged_at_its_own_time(log: Path) -> None:
    samples = _read(log, {"imu": {"delay_s": 0.034}})
    stamps_ns = [sample.stamp_ns for sample in samples]
    assert stamps_ns == sorted(stamps_ns)
    assert samples[0].stamp_ns == 4_966_000_000
    assert isinstance(samples[0], ImuSample)
    report = open_dataset(log, _ROBOT, _config({"imu": {"delay_s": 0.034}})).report()
    stream = report.stream("imu")
    assert stream is not None
    assert stream.start_ns == 4_966_000_000
    assert any("imu.delay_s = 0.034" in note for note in report.notes)


def test_stamps_in_another_unit_are_converted_and_limited(log: Path) -> None:
    assert _read(log, {"stamp_unit": "us"})[0].stamp_ns == 5_000_000_000_000
    with pytest.raises(TimestampError, match="stamp_unit"):
        _read(log, {"stamp_unit": "s"})


def test_ground_truth_in_millimetres_with_the_scalar_first_is_read_right(tmp_path: Path) -> None:
    truth = _truth().trajectory
    quaternion = np.roll(so3.to_quat_xyzw(truth.rotations), 1, axis=1)
    rows = np.column_stack((truth.stamps_ns / 1e9, 1000.0 * truth.positions, quaternion))
    log = write_leg_log(tmp_path, _ROBOT, _samples())
    (tmp_path / "groundtruth.tum").write_text("\n".join(" ".join(f"{v:.9f}" for v in row) for row in rows) + "\n")
    corrections = {"ground_truth": {"length_unit": "mm", "quaternion": "wxyz"}}
    read = open_dataset(log, _ROBOT, _config(corrections)).ground_truth()
    assert read is not None
    assert read.trajectory.T_world_body == pytest.approx(truth.T_world_body, abs=1e-8)
    assert open_dataset(log, _ROBOT, _config({"ground_truth": {"is_read": False}})).ground_truth() is None


@pytest.mark.parametrize("axes", ["x y", "x y y", "x y -z", "a b c"])
def test_axes_that_are_no_rotation_are_refused(axes: str) -> None:
    with pytest.raises(ConfigError, match="axes"):
        Corrections.parse({"imu": {"axes": axes}}, "test")


@pytest.mark.parametrize("axes", ["x y z", "x -y -z", "y -x z", "-z y x"])
def test_axes_have_a_name_and_back(axes: str) -> None:
    assert axes_name(axes_matrix(axes)) == axes


def test_order_and_signs_of_joints_are_corrected_and_a_joint_left_out(log: Path) -> None:
    names = _ROBOT.joint_names
    how = {"order": {names[0]: names[4], names[4]: names[0]}, "signs": {names[1]: -1}, "left_out": [names[2]]}
    joints = next(s for s in _read(log, {"joints": how}) if isinstance(s, JointSample))
    expected = _ANGLES.copy()
    expected[[0, 4]] = _ANGLES[[4, 0]]
    expected[1] *= -1.0
    expected[2] = np.nan
    assert joints.position == pytest.approx(expected, nan_ok=True)
    assert joints.velocity == pytest.approx(0.1 * expected, nan_ok=True)
    assert joints.effort == pytest.approx(2.0 * expected, nan_ok=True)


def test_a_correction_of_a_joint_that_the_robot_lacks_is_refused(log: Path) -> None:
    with pytest.raises(DatasetError, match=r"knee_9, no joint of the robot; its joints are"):
        _read(log, {"joints": {"signs": {"knee_9": -1}}})


def test_velocities_can_be_estimated_from_the_angles_instead(tmp_path: Path) -> None:
    angles = [_ANGLES + 0.02 * i for i in range(6)]
    stamps = [5_000_000_000 + 10_000_000 * i for i in range(6)]
    samples = [JointSample(t, q, 9.0 * q, q) for t, q in zip(stamps, angles, strict=True)]
    log = write_leg_log(tmp_path, _ROBOT, samples)
    read = [s for s in _read(log, {"joints": {"velocity": "from_position"}}) if isinstance(s, JointSample)]
    assert np.isnan(read[0].velocity).all()
    assert read[-1].velocity == pytest.approx(np.full(len(_ANGLES), 2.0))
    assert read[-1].effort == pytest.approx(angles[-1])


def test_forces_are_put_in_order_and_multiplied(tmp_path: Path) -> None:
    force = np.arange(1.0, 1.0 + len(_ROBOT.leg_names))
    log = write_leg_log(tmp_path, _ROBOT, [*_samples()[:2], FootForceSample(_STAMPS_NS[1], force)])
    how = {"foot_force": {"factor": -2.0, "order": {"FL": "FR", "FR": "FL"}}}
    read = next(s for s in _read(log, how) if isinstance(s, FootForceSample))
    assert read.force == pytest.approx(-2.0 * force[[1, 0, 2, 3]])
    with pytest.raises(DatasetError, match="no leg of the robot; its legs are"):
        _read(log, {"foot_force": {"order": {"FL": "front"}}})


@pytest.mark.parametrize("up", ["x", "-x", "y", "-y", "z", "-z"])
def test_a_world_of_another_upward_axis_is_turned_upright(tmp_path: Path, up: str) -> None:
    truth = _truth().trajectory
    turn = upright(up)
    assert turn @ turn.T == pytest.approx(np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1.0)
    moved = truth.moved(se3.transform(turn.T, np.zeros(3)))
    log = write_leg_log(tmp_path, _ROBOT, _samples(), GroundTruth(moved, has_stamps=True, source="truth"))
    read = open_dataset(log, _ROBOT, _config({"ground_truth": {"up": up}})).ground_truth()
    assert read is not None
    assert read.trajectory.T_world_body == pytest.approx(truth.T_world_body, abs=1e-9)


def test_stamps_of_the_ground_truth_are_scaled_and_jumps_left_out(tmp_path: Path) -> None:
    truth = _truth().trajectory
    places = truth.positions.copy()
    places[2] += [30.0, 0.0, 0.0]
    slow = Trajectory(1000 * truth.stamps_ns, se3.transform(truth.rotations, places))
    log = write_leg_log(tmp_path, _ROBOT, _samples(), GroundTruth(slow, has_stamps=True, source="truth"))
    how = {"ground_truth": {"stamp_factor": 0.001, "drops_jumps": True}}
    dataset = open_dataset(log, _ROBOT, _config(how))
    assert dataset.report().dropped["ground truth: pose that jumps"] == 1
    read = dataset.ground_truth()
    assert read is not None
    assert read.trajectory.stamps_ns.tolist() == np.delete(truth.stamps_ns, 2).tolist()

# SPDX-License-Identifier: BSD-3-Clause
from pathlib import Path

import numpy as np
import pytest

from coclo_vio.datasets.contents import RecordingContents
from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.writer import write_euroc_folder
from coclo_vio.errors import DatasetError, TopicNotFound
from coclo_vio.geometry import se3, so3
from coclo_vio.measurements import ImuSample, JointSample

YAML = """%YAML:1.0
sensor_type: imu
T_BS: !!opencv-matrix
  cols: 4
  rows: 4
  data: [0.0, -1.0, 0.0, 0.1,
         1.0, 0.0, 0.0, 0.2,
         0.0, 0.0, 1.0, 0.3,
         0.0, 0.0, 0.0, 1.0]
gyroscope_noise_density: 1.6968e-04     # [ rad / s / sqrt(Hz) ]
accelerometer_random_walk: 3.0000e-3
"""


@pytest.fixture
def folder(tmp_path, biped, log):
    write_euroc_folder(tmp_path, RecordingContents(biped, log))
    return tmp_path


def test_mav0_itself_and_the_folder_around_it_are_the_same(folder, biped, log, assert_same):
    for path in (folder, folder / "mav0"):
        dataset = open_dataset(path, biped)
        assert dataset.name == folder.name
        assert_same(dataset.measurements(), log)


def test_mav0_may_be_the_current_folder(folder, biped, monkeypatch):
    (folder / "groundtruth.tum").write_text("0.5 1 2 3 0 0 0 1\n")
    monkeypatch.chdir(folder / "mav0")
    dataset = open_dataset(Path(), biped)
    assert dataset.name == folder.name
    assert dataset.ground_truth().source == "groundtruth.tum"


def test_without_joints_the_imu_is_read_and_the_absence_noted(folder, biped):
    for sensor in ("joints0", "foot_force0"):
        (folder / "mav0" / sensor / "data.csv").unlink()
    dataset = open_dataset(folder, biped)
    assert {type(sample) for sample in dataset.measurements()} == {ImuSample}
    assert "joints0/data.csv is absent" in dataset.report().notes


def test_without_a_robot_the_joints_are_left_unread(folder):
    dataset = open_dataset(folder, None)
    assert {type(sample) for sample in dataset.measurements()} == {ImuSample}
    assert any("no robot was named" in note for note in dataset.report().notes)
    (folder / "mav0" / "imu0" / "data.csv").unlink()
    with pytest.raises(DatasetError, match="imu0 is absent"):
        open_dataset(folder, None)


def test_missing_columns_are_named(folder, biped):
    joints = folder / "mav0" / "joints0" / "data.csv"
    joints.write_text(joints.read_text().replace("left_hip_joint.position", "left.position"))
    with pytest.raises(TopicNotFound, match="no angle of left_hip_joint"):
        open_dataset(folder, biped)
    imu = folder / "mav0" / "imu0" / "data.csv"
    imu.write_text("#timestamp [ns],filename\n1,1.png\n")
    with pytest.raises(TopicNotFound, match="no IMU column among filename, timestamp"):
        open_dataset(folder, None)


def test_joints_are_found_under_aliases_and_with_units(folder, biped):
    joints = folder / "mav0" / "joints0" / "data.csv"
    text = (
        joints.read_text().replace("_joint.position", ".position [rad]").replace("_joint.velocity", ".velocity [rad/s]")
    )
    joints.write_text(text)
    found = [sample for sample in open_dataset(folder, biped).measurements() if isinstance(sample, JointSample)]
    assert np.isfinite(found[0].position).all()
    assert np.isfinite(found[0].velocity).all()


def test_each_file_may_be_cut_off(folder, biped):
    for sensor in ("imu0", "joints0", "foot_force0"):
        path = folder / "mav0" / sensor / "data.csv"
        path.write_text(path.read_text().rsplit(",", 1)[0])
    report = open_dataset(folder, biped).report()
    assert report.dropped == {f"{s}/data.csv: last line cut off": 1 for s in ("imu0", "joints0", "foot_force0")}
    assert [stream.samples for stream in report.streams] == [19, 39, 19]


def test_sensor_yaml_gives_noise_and_mounting(folder, biped):
    path = folder / "mav0" / "imu0" / "sensor.yaml"
    assert open_dataset(folder, biped).imu_calibration() is None
    path.write_text(YAML)
    imu = open_dataset(folder, biped).imu_calibration()
    assert (imu.gyroscope_noise_density, imu.accelerometer_bias_walk) == (1.6968e-4, 3e-3)
    np.testing.assert_allclose(
        imu.T_body_imu, se3.transform(so3.about_z(np.pi / 2), np.array([0.1, 0.2, 0.3])), atol=1e-15
    )


@pytest.mark.parametrize(
    ("broken", "said"),
    [
        (YAML.replace("0.3,", "0.3, 7.0,"), "4 x 4 numbers"),
        (YAML.replace("-1.0", "1.0"), "holds no rotation"),
        ("[1, 2]", "must hold a mapping"),
        ("a: [1", "cannot read"),
    ],
)
def test_a_broken_sensor_yaml_is_one_sentence(folder, biped, broken, said):
    (folder / "mav0" / "imu0" / "sensor.yaml").write_text(broken)
    with pytest.raises(DatasetError, match=said):
        open_dataset(folder, biped).imu_calibration()


def test_poses_of_a_vicon_marker_are_moved_to_the_body(folder, biped):
    vicon = folder / "mav0" / "vicon0"
    vicon.mkdir()
    header = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"
    (vicon / "data.csv").write_text(f"{header}\n5,1,2,3,1,0,0,0\n")
    (vicon / "sensor.yaml").write_text(YAML)
    truth = open_dataset(folder, biped).ground_truth()
    assert truth.source == "vicon0/data.csv"
    T_body_marker = se3.transform(so3.about_z(np.pi / 2), np.array([0.1, 0.2, 0.3]))
    T_world_marker = truth.trajectory.T_world_body[0] @ T_body_marker
    np.testing.assert_allclose(T_world_marker, se3.transform(np.eye(3), np.array([1.0, 2.0, 3.0])), atol=1e-15)


def test_euroc_v1_01_as_it_is(shared_data, biped):
    dataset = open_dataset(shared_data / "euroc_v1_01_start", biped)
    imu = dataset.report().stream("imu")
    assert imu.samples == 29_120
    assert imu.rate_hz == pytest.approx(200, abs=0.1)
    assert imu.duration_s == pytest.approx(145.6, abs=0.1)
    first = next(dataset.measurements())
    assert first.stamp_ns == 1403715273262142976
    assert first.angular_velocity[2] == 0.07749261878854824
    assert first.specific_force[2] == -3.6938381666666662
    assert dataset.imu_calibration().gyroscope_noise_density == 1.6968e-4
    truth = dataset.ground_truth()
    assert truth.has_stamps
    assert len(truth.trajectory) == 28_712
    assert truth.trajectory.path_length_m() == pytest.approx(58.4, abs=1.0)

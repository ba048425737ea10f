# SPDX-License-Identifier: BSD-3-Clause
from pathlib import Path

import numpy as np
import pytest

from coclo_vio.datasets import images
from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.euroc_sensor import read_imu, write_imu
from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.writer import write_euroc_folder
from coclo_vio.geometry import se3, so3
from coclo_vio.values.calibration import ImuCalibration
from coclo_vio.values.errors import DatasetError, TopicNotFound
from coclo_vio.values.measurements import ALL_SENSORS, ImuSample, JointSample, StereoFrame

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


def test_without_a_robot_the_joints_are_not_read(folder):
    dataset = open_dataset(folder, None)
    assert {type(sample) for sample in dataset.measurements()} == {ImuSample}
    assert any("no robot was named" in note for note in dataset.report().notes)
    (folder / "mav0" / "imu0" / "data.csv").unlink()
    with pytest.raises(DatasetError, match="imu0 and imu1 are absent"):
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


def test_sensor_yaml_holds_noise_and_mounting(folder, biped):
    path = folder / "mav0" / "imu0" / "sensor.yaml"
    assert open_dataset(folder, biped).imu_calibration() is None
    path.write_text(YAML)
    imu = open_dataset(folder, biped).imu_calibration()
    assert (imu.gyroscope_noise_density, imu.accelerometer_bias_walk) == (1.6968e-4, 3e-3)
    np.testing.assert_allclose(
        imu.T_body_imu, se3.transform(so3.about_z(np.pi / 2), np.array([0.1, 0.2, 0.3])), atol=1e-15
    )


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (YAML.replace("0.3,", "0.3, 7.0,"), "4 x 4 numbers"),
        (YAML.replace("-1.0", "1.0"), "is not orthonormal"),
        ("[1, 2]", "must hold a mapping"),
        ("a: [1", "is not YAML"),
    ],
)
def test_a_broken_sensor_yaml_is_one_sentence(folder, biped, broken, message):
    (folder / "mav0" / "imu0" / "sensor.yaml").write_text(broken)
    with pytest.raises(DatasetError, match=message):
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


POSE = "p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"
PUBLISHED = {
    "imu0/data.csv": "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\r\n"
    "1403636579758555392,-0.1,0.15,0.03,8.2,-0.38,-2.4\r\n1403636579763555584,-0.1,0.14,0.03,8.1,-0.36,-2.5\r\n",
    "cam0/data.csv": "#timestamp [ns],filename\r\n1403636579763555584,1403636579763555584.png\r\n",
    "cam1/data.csv": "#timestamp [ns],filename\r\n1403636579763555584,1403636579763555584.png\r\n"
    "1403636579813555456,1403636579813555456.png\r\n",
    "leica0/data.csv": "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m]\n1403636578770000128,4.8,-1.8,0.8\n",
    "state_groundtruth_estimate0/data.csv": f"#timestamp, {POSE}, v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], "
    "v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], "
    "b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]\r\n1403636580838555648,4.69,-1.79,0.78,0.53,-0.15,-0.83,-0.08,-0.03,"
    "0.03,0.8,-0.003,0.02,0.08,-0.02,0.14,0.08\r\n",
    "state_groundtruth_estimate0/sensor.yaml": "%YAML:1.0\n# General sensor definitions.\n"
    "sensor_type: visual-inertial\ncomment: The nonlinear least-squares batch solution.\nT_BS:\n  cols: 4\n  rows: 4\n"
    "  data: [1.0, 0.0, 0.0, 0.0,\n         0.0, 1.0, 0.0, 0.0,\n         0.0, 0.0, 1.0, 0.0,\n"
    "         0.0, 0.0, 0.0, 1.0]\n",
    "body.yaml": "%YAML:1.0\ncomment: Asctec Firefly MAV\n",
}


@pytest.fixture
def published(tmp_path):
    """A folder with the headers, line ends and files of the published sequences, cut to a few rows."""
    image = images.encoded(np.full((4, 6), 80, dtype=np.uint8), "png")
    for name, text in PUBLISHED.items():
        path = tmp_path / "MH_01_easy" / "mav0" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text.encode("ascii"))
        if name.startswith("cam"):
            (path.parent / "data").mkdir()
            (path.parent / "data" / "1403636579763555584.png").write_bytes(image)
    return tmp_path / "MH_01_easy"


def test_the_files_of_the_published_sequences_are_read(published):
    dataset = open_dataset(published, None)
    kinds = [type(sample) for sample in dataset.measurements(ALL_SENSORS)]
    assert kinds == [ImuSample, ImuSample, StereoFrame]
    truth = dataset.ground_truth()
    assert (dataset.name, truth.source) == ("MH_01_easy", "state_groundtruth_estimate0/data.csv")
    np.testing.assert_array_equal(truth.trajectory.velocity_world, [[-0.03, 0.03, 0.8]])
    report = dataset.report()
    assert report.dropped == {"cam1/data.csv: image file is missing": 1}
    assert sorted(report.notes) == [
        "cam1/data.csv names 1 images whose files are missing: 1403636579813555456.png",
        "joints0/data.csv is absent",
        "the body frame is the one that T_BS of each sensor.yaml refers to, whatever its axes",
    ]


def test_positions_of_a_prism_are_not_ground_truth_and_that_is_noted(published):
    (published / "mav0" / "state_groundtruth_estimate0" / "data.csv").unlink()
    dataset = open_dataset(published, None)
    assert dataset.ground_truth() is None
    assert "leica0/data.csv is not read: it holds positions of a prism, not poses of the body" in dataset.report().notes


def test_the_truth_of_v1_01_is_of_the_imu_in_a_world_that_is_z_up(shared_data):
    """Over the flight the specific force points up; of any other pair of frames it would not."""
    dataset = open_dataset(shared_data / "euroc_v1_01_start", None)
    truth = dataset.ground_truth().trajectory
    samples = [sample for sample in dataset.measurements() if isinstance(sample, ImuSample)][400:28_000:20]
    rotations = truth.interpolated(np.array([sample.stamp_ns for sample in samples])).rotations
    force = np.einsum("nij,nj->ni", rotations, [sample.specific_force for sample in samples]).mean(axis=0)
    assert np.rad2deg(np.arccos(force[2] / np.linalg.norm(force))) < 2.5
    assert force[2] == pytest.approx(9.8, abs=0.1)


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


def test_grade_and_bias_sigmas_of_an_imu_are_kept_where_they_are_given(tmp_path: Path) -> None:
    cheap = ImuCalibration()
    for imu in (ImuCalibration(grade="calibrated_mems", accelerometer_bias=0.01), cheap):
        write_imu(tmp_path, imu)
        assert read_imu(tmp_path / "sensor.yaml") == imu
    assert "grade" not in (tmp_path / "sensor.yaml").read_text()


def test_halves_of_an_imu_in_folders_of_their_own_are_refused_by_name(tmp_path):
    for name, columns in (("gyro0", "w_RS_S_x,w_RS_S_y,w_RS_S_z"), ("accel0", "a_RS_S_x,a_RS_S_y,a_RS_S_z")):
        (tmp_path / "mav0" / name).mkdir(parents=True)
        (tmp_path / "mav0" / name / "data.csv").write_text(f"#timestamp [ns],{columns}\n1,0,0,0\n")
    (tmp_path / "mav0" / "imu1").mkdir()
    (tmp_path / "mav0" / "imu1" / "data.csv").write_text("#timestamp [ns],w_RS_S_x,w_RS_S_y,w_RS_S_z\n1,0,0,0\n")
    with pytest.raises(TopicNotFound, match="has 3 of the 6 IMU columns, w_RS_S_x, w_RS_S_y, w_RS_S_z"):
        open_dataset(tmp_path, None)
    (tmp_path / "mav0" / "imu1" / "data.csv").write_text(
        "#timestamp [ns],w_RS_S_x,w_RS_S_y,w_RS_S_z,a_RS_S_x,a_RS_S_y,a_RS_S_z\n1,0,0,0,0,0,9.81\n"
    )
    notes = open_dataset(tmp_path, None).report().notes
    assert any("imu0/data.csv is absent, and accel0, gyro0 are halves of one" in note for note in notes)

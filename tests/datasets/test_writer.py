# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coclo_vio.datasets.dataset import DatasetConfig, open_dataset
from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.writer import RecordedJoints, write_euroc_folder, write_leg_log
from coclo_vio.geometry import se3, so3
from coclo_vio.values.calibration import ImuCalibration
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.measurements import ALL_SENSORS, CameraImuSample, FootForceSample, ImuSample, JointSample
from coclo_vio.values.trajectory import GroundTruth, Trajectory


def to_euroc_folder(folder, robot, measurements, ground_truth=None, **options):
    return write_euroc_folder(folder, RecordingContents(robot, measurements, ground_truth), **options)


FOLDER_WRITERS = [write_leg_log, to_euroc_folder]


@pytest.fixture
def truth() -> GroundTruth:
    rng = np.random.default_rng(5)
    stamps_ns = 1_403_715_273_262_142_977 + np.cumsum(rng.integers(1, 10_000_000, size=20))
    poses = se3.transform(so3.exp(rng.normal(size=(20, 3))), rng.normal(size=(20, 3)))
    return GroundTruth(Trajectory(stamps_ns, poses, rng.normal(size=(20, 3))), has_stamps=True, source="made")


@pytest.mark.parametrize("write", FOLDER_WRITERS)
def test_a_log_written_and_read_back_is_equal_value_by_value(write, tmp_path, biped, log, assert_same):
    write(tmp_path, biped, log)
    dataset = open_dataset(tmp_path, biped)
    assert_same(dataset.measurements(), log)
    assert dataset.report().dropped == {}
    assert dataset.ground_truth() is None


def samples_of_biped():
    any_float = st.floats(allow_infinity=False, allow_nan=True)
    finite = st.floats(allow_infinity=False, allow_nan=False)

    def vector(size, element):
        return st.lists(element, min_size=size, max_size=size)

    stamp = st.integers(min_value=-20, max_value=20)
    return st.lists(
        st.one_of(
            st.builds(ImuSample, stamp, vector(3, finite), vector(3, finite)),
            st.builds(FootForceSample, stamp, vector(2, any_float)),
            st.builds(JointSample, stamp, vector(4, any_float), vector(4, any_float), vector(4, any_float)),
        ),
        min_size=1,
        max_size=12,
    )


def test_any_order_of_stamps_and_any_float_survives_the_leg_log(tmp_path, biped, assert_same):
    @settings(max_examples=150, deadline=None, derandomize=True)
    @given(samples_of_biped())
    def survives(samples):
        write_leg_log(tmp_path, biped, samples)
        assert_same(open_dataset(tmp_path, biped).measurements(), samples)

    survives()


def test_ground_truth_survives_the_leg_log(tmp_path, biped, log, truth):
    write_leg_log(tmp_path, biped, log, truth)
    back = open_dataset(tmp_path, biped).ground_truth()
    assert back.has_stamps
    np.testing.assert_array_equal(back.trajectory.stamps_ns, truth.trajectory.stamps_ns)
    np.testing.assert_allclose(back.trajectory.T_world_body, truth.trajectory.T_world_body, atol=1e-11)


def test_ground_truth_with_velocity_survives_the_euroc_folder(tmp_path, biped, log, truth):
    to_euroc_folder(tmp_path, biped, log, truth)
    back = open_dataset(tmp_path, biped).ground_truth()
    np.testing.assert_array_equal(back.trajectory.stamps_ns, truth.trajectory.stamps_ns)
    np.testing.assert_array_equal(back.trajectory.positions, truth.trajectory.positions)
    np.testing.assert_array_equal(back.trajectory.velocity_world, truth.trajectory.velocity_world)
    np.testing.assert_allclose(back.trajectory.rotations, truth.trajectory.rotations, atol=1e-15)


def test_ground_truth_without_stamps_goes_to_a_leg_log_and_not_to_euroc(tmp_path, biped, log, truth):
    unstamped = GroundTruth(truth.trajectory, has_stamps=False, source="mocap")
    write_leg_log(tmp_path / "log", biped, log, unstamped)
    back = open_dataset(tmp_path / "log", biped).ground_truth()
    assert not back.has_stamps
    np.testing.assert_array_equal(back.trajectory.positions, truth.trajectory.positions)
    with pytest.raises(DatasetError, match="cannot hold ground truth without stamps"):
        to_euroc_folder(tmp_path / "euroc", biped, log, unstamped)


@pytest.mark.parametrize("write", FOLDER_WRITERS)
def test_columns_left_out_are_absent_when_read_back(write, tmp_path, biped, log):
    write(tmp_path, biped, log, joints=RecordedJoints(with_velocity=False, with_effort=False))
    dataset = open_dataset(tmp_path, biped, DatasetConfig.parse({"joint_velocity": {"window_s": 0.02}}, "test"))
    joints = [sample for sample in dataset.measurements() if isinstance(sample, JointSample)]
    assert np.isfinite(joints[3].velocity).all()
    assert all(np.isnan(sample.effort).all() for sample in joints)
    assert len([note for note in dataset.report().notes if "no joint" in note]) == 2


def test_imu_calibration_survives_the_euroc_folder(tmp_path, biped, log):
    imu = ImuCalibration(
        position_body_m=(0.1, -0.2, 0.3),
        rotation_body_imu_rpy_rad=(0.4, -0.5, 2.6),
        gyroscope_noise_density=1.7e-4,
        accelerometer_bias_walk=0.0,
    )
    write_euroc_folder(tmp_path, RecordingContents(biped, log, imu=imu))
    back = open_dataset(tmp_path, biped).imu_calibration()
    np.testing.assert_allclose(back.T_body_imu, imu.T_body_imu, atol=1e-14)
    assert back.model_dump(exclude={"rotation_body_imu_rpy_rad"}) == imu.model_dump(
        exclude={"rotation_body_imu_rpy_rad"}
    )


@pytest.mark.parametrize("write", FOLDER_WRITERS)
def test_a_folder_that_cannot_be_written_is_one_sentence(write, tmp_path, biped, log):
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(DatasetError, match="choose another folder"):
        write(tmp_path / "taken", biped, log)


def test_a_recording_with_cameras_survives_the_euroc_folder_value_by_value(
    tmp_path, full_recording, decoded_stream, assert_same
):
    write_euroc_folder(tmp_path, full_recording)
    dataset = open_dataset(tmp_path, full_recording.robot)
    assert_same(dataset.measurements(ALL_SENSORS), decoded_stream(full_recording))
    assert dataset.report().dropped == {}
    assert dataset.report().stream("stereo").samples == 5
    assert dataset.stereo_calibration() == full_recording.stereo
    np.testing.assert_allclose(dataset.imu_calibration().T_body_imu, full_recording.imu.T_body_imu, atol=1e-15)
    np.testing.assert_allclose(
        dataset.camera_imu_calibration().T_body_imu, full_recording.camera_imu.T_body_imu, atol=1e-15
    )


def test_image_files_are_written_as_they_came(tmp_path, full_recording):
    mav0 = write_euroc_folder(tmp_path, full_recording)
    for frame in full_recording.frames:
        assert (mav0 / "cam0" / "data" / f"{frame.stamp_ns}.png").read_bytes() == frame.left
        assert (mav0 / "cam1" / "data" / f"{frame.stamp_ns}.png").read_bytes() == frame.right


def test_a_folder_that_holds_a_recording_is_not_written_over(tmp_path, biped, log):
    to_euroc_folder(tmp_path, biped, log)
    before = (tmp_path / "mav0" / "imu0" / "data.csv").read_bytes()
    with pytest.raises(DatasetError, match=r"mav0 exists already; delete it, or choose another folder"):
        to_euroc_folder(tmp_path, biped, log[:5])
    assert (tmp_path / "mav0" / "imu0" / "data.csv").read_bytes() == before


def test_a_leg_log_cannot_hold_a_cameras_imu(tmp_path, biped):
    with pytest.raises(DatasetError, match="write an EuRoC folder or a bag"):
        write_leg_log(tmp_path, biped, [CameraImuSample(5, np.zeros(3), np.ones(3))])

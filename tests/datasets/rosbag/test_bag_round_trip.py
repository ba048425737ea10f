# SPDX-License-Identifier: BSD-3-Clause
"""A bag and a folder written from the same contents are the same recording."""

import numpy as np
import pytest

from coclo_vio.datasets.dataset import guess_robot, open_dataset
from coclo_vio.datasets.rosbag.writing.bag_writer import write_bag
from coclo_vio.datasets.writer import RecordedJoints, write_euroc_folder
from coclo_vio.robot.description import load_robot
from coclo_vio.values.measurements import ALL_SENSORS, JointSample

NAMES = ["trial.bag", "trial.mcap", "trial.db3", "trial"]


@pytest.fixture(params=NAMES)
def pair(request, tmp_path, full_recording):
    """The bag and the folder, opened."""
    bag = write_bag(tmp_path / "bags" / request.param, full_recording)
    folder = write_euroc_folder(tmp_path / "folder", full_recording)
    return open_dataset(bag, full_recording.robot), open_dataset(folder, full_recording.robot)


def test_all_samples_are_equal_value_by_value(pair, full_recording, decoded_stream, assert_same):
    bag, folder = pair
    assert_same(bag.measurements(ALL_SENSORS), decoded_stream(full_recording))
    assert_same(folder.measurements(ALL_SENSORS), decoded_stream(full_recording))
    assert bag.report().dropped == {}
    assert bag.report().streams == folder.report().streams


def test_ground_truth_is_equal(pair):
    bag, folder = (dataset.ground_truth() for dataset in pair)
    assert bag.has_stamps
    np.testing.assert_array_equal(bag.trajectory.stamps_ns, folder.trajectory.stamps_ns)
    np.testing.assert_array_equal(bag.trajectory.T_world_body, folder.trajectory.T_world_body)


def test_calibrations_are_those_of_the_contents(pair, full_recording):
    for dataset in pair:
        stereo = dataset.stereo_calibration()
        assert (stereo.left, stereo.right) == (full_recording.stereo.left, full_recording.stereo.right)
        np.testing.assert_allclose(stereo.T_body_left_camera, full_recording.stereo.T_body_left_camera, atol=1e-12)
        np.testing.assert_allclose(stereo.T_body_right_camera, full_recording.stereo.T_body_right_camera, atol=1e-12)
        np.testing.assert_allclose(dataset.imu_calibration().T_body_imu, full_recording.imu.T_body_imu, atol=1e-12)
        mounting = dataset.camera_imu_calibration().T_body_imu
        np.testing.assert_allclose(mounting, full_recording.camera_imu.T_body_imu, atol=1e-12)


def test_readings_left_out_are_absent_in_both(tmp_path, full_recording):
    joints = RecordedJoints(with_velocity=False, with_effort=False)
    bag = open_dataset(write_bag(tmp_path / "a.mcap", full_recording, joints=joints), full_recording.robot)
    folder = open_dataset(write_euroc_folder(tmp_path / "a", full_recording, joints=joints), full_recording.robot)
    for mine, theirs in zip(bag.measurements(), folder.measurements(), strict=True):
        if isinstance(mine, JointSample):
            assert np.isnan(mine.effort).all()
            np.testing.assert_array_equal(mine.velocity, theirs.velocity)


def test_the_robot_is_guessed_from_a_bag(tmp_path, full_recording):
    robot = load_robot("daisy")
    sample = JointSample(5, *np.zeros((3, 18)))
    contents = type(full_recording)(robot, [sample])
    assert guess_robot(write_bag(tmp_path / "a.bag", contents)) == "daisy"

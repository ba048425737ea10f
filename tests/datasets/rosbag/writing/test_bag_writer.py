# SPDX-License-Identifier: BSD-3-Clause
"""Written bags, read with the reader of rosbags."""

import dataclasses
from collections import defaultdict

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.rosbag.writing.bag_writer import write_bag
from coclo_vio.datasets.writer import RecordedJoints
from coclo_vio.geometry import se3, so3
from coclo_vio.values.errors import DatasetError, TimestampError
from coclo_vio.values.measurements import CameraImuSample, FootForceSample, ImuSample, JointSample, StereoFrame
from coclo_vio.values.trajectory import GroundTruth

NAMES = ["trial.bag", "trial.mcap", "trial.db3", "trial"]


def read(path):
    """Messages by topic as (received ns, message)."""
    messages = defaultdict(list)
    with AnyReader([path]) as reader:
        for connection, stamp_ns, raw in reader.messages():
            messages[connection.topic].append((stamp_ns, reader.deserialize(raw, connection.msgtype)))
    return messages


def header_ns(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def samples_of(contents, kind):
    return [sample for sample in contents.measurements if type(sample) is kind]


def xyz(vector):
    return [vector.x, vector.y, vector.z]


def transform_of(message):
    t, q = message.transform.translation, message.transform.rotation
    return se3.transform(so3.from_quat_xyzw(np.array([q.x, q.y, q.z, q.w])), np.array(xyz(t)))


@pytest.fixture(params=NAMES)
def bag(request, tmp_path, full_recording):
    return read(write_bag(tmp_path / request.param, full_recording))


def test_every_stamp_is_exact_in_the_header_and_in_the_bag(bag, full_recording):
    stamps = {
        "/joint_states": [sample.stamp_ns for sample in samples_of(full_recording, JointSample)],
        "/imu": [sample.stamp_ns for sample in samples_of(full_recording, ImuSample)],
        "/camera/imu": [sample.stamp_ns for sample in samples_of(full_recording, CameraImuSample)],
        "/foot_force/left": [sample.stamp_ns for sample in samples_of(full_recording, FootForceSample)],
        "/foot_force/right": [sample.stamp_ns for sample in samples_of(full_recording, FootForceSample)],
        "/vicon/biped/biped": full_recording.ground_truth.trajectory.stamps_ns.tolist(),
    }
    frames = [frame.stamp_ns for frame in full_recording.frames]
    for camera in ("/camera/infra1", "/camera/infra2"):
        stamps |= {f"{camera}/camera_info": frames, f"{camera}/image_rect_raw/compressed": frames}
    assert {
        topic: [stamp for stamp, _ in messages] for topic, messages in bag.items() if topic != "/tf_static"
    } == stamps
    for topic in stamps:
        assert [header_ns(message) for _, message in bag[topic]] == stamps[topic]


def test_readings_survive_to_the_last_bit(bag, full_recording, biped):
    for kind, topic in ((ImuSample, "/imu"), (CameraImuSample, "/camera/imu")):
        for sample, (_, message) in zip(samples_of(full_recording, kind), bag[topic], strict=True):
            np.testing.assert_array_equal(xyz(message.angular_velocity), sample.angular_velocity)
            np.testing.assert_array_equal(xyz(message.linear_acceleration), sample.specific_force)
    for sample, (_, message) in zip(samples_of(full_recording, JointSample), bag["/joint_states"], strict=True):
        assert tuple(message.name) == biped.joint_names
        for name in ("position", "velocity", "effort"):
            np.testing.assert_array_equal(getattr(message, name), getattr(sample, name))
    for leg, topic in enumerate(("/foot_force/left", "/foot_force/right")):
        forces = [message.wrench.force.z for _, message in bag[topic]]
        np.testing.assert_array_equal(
            forces, [sample.force[leg] for sample in samples_of(full_recording, FootForceSample)]
        )


def test_images_are_written_as_encoded(bag, full_recording):
    for number, side in ((1, "left"), (2, "right")):
        messages = bag[f"/camera/infra{number}/image_rect_raw/compressed"]
        for frame, (_, message) in zip(full_recording.frames, messages, strict=True):
            assert bytes(message.data) == getattr(frame, side)
            assert message.format == "png"
            assert message.header.frame_id == f"camera_infra{number}_optical_frame"


def test_camera_info_describes_a_rectified_pair(bag, full_recording):
    for number, shift in ((1, 0.0), (2, -9.5 * 0.05)):
        info = bag[f"/camera/infra{number}/camera_info"][0][1]
        K, P, D = (getattr(info, name, getattr(info, name.lower(), None)) for name in "KPD")
        np.testing.assert_array_equal(np.reshape(K, (3, 3)), full_recording.stereo.left.camera_matrix)
        np.testing.assert_allclose(np.reshape(P, (3, 4))[:, 3], [shift, 0.0, 0.0], atol=1e-12)
        assert (info.distortion_model, list(D)) == ("plumb_bob", [0.0] * 5)
        assert (info.width, info.height) == (16, 12)


def test_mountings_are_transforms_from_the_body(bag, full_recording):
    [(stamp_ns, message)] = bag["/tf_static"]
    assert stamp_ns == full_recording.ground_truth.trajectory.stamps_ns[0]  # the first of all
    found = {one.child_frame_id: transform_of(one) for one in message.transforms}
    assert {one.header.frame_id for one in message.transforms} == {"base_link"}
    expected = {
        "imu_link": full_recording.imu.T_body_imu,
        "camera_imu_optical_frame": full_recording.camera_imu.T_body_imu,
        "camera_infra1_optical_frame": full_recording.stereo.T_body_left_camera,
        "camera_infra2_optical_frame": full_recording.stereo.T_body_right_camera,
    }
    assert set(found) == set(expected)
    for frame, T_body_frame in expected.items():
        np.testing.assert_allclose(found[frame], T_body_frame, atol=1e-15)


def test_ground_truth_is_the_body_in_the_vicon_frame(bag, full_recording):
    truth = full_recording.ground_truth.trajectory
    got = np.array([transform_of(message) for _, message in bag["/vicon/biped/biped"]])
    np.testing.assert_array_equal(got[:, :3, 3], truth.positions)
    np.testing.assert_allclose(got, truth.T_world_body, atol=1e-15)
    _, first = bag["/vicon/biped/biped"][0]
    assert (first.header.frame_id, first.child_frame_id) == ("vicon", "base_link")


def test_imu_variance_is_density_squared_times_rate(bag, full_recording):
    for topic, rate_hz in (("/imu", 1e9 / 5_000_001), ("/camera/imu", 1e9 / 4_000_003)):
        message = bag[topic][0][1]
        gyroscope = np.reshape(message.angular_velocity_covariance, (3, 3))
        accelerometer = np.reshape(message.linear_acceleration_covariance, (3, 3))
        np.testing.assert_allclose(
            gyroscope, np.eye(3) * full_recording.imu.gyroscope_noise_density**2 * rate_hz, rtol=1e-12
        )
        np.testing.assert_allclose(
            accelerometer, np.eye(3) * full_recording.imu.accelerometer_noise_density**2 * rate_hz, rtol=1e-12
        )
        assert message.orientation_covariance[0] == -1.0


def test_an_unknown_calibration_is_not_written(tmp_path, biped, log):
    bag = read(write_bag(tmp_path / "bare.mcap", RecordingContents(biped, log)))
    assert set(bag) == {"/imu", "/joint_states", "/foot_force/left", "/foot_force/right"}
    assert not bag["/imu"][0][1].angular_velocity_covariance.any()


def test_readings_left_out_are_empty_arrays(tmp_path, biped, log):
    contents = RecordingContents(biped, log)
    bag = read(write_bag(tmp_path / "a.bag", contents, joints=RecordedJoints(with_velocity=False, with_effort=False)))
    message = bag["/joint_states"][0][1]
    assert (len(message.position), len(message.velocity), len(message.effort)) == (4, 0, 0)


def test_distorted_cameras_are_written_without_a_baseline(tmp_path, full_recording):
    bent = full_recording.stereo.left.model_copy(
        update={"distortion": "radtan", "distortion_coefficients": (-0.3, 0.1, 1e-3, 2e-3, 0.5)}
    )
    fish = bent.model_copy(update={"distortion": "equidistant", "distortion_coefficients": (0.1, 0.2, 0.3, 0.4)})
    stereo = full_recording.stereo.model_copy(update={"left": bent, "right": fish})
    bag = read(write_bag(tmp_path / "a", dataclasses.replace(full_recording, stereo=stereo)))
    left, right = (bag[f"/camera/infra{number}/camera_info"][0][1] for number in (1, 2))
    assert (left.distortion_model, list(left.d)) == ("plumb_bob", [-0.3, 0.1, 1e-3, 2e-3, 0.5])
    assert (right.distortion_model, list(right.d)) == ("equidistant", [0.1, 0.2, 0.3, 0.4])
    assert right.p[3] == 0.0


@pytest.mark.parametrize("name", NAMES)
def test_the_same_contents_give_the_same_bytes(tmp_path, full_recording, name):
    one, two = (write_bag(tmp_path / folder / name, full_recording) for folder in ("one", "two"))
    files = [one] if one.is_file() else sorted(one.iterdir())
    assert len(files) == (1 if one.is_file() else 2)
    for file in files:
        other = two if two.is_file() else two / file.name
        assert file.read_bytes() == other.read_bytes()
    assert [path.name for path in one.parent.iterdir()] == [name]  # nothing is left beside it


def test_streams_are_read_once_and_lazily(tmp_path, biped, log, full_recording):
    """Generators are accepted, and an error in the middle leaves no incomplete bag."""

    def breaks_off():
        yield from log[:30]
        raise DatasetError("the simulator stopped")

    whole = write_bag(tmp_path / "a.mcap", RecordingContents(biped, iter(log), frames=iter(full_recording.frames)))
    assert len(read(whole)["/imu"]) == 40
    with pytest.raises(DatasetError, match="the simulator stopped"):
        write_bag(tmp_path / "b.mcap", RecordingContents(biped, breaks_off()))
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


def test_a_path_that_exists_or_is_not_a_bags_is_one_sentence(tmp_path, biped, log):
    contents = RecordingContents(biped, log)
    write_bag(tmp_path / "a.bag", contents)
    with pytest.raises(DatasetError, match=r"a\.bag exists already; delete it, or choose another path"):
        write_bag(tmp_path / "a.bag", contents)
    with pytest.raises(DatasetError, match=r"ends in \.csv, not the suffix of a bag; use \.bag"):
        write_bag(tmp_path / "a.csv", contents)
    with pytest.raises(DatasetError, match="choose another path"):
        write_bag(tmp_path / "a.bag" / "below.bag", contents)


def test_a_stamp_that_ros_cannot_hold_is_named(tmp_path, biped):
    for stamp_ns in (-1, 2**31 * 1_000_000_000):
        sample = ImuSample(stamp_ns, np.zeros(3), np.ones(3))
        with pytest.raises(TimestampError, match=rf"/imu: ROS 2 cannot hold the stamp {stamp_ns} ns"):
            write_bag(tmp_path / "a.mcap", RecordingContents(biped, [sample]))
        assert not (tmp_path / "a.mcap").exists()


def test_contents_that_a_bag_cannot_hold_are_refused(tmp_path, biped, log, full_recording):
    unstamped = GroundTruth(full_recording.ground_truth.trajectory, has_stamps=False, source="mocap")
    with pytest.raises(DatasetError, match="cannot hold ground truth without stamps"):
        write_bag(tmp_path / "a.bag", RecordingContents(biped, log, unstamped))
    image = np.zeros((4, 4), dtype=np.uint8)
    with pytest.raises(DatasetError, match="passed as `frames`"):
        write_bag(tmp_path / "a.bag", RecordingContents(biped, [StereoFrame(5, image, image)]))

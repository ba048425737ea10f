# SPDX-License-Identifier: BSD-3-Clause
from collections import defaultdict

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from coclo_vio.datasets.rosbag.writing.result_writer import EstimatedTrajectory, ros_pose_covariance, write_result_bag
from coclo_vio.geometry import se3, so3
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.trajectory import Trajectory

START_NS = 1_700_000_000_123_456_789
COUNT = 60


def read(path):
    messages = defaultdict(list)
    with AnyReader([path]) as reader:
        for connection, stamp_ns, raw in reader.messages():
            messages[connection.topic].append((stamp_ns, reader.deserialize(raw, connection.msgtype)))
    return messages


def header_ns(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def matrix(position, orientation):
    quat_xyzw = np.array([orientation.x, orientation.y, orientation.z, orientation.w])
    return se3.transform(so3.from_quat_xyzw(quat_xyzw), np.array([position.x, position.y, position.z]))


def transform_of(message):
    return matrix(message.transform.translation, message.transform.rotation)


def xyz(vector):
    return np.array([vector.x, vector.y, vector.z])


@pytest.fixture
def trajectory():
    rng = np.random.default_rng(21)
    root = rng.normal(size=(COUNT, 6, 6))
    return Trajectory(
        START_NS + np.arange(COUNT) * 10_000_019,
        se3.transform(so3.exp(rng.normal(size=(COUNT, 3))), rng.normal(size=(COUNT, 3))),
        rng.normal(size=(COUNT, 3)),
        root @ np.swapaxes(root, 1, 2),
    )


@pytest.fixture
def track(trajectory):
    rates = np.random.default_rng(22).normal(size=(COUNT, 3))
    tie = se3.transform(so3.about_z(0.7), np.array([1.0, 2.0, 3.0]))
    return EstimatedTrajectory("coclo", trajectory, rates, tie)


@pytest.mark.parametrize("name", ["result.bag", "result.mcap", "result"])
def test_odometry_holds_the_estimate(tmp_path, track, name):
    bag = read(write_result_bag(tmp_path / name, [track]))
    trajectory = track.trajectory
    assert [header_ns(message) for _, message in bag["/coclo/odometry"]] == trajectory.stamps_ns.tolist()
    for row, (received_ns, message) in enumerate(bag["/coclo/odometry"]):
        assert received_ns == trajectory.stamps_ns[row]
        assert (message.header.frame_id, message.child_frame_id) == ("odom", "base_link")
        pose = matrix(message.pose.pose.position, message.pose.pose.orientation)
        np.testing.assert_allclose(pose, trajectory.T_world_body[row], atol=1e-14)
        linear_body = trajectory.rotations[row].T @ trajectory.velocity_world[row]
        np.testing.assert_array_equal(xyz(message.twist.twist.linear), linear_body)
        np.testing.assert_array_equal(xyz(message.twist.twist.angular), track.angular_velocity_body[row])
        expected = ros_pose_covariance(trajectory.covariance[row], trajectory.rotations[row])
        np.testing.assert_array_equal(np.reshape(message.pose.covariance, (6, 6)), expected)
        assert not np.any(message.twist.covariance)  # unknown


def test_the_ros_covariance_is_that_of_position_and_a_turn_about_fixed_axes(trajectory):
    """Errors drawn in our convention, measured in ROS's."""
    rng = np.random.default_rng(23)
    pose = trajectory.T_world_body[3]
    scale = np.diag([3e-3, 1e-3, 2e-3, 0.01, 0.03, 0.02])
    mixing = np.linalg.qr(rng.normal(size=(6, 6)))[0] @ scale
    errors = rng.normal(size=(10_000, 6)) @ mixing.T
    drawn = pose @ np.array([se3.exp(error) for error in errors])
    moved = drawn[:, :3, 3] - pose[:3, 3]
    turned = so3.log(drawn[:, :3, :3] @ pose[:3, :3].T)
    measured = np.cov(np.hstack((moved, turned)).T)
    expected = ros_pose_covariance(mixing @ mixing.T, pose[:3, :3])
    sigmas = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(measured / np.outer(sigmas, sigmas), expected / np.outer(sigmas, sigmas), atol=0.05)


def test_frames_are_those_of_rep_105(tmp_path, track):
    reference = track.trajectory.moved(track.T_map_odom)
    bag = read(write_result_bag(tmp_path / "r.mcap", [track], reference))
    [(_, static)] = bag["/tf_static"]
    [tie] = static.transforms
    assert (tie.header.frame_id, tie.child_frame_id) == ("map", "odom")
    np.testing.assert_allclose(transform_of(tie), track.T_map_odom, atol=1e-15)
    edges = [(one.header.frame_id, one.child_frame_id) for _, message in bag["/tf"] for one in message.transforms]
    assert set(edges) == {("odom", "base_link"), ("map", "ground_truth")}
    assert len(edges) == 2 * COUNT
    # map -> odom -> base_link lies on map -> ground_truth, as the reference is the same motion
    poses = {one.child_frame_id: transform_of(one) for _, message in bag["/tf"][-2:] for one in message.transforms}
    np.testing.assert_allclose(track.T_map_odom @ poses["base_link"], poses["ground_truth"], atol=1e-12)


def test_paths_are_thinned_and_written_at_the_start(tmp_path, track):
    reference = track.trajectory.restamped(track.trajectory.stamps_ns - 1_000_000_000)
    bag = read(write_result_bag(tmp_path / "r.mcap", [track], reference))
    for topic, frame, trajectory in (
        ("/coclo/path", "odom", track.trajectory),
        ("/ground_truth/path", "map", reference),
    ):
        [(stamp_ns, path)] = bag[topic]
        assert stamp_ns == reference.stamps_ns[0]
        assert path.header.frame_id == frame
        assert [header_ns(pose) for pose in path.poses] == trajectory.stamps_ns[[0, 10, 20, 30, 40, 50, 59]].tolist()
        last = matrix(path.poses[-1].pose.position, path.poses[-1].pose.orientation)
        np.testing.assert_allclose(last, trajectory.T_world_body[-1], atol=1e-14)
    stamps = sorted(stamp for messages in bag.values() for stamp, _ in messages)
    assert stamps[0] == reference.stamps_ns[0]


def test_every_frame_has_one_parent_when_there_are_several_estimators(tmp_path, track):
    other = EstimatedTrajectory("stereo", track.trajectory, None, np.eye(4))
    bag = read(write_result_bag(tmp_path / "r.bag", [track, other]))
    parents = defaultdict(set)
    for topic in ("/tf", "/tf_static"):
        for _, message in bag[topic]:
            for one in message.transforms:
                parents[one.child_frame_id].add(one.header.frame_id)
    assert parents == {
        "odom": {"map"},
        "base_link": {"odom"},
        "stereo/odom": {"map"},
        "stereo/base_link": {"stereo/odom"},
    }
    assert bag["/stereo/odometry"][0][1].child_frame_id == "stereo/base_link"


def test_poses_alone_will_do(tmp_path, trajectory):
    bare = Trajectory(trajectory.stamps_ns, trajectory.T_world_body)
    bag = read(write_result_bag(tmp_path / "r.mcap", [EstimatedTrajectory("tum", bare, None, np.eye(4))]))
    message = bag["/tum/odometry"][-1][1]
    assert not np.any(message.pose.covariance)
    assert not xyz(message.twist.twist.linear).any()


def test_the_same_result_gives_the_same_bytes(tmp_path, track):
    one, two = (write_result_bag(tmp_path / folder / "r.mcap", [track]) for folder in "ab")
    assert one.read_bytes() == two.read_bytes()


def test_no_estimate_is_an_error(tmp_path):
    with pytest.raises(DatasetError, match="no estimate to write"):
        write_result_bag(tmp_path / "r.mcap", [])
    assert not (tmp_path / "r.mcap").exists()

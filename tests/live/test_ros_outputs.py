# SPDX-License-Identifier: BSD-3-Clause
"""What goes out, read back with rosbags' own definitions; covariances against samples."""

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from coclo_vio.datasets.rosbag.storage.type_definitions import TypeDefinitions
from coclo_vio.geometry import se3, so3
from coclo_vio.live.ros_outputs import RosOutputs, body_twist, body_twist_covariance
from coclo_vio.live.topic_counts import TopicCounts
from coclo_vio.live.wire import WireMessage
from coclo_vio.runs.live_config import LiveConfig
from coclo_vio.values.estimates import NavState, StateEstimate
from coclo_vio.values.outputs import Estimate, Event, Status, StreamStatus

_STORE = get_typestore(Stores.ROS2_JAZZY)


def _state(stamp_ns=1_700_000_000_123_456_789, seed=4):
    random = np.random.default_rng(seed)
    T = se3.transform(so3.exp(random.normal(size=3)), random.normal(size=3))
    root = random.normal(size=(9, 9)) * 0.02
    nav = NavState(T, random.normal(size=3), random.normal(size=3), np.zeros(3), np.zeros(3))
    return StateEstimate(stamp_ns, nav, root @ root.T)


def _outputs(**changes):
    return RosOutputs(TypeDefinitions(), ("combined_coclo", "combined_vins"), LiveConfig(**changes))


def test_odometry_has_pose_twist_and_both_covariances():
    state = _state()
    odometry, tf = _outputs().of_estimate(Estimate("combined_coclo", state))
    assert (odometry.topic, odometry.msgtype) == ("/combined_coclo/odometry", "nav_msgs/msg/Odometry")
    message = _STORE.deserialize_cdr(odometry.data, odometry.msgtype)
    stamp = message.header.stamp
    assert stamp.sec * 10**9 + stamp.nanosec == state.stamp_ns
    assert (message.header.frame_id, message.child_frame_id) == ("odom", "base_link")
    linear = message.twist.twist.linear
    expected = state.nav.T_world_body[:3, :3].T @ state.nav.velocity_world
    np.testing.assert_allclose([linear.x, linear.y, linear.z], expected)
    pose = message.pose.covariance.reshape(6, 6)
    R = state.nav.T_world_body[:3, :3]
    np.testing.assert_allclose(pose[:3, :3], R @ state.covariance[3:6, 3:6] @ R.T, atol=1e-12)
    np.testing.assert_allclose(message.twist.covariance.reshape(6, 6), body_twist_covariance(state))
    transform = _STORE.deserialize_cdr(tf.data, tf.msgtype).transforms[0]
    position = transform.transform.translation
    np.testing.assert_allclose([position.x, position.y, position.z], state.nav.T_world_body[:3, 3])


def test_the_twist_s_covariance_is_that_of_samples():
    state = _state()
    random = np.random.default_rng(5)
    errors = random.multivariate_normal(np.zeros(9), state.covariance, size=40_000) * 0.1
    R, velocity = state.nav.T_world_body[:3, :3], state.nav.velocity_world
    turned = R @ so3.exp(errors[:, :3])
    twists = np.einsum("nji,nj->ni", turned, velocity + errors[:, 6:])
    sampled = np.cov(twists.T) / 0.01
    np.testing.assert_allclose(body_twist_covariance(state)[:3, :3], sampled, rtol=0.05, atol=2e-4)
    np.testing.assert_allclose(twists.mean(axis=0), body_twist(state)[0], atol=2e-3)


def test_a_further_trajectory_has_frames_of_its_own():
    odometry, tf = _outputs().of_estimate(Estimate("combined_vins", _state()))
    message = _STORE.deserialize_cdr(odometry.data, odometry.msgtype)
    assert (message.header.frame_id, message.child_frame_id) == ("combined_vins/odom", "combined_vins/base_link")
    assert _STORE.deserialize_cdr(tf.data, tf.msgtype).transforms[0].child_frame_id == "combined_vins/base_link"


@pytest.mark.parametrize(("rate_hz", "expected"), [(0.0, 500), (50.0, 50), (100.0, 100)])
def test_the_rate_of_odometry_is_bounded(rate_hz, expected):
    outputs = _outputs(odometry_rate_hz=rate_hz)
    sent = sum(
        bool(list(outputs.of_estimate(Estimate("combined_coclo", _state(10**18 + i * 2_000_000))))) for i in range(500)
    )
    assert abs(sent - expected) <= 1


def test_diagnostics_name_topics_losses_and_events():
    counts = TopicCounts("sensor_msgs/msg/Imu")
    for number in (1, 2, 5):
        counts.add(WireMessage("/imu", "sensor_msgs/msg/Imu", b"", 20, 10, number, b"a"))
    events = [Event(7, "wire_message_refused", "/imu: a message: cannot be decoded")]
    samples = Status(
        7, (StreamStatus("imu", 3, 3), StreamStatus("joints", 9, 6, late=1, held=1, refused={"future": 2}))
    )
    sent = _outputs().diagnostics(10**18, {"/imu": counts.record()}, {"gaps": 2}, samples, events)
    message = _STORE.deserialize_cdr(sent.data, sent.msgtype)
    estimator, imu, joints, topic = message.status
    assert (estimator.level, imu.level, joints.level, topic.level) == (1, 0, 1, 1)
    assert (imu.name, imu.message) == ("coclo_vio: samples of imu", "imu: used 3 of 3")
    assert joints.message == "joints: used 6 of 9, 1 late, 1 held, 2 refused (future)"
    assert ("refused: future", "2") in [(value.key, value.value) for value in joints.values]
    assert "cannot be decoded" in estimator.message
    assert ("gaps", "2") in [(value.key, value.value) for value in estimator.values]
    assert topic.name == "coclo_vio: /imu"
    assert topic.message == "2 lost"

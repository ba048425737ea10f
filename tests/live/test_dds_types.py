# SPDX-License-Identifier: BSD-3-Clause
"""Types of DDS made from definitions: they serialise to the bytes of ROS 2."""

import numpy as np
import pytest

from coclo_vio.datasets.rosbag.storage.type_definitions import TypeDefinitions
from coclo_vio.live import unitree
from coclo_vio.live.recorded_messages import low_states
from coclo_vio.robot.description import load_robot

pytest.importorskip("cyclonedds", reason="cyclonedds is an extra (live-dds)")
from coclo_vio.live.dds_types import DdsTypes

_TYPES = TypeDefinitions(further=unitree.DEFINITIONS)


@pytest.mark.parametrize(
    "msgtype",
    [
        "sensor_msgs/msg/JointState",
        "sensor_msgs/msg/Imu",
        "sensor_msgs/msg/CameraInfo",
        "sensor_msgs/msg/CompressedImage",
        "tf2_msgs/msg/TFMessage",
        "nav_msgs/msg/Odometry",
        "diagnostic_msgs/msg/DiagnosticArray",
        unitree.LOW_STATE,
        unitree.HUMANOID_LOW_STATE,
    ],
)
def test_every_type_on_the_wire_has_a_type_of_dds(msgtype):
    package, kind, name = msgtype.split("/")
    made = DdsTypes(_TYPES).of(msgtype)
    assert made.__idl__.idl_transformed_typename == f"{package}::{kind}::dds_::{name}_"


def test_the_bytes_are_those_of_ros():
    types = _TYPES.types
    stamp = types["builtin_interfaces/msg/Time"](1, 2)
    header = types["std_msgs/msg/Header"](stamp, "base")
    message = types["sensor_msgs/msg/JointState"](header, ["a", "bc"], np.array([1.0, 2.0]), np.zeros(0), np.ones(3))
    data = _TYPES.serialized(message)
    read = DdsTypes(_TYPES).of("sensor_msgs/msg/JointState").deserialize(data)
    assert (read.header.stamp.nanosec, read.header.frame_id, read.name) == (2, "base", ["a", "bc"])
    assert list(read.position) == [1.0, 2.0]
    assert read.serialize() == data


def test_a_low_state_of_unitree_has_the_bytes_of_its_published_definition(short_recording):
    message = next(iter(low_states(short_recording, "daisy", _TYPES)))
    read = DdsTypes(_TYPES).of(unitree.LOW_STATE).deserialize(message.data)
    assert len(read.motor_state) == 20
    assert read.serialize() == message.data
    assert np.linalg.norm(read.imu_state.accelerometer) == pytest.approx(9.81, abs=0.5)


def test_feet_and_motors_of_a_quadruped_are_read_in_unitree_s_order():
    fields = unitree.fields_of(load_robot("go2"))
    assert fields["joints"]["position"] == "motor_state[0:12].q"
    assert fields["joints"]["names"][:3] == ["FR_hip_joint", "FR_thigh_joint", "FR_calf_joint"]
    assert fields["foot_force"]["legs"] == ["FR", "FL", "RR", "RL"]

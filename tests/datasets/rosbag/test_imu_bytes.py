# SPDX-License-Identifier: BSD-3-Clause
"""Readings from the bytes of Imu messages are those of the decoded messages."""

from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from coclo_vio.datasets.rosbag.imu_bytes import ImuReader, numbers_of

IMU = "sensor_msgs/msg/Imu"
FRAMES = ["", "a", "imu_l", "imu_link", "base/imu_link_0"]  # names of every length modulo 8 that matters


def store_of(*, is_ros1: bool):
    return get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)


def message(store, frame: str, rng: np.random.Generator, msgtype: str = IMU, **more):
    types = store.types
    vector = types["geometry_msgs/msg/Vector3"]
    stamp = types["builtin_interfaces/msg/Time"](sec=7, nanosec=9)
    sequence = {"seq": 3} if "seq" in types["std_msgs/msg/Header"].__dataclass_fields__ else {}
    return types[msgtype](
        header=types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **sequence),
        orientation=types["geometry_msgs/msg/Quaternion"](*rng.normal(size=4)),
        orientation_covariance=rng.normal(size=9),
        angular_velocity=vector(*rng.normal(size=3)),
        angular_velocity_covariance=rng.normal(size=9),
        linear_acceleration=vector(*rng.normal(size=3)),
        linear_acceleration_covariance=rng.normal(size=9),
        **more,
    )


def bag_of(store, *, is_ros1: bool, msgtype: str = IMU):
    """As much of a bag as the reader needs; it counts the messages that are decoded."""
    decoded = []

    def decode(topic: str, data: bytes):
        decoded.append(topic)
        return store.deserialize_ros1(data, msgtype) if is_ros1 else store.deserialize_cdr(data, msgtype)

    return SimpleNamespace(is_ros1=is_ros1, decoded=decode, log=decoded)


@pytest.mark.parametrize(("is_ros1", "is_little"), [(False, True), (False, False), (True, True)])
def test_readings_are_those_of_the_decoded_message(is_ros1: bool, is_little: bool) -> None:
    store, rng = store_of(is_ros1=is_ros1), np.random.default_rng(51)
    bag = bag_of(store, is_ros1=is_ros1)
    reader = ImuReader(bag)
    for frame in FRAMES:
        imu = message(store, frame, rng)
        if is_ros1:
            data = bytes(store.serialize_ros1(imu, IMU))
        else:
            data = bytes(store.serialize_cdr(imu, IMU, little_endian=is_little))
        rate, force = reader.read("/imu", data)
        np.testing.assert_array_equal(rate, [imu.angular_velocity.x, imu.angular_velocity.y, imu.angular_velocity.z])
        expected = [imu.linear_acceleration.x, imu.linear_acceleration.y, imu.linear_acceleration.z]
        np.testing.assert_array_equal(force, expected)
    assert len(bag.log) == 1  # the first, from which the fields of the type are known


def test_a_type_with_other_fields_is_decoded() -> None:
    store, rng = store_of(is_ros1=False), np.random.default_rng(52)
    definition = store.generate_msgdef(IMU, ros_version=2)[0]
    text = definition.split("=" * 80)[0].rstrip() + "\nfloat64 temperature\n"
    name = "sensor_msgs/msg/WarmImu"
    store.register(get_types_from_msg(text, name))
    bag = bag_of(store, is_ros1=False, msgtype=name)
    reader = ImuReader(bag)
    for _ in range(3):
        imu = message(store, "imu", rng, name, temperature=20.0)
        rate, _ = reader.read("/imu", bytes(store.serialize_cdr(imu, name)))
        assert rate[0] == imu.angular_velocity.x
    assert len(bag.log) == 3


def test_bytes_of_another_length_are_not_read() -> None:
    store, rng = store_of(is_ros1=False), np.random.default_rng(53)
    data = bytes(store.serialize_cdr(message(store, "imu", rng), IMU))
    assert numbers_of(data, is_ros1=False) is not None
    for cut in (0, 3, 15, 20, len(data) - 8, len(data) - 1):
        assert numbers_of(data[:cut], is_ros1=False) is None
        assert numbers_of(data[:cut], is_ros1=True) is None
    assert numbers_of(data + bytes(8), is_ros1=False) is None
    assert numbers_of(b"\x00\x07" + data[2:], is_ros1=False) is None  # another encoding, with another alignment

# SPDX-License-Identifier: BSD-3-Clause
import struct

import pytest

from coclo_vio.datasets.rosbag.storage.type_definitions import TypeDefinitions
from coclo_vio.live.ros_names import dds_name, ros_name
from coclo_vio.live.zenoh_keys import (
    Attachment,
    NodeTokens,
    ZenohTopic,
    advertised_by,
    attachment_of,
    topic_of_key,
)

# The examples of ros2/rmw_zenoh, docs/design.md.
_CHATTER = (
    "0/robot1/chatter/std_msgs::msg::dds_::String_/"
    "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
)
_TALKER = (
    "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/"
    "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18/::,7:,:,:,,"
)


def test_the_key_of_a_topic_is_the_one_in_the_design_of_rmw_zenoh():
    topic = ZenohTopic("/robot1/chatter", "std_msgs/msg/String", TypeDefinitions().hash_of("std_msgs/msg/String"))
    assert topic.key(0) == _CHATTER
    assert topic_of_key(_CHATTER) == topic


def test_the_publisher_of_a_token_is_found():
    found = advertised_by(_TALKER)
    assert found is not None
    assert (found.topic.name, found.topic.msgtype) == ("/chatter", "std_msgs/msg/String")
    assert not found.is_transient_local
    assert advertised_by(_TALKER.replace("/::,7", "/:1:,7")).is_transient_local


@pytest.mark.parametrize(
    "token",
    ["", "@ros2_lv/2/8b/0/0/NN/%/%/talker", _TALKER.replace("/MP/", "/MS/"), _TALKER.replace("dds_::", ""), "/" * 12],
)
def test_tokens_of_other_entities_and_of_other_forms_are_passed_over(token):
    assert advertised_by(token) is None


def test_our_own_tokens_are_read_back():
    tokens = NodeTokens(3, "8b20917502ee955ac4476e0266340d5c", "coclo_vio")
    topic = ZenohTopic("/coclo/odometry", "nav_msgs/msg/Odometry", "RIHS01_0")
    token = tokens.entity("MP", topic)
    assert token.startswith("@ros2_lv/3/8b20917502ee955ac4476e0266340d5c/0/1/MP/%/%/coclo_vio/%coclo%odometry/")
    assert advertised_by(token).topic == topic
    assert tokens.entity("MP", topic) != token  # each entity has a number of its own
    assert tokens.node() == "@ros2_lv/3/8b20917502ee955ac4476e0266340d5c/0/0/NN/%/%/coclo_vio"


def test_an_attachment_is_33_bytes_little_endian_with_a_length_before_the_sender():
    sender = bytes(range(16))
    packed = Attachment(7, 1_700_000_000_000_000_001, sender).packed()
    assert packed == struct.pack("<qq", 7, 1_700_000_000_000_000_001) + b"\x10" + sender
    assert attachment_of(packed) == (7, 1_700_000_000_000_000_001, sender)


def test_the_attachment_with_names_of_an_early_jazzy_is_read():
    sender = bytes(range(16))
    packed = b"".join(
        (
            b"\x0fsequence_number",
            struct.pack("<q", 7),
            b"\x10source_timestamp",
            struct.pack("<q", 9),
            b"\x0asource_gid\x10",
            sender,
        )
    )
    assert attachment_of(packed) == (7, 9, sender)


@pytest.mark.parametrize("data", [b"", b"\x00" * 32, b"\x00" * 33, b"\xff" * 77, b"\x01" * 500])
def test_other_bytes_are_no_attachment(data):
    assert attachment_of(data) is None


def test_names_of_types_go_to_dds_and_back():
    assert dds_name("sensor_msgs/msg/Imu") == "sensor_msgs::msg::dds_::Imu_"
    assert ros_name("sensor_msgs::msg::dds_::Imu_") == "sensor_msgs/msg/Imu"
    assert ros_name("sensor_msgs::Imu") is None


def test_a_type_of_another_definition_does_not_fit_but_one_without_hash_does():
    own = TypeDefinitions().hash_of("sensor_msgs/msg/Imu")
    assert ZenohTopic("/imu", "sensor_msgs/msg/Imu", own).fits(own)
    assert ZenohTopic("/imu", "sensor_msgs/msg/Imu", "TypeHashNotSupported").fits(own)
    assert not ZenohTopic("/imu", "sensor_msgs/msg/Imu", "RIHS01_00").fits(own)

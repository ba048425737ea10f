# SPDX-License-Identifier: BSD-3-Clause
"""Names of message types as DDS has them: ``sensor_msgs/msg/Imu`` is ``sensor_msgs::msg::dds_::Imu_``."""

import re

_DDS_NAME = re.compile(r"(?P<package>\w+)::(?P<kind>\w+)::dds_::(?P<name>\w+)_")


def dds_name(msgtype: str) -> str:
    """The name in DDS of a type of ROS."""
    package, kind, name = msgtype.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def ros_name(dds_type: str) -> str | None:
    """The type of ROS with a name of DDS; None where it is none."""
    match = _DDS_NAME.fullmatch(dds_type)
    return None if match is None else f"{match['package']}/{match['kind']}/{match['name']}"

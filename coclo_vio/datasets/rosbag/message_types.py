# SPDX-License-Identifier: BSD-3-Clause
"""The ROS message types that are read, as ``rosbags`` spells them, and their fields."""

from typing import Any

JOINT_STATE = "sensor_msgs/msg/JointState"
IMU = "sensor_msgs/msg/Imu"
IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
TRANSFORM = "geometry_msgs/msg/TransformStamped"
POSE = "geometry_msgs/msg/PoseStamped"
POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
WRENCH = "geometry_msgs/msg/WrenchStamped"

_IMU_VECTORS = ("angular_velocity", "linear_acceleration")
_IMU_COVARIANCES = ("angular_velocity_covariance", "linear_acceleration_covariance")
IMAGES = (IMAGE, COMPRESSED_IMAGE)
POSES = (TRANSFORM, POSE, POSE_WITH_COVARIANCE, ODOMETRY)

FIELDS = {
    JOINT_STATE: ("name", "position", "velocity", "effort"),
    IMU: ("header.frame_id", *(f"{field}.{axis}" for field in _IMU_VECTORS for axis in "xyz"), *_IMU_COVARIANCES),
    IMAGE: ("encoding", "height", "width", "step", "data"),
    COMPRESSED_IMAGE: ("format", "data"),
    CAMERA_INFO: ("header.frame_id", "height", "width", "distortion_model"),
    WRENCH: tuple(f"wrench.force.{axis}" for axis in "xyz"),
}
"""The fields that are read of each type; a bag brings its own definitions, and may name a type that has others."""


def missing_field(message: Any, msgtype: str) -> str | None:
    """The first field in ``FIELDS`` that a message lacks, or None."""
    for path in FIELDS.get(msgtype, ()):
        value = message
        for name in path.split("."):
            value = getattr(value, name, None)
        if value is None:
            return path
    return None

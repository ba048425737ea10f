# SPDX-License-Identifier: BSD-3-Clause
"""The ROS message types that are read, as ``rosbags`` spells them."""

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

IMAGES = (IMAGE, COMPRESSED_IMAGE)
POSES = (TRANSFORM, POSE, POSE_WITH_COVARIANCE, ODOMETRY)

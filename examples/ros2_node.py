# SPDX-License-Identifier: BSD-3-Clause
"""Leg odometry as a node of ROS 2, for those who have ``rclpy``: ``python examples/ros2_node.py [ROBOT]``."""

import sys
import time

import numpy as np
import rclpy
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState

import coclo_vio as cv
from coclo_vio.live.ros_outputs import LiveConfig, RosOutputs, TypeDefinitions

rclpy.init()
robot, node = cv.load_robot((sys.argv[1:] or ["go1"])[0]), Node("coclo_vio")
estimator = cv.make_estimator("coclo", robot=robot)
publisher = node.create_publisher(Odometry, "/coclo/odometry", 10)
messages = RosOutputs(TypeDefinitions(), ("coclo",), LiveConfig())


def push(kind, stamp, readings):
    outputs = estimator.push(kind(stamp.sec * 10**9 + stamp.nanosec, *readings), arrival_ns=time.monotonic_ns())
    for estimate in (output for output in outputs if isinstance(output, cv.Estimate)):
        publisher.publish(next(messages.of_estimate(estimate)).data)  # rclpy takes serialized messages too


def take_joints(m):
    entries = [m.name.index(name) for name in robot.joint_names]
    push(cv.JointSample, m.header.stamp, np.array([m.position, m.velocity, m.effort])[:, entries])


def take_imu(m):
    push(cv.ImuSample, m.header.stamp, (np.array([v.x, v.y, v.z]) for v in (m.angular_velocity, m.linear_acceleration)))


node.create_subscription(Imu, "/imu", take_imu, 50)
node.create_subscription(JointState, "/joint_states", take_joints, 50)
rclpy.spin(node)

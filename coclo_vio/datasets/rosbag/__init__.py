# SPDX-License-Identifier: BSD-3-Clause
"""Rosbags of ROS 1 and ROS 2, without ROS: ``reader`` from the inside out, ``writing`` the other way."""

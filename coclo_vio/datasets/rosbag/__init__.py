# SPDX-License-Identifier: BSD-3-Clause
"""Rosbags of ROS 1 and ROS 2, without ROS: ``reader`` reads them, ``writing`` writes them."""

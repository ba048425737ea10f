# SPDX-License-Identifier: BSD-3-Clause
"""From a URDF and a log to a robot's description: legs, joints, contact, IMU, each with its confidence."""

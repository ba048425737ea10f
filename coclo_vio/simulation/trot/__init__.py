# SPDX-License-Identifier: BSD-3-Clause
"""Quadrupeds that trot (MuJoCo): ground, path, gait, controller of torques, foot sensors."""

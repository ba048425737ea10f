# SPDX-License-Identifier: BSD-3-Clause
"""The paper's three trials with contact physics (MuJoCo): terrain, imperfect robot, wave gait, sensors, Vicon."""

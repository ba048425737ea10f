# SPDX-License-Identifier: BSD-3-Clause
"""The short trot of these tests."""

from coclo_vio.robot.description import load_robot

GO1 = load_robot("go1")
STAND_S, UNTIL_S, SPEED_MPS = 1.0, 5.0, 0.6
SHORT = {"trial": {"stand_s": STAND_S, "gait": {"acceleration_mps2": 2.0, "distance_m": 12.0, "speed_jitter": 0.0}}}

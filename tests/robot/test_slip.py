# SPDX-License-Identifier: BSD-3-Clause
"""Slips of feet: found with their length, and no lift-off taken for one."""

import numpy as np

from coclo_vio.robot.foot_motion import FootMotion
from coclo_vio.robot.kinematic_contact import KinematicContactConfig
from coclo_vio.robot.slip import Slip, SlipConfig, SlipSearch

UP = np.array([0.0, 0.0, 1.0])
SPEED = np.array([0.5, 0.0, 0.0])
STEP_NS = 2_000_000


def slips_of(foot_velocity: np.ndarray, is_stance: np.ndarray) -> list[Slip]:
    """The slips found in velocities of the feet in the world (N, 4, 3) and contacts (N, 4), with noise of 0.03 m/s."""
    rng, found = np.random.default_rng(7), []
    search = SlipSearch(SlipConfig(), KinematicContactConfig(), 4)
    for k in range(len(is_stance)):
        noisy = SPEED - foot_velocity[k] + rng.normal(scale=0.03, size=(4, 3))
        none = np.zeros(3)
        motion = FootMotion(
            k * STEP_NS, noisy, np.full(4, 9e-4), np.full(4, 0.3), np.full(4, 0.5), 9.81 * UP, none, none, UP, False
        )
        found += search.push(motion, is_stance[k])
    return found


def test_a_foot_that_slides_is_found_with_its_length() -> None:
    velocity, stands = np.zeros((600, 4, 3)), np.ones((600, 4), dtype=np.bool_)
    velocity[300:380, 2, :2] = (0.25, 0.3)
    slip, *more = slips_of(velocity, stands)
    assert not more
    assert slip.leg == 2
    assert abs(slip.start_ns - 300 * STEP_NS) < 60_000_000
    true_m = 80 * 0.002 * np.hypot(0.25, 0.3)
    assert abs(slip.distance_m - true_m) < 0.3 * true_m
    assert 0.1 < slip.duration_s < 0.25


def test_standing_feet_do_not_slip() -> None:
    assert slips_of(np.zeros((1500, 4, 3)), np.ones((1500, 4), dtype=np.bool_)) == []


def test_a_foot_that_lifts_off_late_does_not_slip() -> None:
    velocity, stands = np.zeros((600, 4, 3)), np.ones((600, 4), dtype=np.bool_)
    velocity[300:330, 1] = (0.3, 0.0, 0.3)  # it has lifted off, and its contact lingers
    stands[330:400, 1] = False
    velocity[330:400, 1] = (1.2, 0.0, 0.2)
    assert slips_of(velocity, stands) == []


def test_a_foot_in_swing_does_not_slip() -> None:
    velocity, stands = np.zeros((600, 4, 3)), np.ones((600, 4), dtype=np.bool_)
    velocity[200:300, 0], stands[200:300, 0] = (1.0, 0.0, 0.0), False
    assert slips_of(velocity, stands) == []

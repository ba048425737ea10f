# SPDX-License-Identifier: BSD-3-Clause
"""Slips of feet as events: one each, with leg, length and duration; none where nothing is searched."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from coclo_vio.robot.contact import ContactConfig
from coclo_vio.robot.foot_motion import FootMotion
from coclo_vio.robot.kinematic_contact import MOST_LEGS
from coclo_vio.robot.leg_sensing import Reading
from coclo_vio.robot.slip import SlipConfig
from coclo_vio.robot.slip_report import SlipReport
from coclo_vio.values.outputs import SlipEvent

UP, NONE = np.array([0.0, 0.0, 1.0]), np.zeros(3)
STEP_NS, SLIDING, COUNT = 2_000_000, slice(300, 380), 600
VELOCITY = np.array([0.25, 0.3, 0.0])  # of a foot that slides, m/s
LENGTH_M = 80 * 0.002 * float(np.hypot(0.25, 0.3))


def events(report: SlipReport, legs: int, *, has_motion: bool = True) -> list[SlipEvent]:
    """The events of a walk at 0.5 m/s on ``legs`` standing feet, of which the third slides."""
    rng, found = np.random.default_rng(7), []
    for k in range(COUNT):
        velocities = np.tile([0.5, 0.0, 0.0], (legs, 1)) + rng.normal(scale=0.03, size=(legs, 3))
        if SLIDING.start <= k < SLIDING.stop:
            velocities[2] -= VELOCITY
        noise = np.full(legs, 9e-4), np.full(legs, 0.3), np.full(legs, 0.5)
        motion = FootMotion(k * STEP_NS, velocities, *noise, 9.81 * UP, NONE, NONE, UP, False)
        stands = SimpleNamespace(is_stance=np.ones(legs, dtype=np.bool_))
        reading = SimpleNamespace(stamp_ns=k * STEP_NS, motion=motion if has_motion else None, contact=stands)
        report.push(cast(Reading, cast(Any, reading)))
        found += report.take_events()
    assert not report.take_events()
    return found


def names(legs: int) -> list[str]:
    return [f"leg_{number}" for number in range(legs)]


def test_a_slide_is_one_event_with_leg_length_and_duration() -> None:
    (event,) = events(SlipReport(SlipConfig(), ContactConfig(), names(4)), 4)
    assert (event.kind, event.foot) == ("foot_slipped", "leg_2")
    assert event.distance_m == pytest.approx(LENGTH_M, rel=0.3)
    assert 0.1 < event.duration_s < 0.25
    assert f"foot leg_2 slid {1e3 * event.distance_m:.0f} mm in {event.duration_s:.2f} s" in event.detail


@pytest.mark.parametrize(
    ("legs", "is_enabled", "is_searched"),
    [(4, None, True), (4, False, False), (6, None, False), (6, True, True), (MOST_LEGS + 1, True, False)],
)
def test_the_search_is_for_four_legs_or_on_request(legs: int, is_enabled: bool | None, is_searched: bool) -> None:
    report = SlipReport(SlipConfig(is_enabled=is_enabled), ContactConfig(), names(legs))
    assert bool(events(report, legs)) is is_searched


def test_readings_without_the_motion_of_feet_are_passed_over() -> None:
    assert not events(SlipReport(SlipConfig(), ContactConfig(), names(4)), 4, has_motion=False)

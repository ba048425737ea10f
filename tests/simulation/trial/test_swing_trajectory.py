# SPDX-License-Identifier: BSD-3-Clause
"""The trajectory of a swing foot: up, over, down, and further down until contact; on any ground."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coclo_vio.simulation.trial.swing_trajectory import SwingTrajectory
from coclo_vio.values.arrays import Array

STEP_S = 0.004
START = np.array([0.1, 0.3, 0.02])


@st.composite
def swings(draw: st.DrawFn) -> SwingTrajectory:
    """Steps of up to 0.3 m, up or down a stair, with any clearance and time."""
    level, rise = draw(st.floats(-0.3, 0.3)), draw(st.sampled_from([-0.15, 0.0, 0.01, 0.15]))
    goal = START + np.array([level, draw(st.floats(-0.05, 0.05)), rise])
    top = max(START[2], goal[2]) + draw(st.floats(0.03, 0.12))
    touch = draw(st.floats(0.05, 0.5))
    return SwingTrajectory(START, goal, top, draw(st.floats(0.1, 1.0)), touch, draw(st.floats(touch, 0.8)))


def sampled(swing: SwingTrajectory, until_s: float) -> tuple[Array, Array]:
    """Times (N,) s and positions (N, 3)."""
    times = np.arange(0.0, until_s, STEP_S)
    return times, np.array([swing.position(time_s) for time_s in times])


@given(swings())
def test_it_starts_on_the_ground_goes_over_the_top_and_arrives_at_the_goal(swing) -> None:
    np.testing.assert_allclose(swing.position(0.0), swing.start, atol=1e-12)
    np.testing.assert_allclose(swing.position(swing.duration_s), swing.goal, atol=1e-9)
    _, places = sampled(swing, swing.duration_s)
    assert places[:, 2].max() == pytest.approx(swing.top_m, abs=0.003)
    assert swing.duration_s >= swing.planned_s


@given(swings())
def test_it_never_jumps_and_keeps_its_speed(swing) -> None:
    """Up and down no faster than allowed, which a smooth curve reaches at its steepest."""
    _, places = sampled(swing, swing.duration_s + 0.3)
    assert np.abs(np.diff(places[:, 2])).max() / STEP_S < 1.02 * swing.vertical_speed_mps
    reach = float(np.linalg.norm((swing.goal - swing.start)[:2]))
    assert np.linalg.norm(np.diff(places[:, :2], axis=0), axis=1).max() < 0.15 * reach + 1e-12


@pytest.mark.long
@given(swings())
def test_it_touches_down_at_its_speed_and_continues_below_the_expected_ground(swing) -> None:
    before, after = (swing.position(swing.duration_s + offset)[2] for offset in (-1e-5, 1e-5))
    assert (before - after) / 2e-5 == pytest.approx(swing.touch_speed_mps, rel=1e-2)
    _, places = sampled(swing, swing.duration_s + 3.0)
    assert swing.goal[2] - places[-1, 2] == pytest.approx(0.06, abs=1e-9)
    np.testing.assert_allclose(places[-1, :2], swing.goal[:2], atol=1e-12)


@given(swings())
def test_a_force_counts_as_the_ground_on_the_way_down_only(swing) -> None:
    times, places = sampled(swing, swing.duration_s + 0.1)
    highest = times[int(np.argmax(places[:, 2]))]
    descending = np.array([swing.is_descending(time_s) for time_s in times])
    assert not descending[times <= highest].any()
    assert descending[times >= swing.duration_s].all()


def test_up_a_stair_it_rises_before_it_crosses() -> None:
    """A riser stands half way: the foot's centre is above its edge by the foot's radius when it comes there."""
    goal = START + np.array([0.3, 0.0, 0.15])
    swing = SwingTrajectory(START, goal, goal[2] + 0.06, 0.6, 0.3, 0.45)
    _, places = sampled(swing, swing.duration_s)
    crossing = int(np.argmax(places[:, 0] > START[0] + 0.15))
    assert places[crossing, 2] > goal[2] + 0.02

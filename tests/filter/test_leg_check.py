# SPDX-License-Identifier: BSD-3-Clause
"""A walk of six legs whose encoders are right, flipped or off: which leg is set aside, why, and when it returns."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from coclo_vio.filter.leg_check import LegCheck
from coclo_vio.filter.leg_check_config import LegCheckConfig
from coclo_vio.filter.leg_intervals import IntervalNoise
from coclo_vio.geometry import so3
from coclo_vio.robot.contact import ContactState
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.leg_sensing import Reading
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.outputs import Event

DAISY = RobotModel(load_robot("daisy"))
LEGS, JOINTS = len(DAISY.leg_names), len(DAISY.joint_names)
PERIOD, DUTY, STRIDE_M = 2.0, 0.8, 0.16
NOMINAL = np.tile([0.16, -0.1, -1.44, -0.16, 0.1, 1.44], 3)  # left leg, right leg: feet 0.18 m below the body
NOISE = IntervalNoise(6e-4, 0.003, 0.02)
Fault = Callable[[float, Array], Array]


def _angles_for(targets: Array) -> Array:
    """Joint positions (J,) for feet at these places in the body frame (n, 3), by Newton's method."""
    position = NOMINAL.copy()
    for _ in range(12):
        feet = DAISY.feet(position, np.zeros(JOINTS))
        for leg, columns in enumerate(DAISY.leg_joint_slices):
            error = targets[leg] - feet.position_body[leg]
            position[columns] += np.linalg.lstsq(feet.jacobian[leg, 3:, columns], error)[0]
    return position


@cache
def _cycle() -> tuple[list[Array], list[BoolArray]]:
    """Joint positions and stance of one period of a wave gait at constant speed, at 20 Hz."""
    home = DAISY.feet(NOMINAL, np.zeros(JOINTS)).position_body
    positions, stances = [], []
    for step in range(round(PERIOD * 20)):
        phase = (step / (PERIOD * 20) + np.arange(LEGS) / LEGS) % 1.0
        is_stance = phase < DUTY
        along = np.where(is_stance, 0.5 - phase / DUTY, (phase - DUTY) / (1.0 - DUTY) - 0.5)
        targets = home.copy()
        targets[:, 0] += STRIDE_M * along
        targets[:, 2] += np.where(is_stance, 0.0, 0.05)
        positions.append(_angles_for(targets))
        stances.append(is_stance)
    return positions, stances


def walk(
    seconds: float, fault: Fault, config: LegCheckConfig | None = None, slip: Fault | None = None
) -> tuple[LegCheck, Sequence[Event]]:
    """The check after a walk; a fault maps time and true angles to readings, a slip changes the angles in truth."""
    check, random = LegCheck(replace_radii(), config or LegCheckConfig(), NOISE), np.random.default_rng(5)
    positions, stances = _cycle()
    contact = ContactState(np.ones(LEGS), np.ones(LEGS, dtype=np.bool_), np.full(LEGS, 40.0))
    for step in range(round(seconds * 20)):
        true = positions[step % len(positions)] + random.normal(0.0, 1e-3, JOINTS)
        position = fault(step / 20.0, true if slip is None else slip(step / 20.0, true))
        feet = DAISY.feet(position, np.zeros(JOINTS))
        state = replace(contact, is_stance=stances[step % len(positions)])
        check.push(Reading(50_000_000 * step, feet, state, None, (), None, False, position), np.eye(3))
    return check, check.take_events()


def replace_radii() -> RobotModel:
    """Daisy with feet that do not roll: the gait above holds their centres."""
    robot = RobotModel(load_robot("daisy"))
    robot.foot_radii_m = np.zeros(LEGS)
    return robot


def flipped(joint: str, start_s: float = 0.0, end_s: float = np.inf) -> Fault:
    column = DAISY.joint_names.index(joint)

    def fault(time_s: float, position: Array) -> Array:
        read = position.copy()
        read[column] *= -1.0 if start_s <= time_s < end_s else 1.0
        return read

    return fault


def off(joint: str, degrees: float) -> Fault:
    column = DAISY.joint_names.index(joint)
    return lambda _, position: position + np.radians(degrees) * (np.arange(JOINTS) == column)


def healthy(_: float, position: Array) -> Array:
    return position


def test_healthy_legs_are_never_set_aside_and_their_noise_is_as_expected() -> None:
    check, events = walk(40.0, healthy)
    assert not events
    assert not check.any_aside
    assert check.normalised.max() < 1.0
    assert check.consistency.lasting_share < 0.02
    assert check.consistency.stances > 20.0


@pytest.mark.parametrize("joint", ["leg2_base", "leg3_base", "leg5_elbow"])
def test_an_encoder_with_the_wrong_sign_is_named_within_seconds(joint: str) -> None:
    check, events = walk(8.0, flipped(joint))
    assert [one.kind for one in events] == ["leg_inconsistent"]
    assert f"leg {joint[:4]}: " in events[0].detail
    assert f"joint {joint} reads with the wrong sign" in events[0].detail
    assert np.flatnonzero(check.is_aside).tolist() == [int(joint[3]) - 1]


def test_a_wrong_sign_of_a_small_angle_is_found_as_an_offset_of_twice_the_angle() -> None:
    """The shoulder stands at -0.1 rad here: read as +0.1 it is 11 deg off."""
    check, events = walk(30.0, flipped("leg3_shoulder"))
    assert [one.kind for one in events] == ["leg_inconsistent"]
    assert "joint leg3_shoulder" in events[0].detail
    assert np.flatnonzero(check.is_aside).tolist() == [2]


def test_a_leg_returns_once_it_has_agreed_for_long_enough() -> None:
    check, events = walk(30.0, flipped("leg2_base", 5.0, 12.0))
    assert [one.kind for one in events] == ["leg_inconsistent", "leg_consistent"]
    assert 5.0 < events[0].stamp_ns / 1e9 < 9.0
    assert 17.0 < events[1].stamp_ns / 1e9 < 28.0
    assert not check.any_aside


@pytest.mark.parametrize(("joint", "degrees"), [("leg2_base", 5.0), ("leg4_elbow", -6.0)])
def test_a_zero_that_is_off_is_named_with_its_angle(joint: str, degrees: float) -> None:
    check, events = walk(40.0, off(joint, degrees))
    assert [one.kind for one in events] == ["leg_inconsistent"]
    assert joint in events[0].detail
    angle = float(events[0].detail.split("reads ")[1].split(" deg")[0])
    assert angle == pytest.approx(degrees, abs=2.5)
    assert np.flatnonzero(check.is_aside).tolist() == [int(joint[3]) - 1]


def test_a_single_jump_of_a_joint_sets_no_leg_aside() -> None:
    _, events = walk(20.0, flipped("leg2_shoulder", 5.0, 5.05))
    assert not events


def test_at_least_three_legs_stay_in_use() -> None:
    def fault(time_s: float, position: Array) -> Array:
        for number, start_s in ((1, 0.0), (2, 8.0), (3, 16.0), (4, 24.0)):
            position = flipped(f"leg{number}_base", start_s)(time_s, position)
        return position

    check, _ = walk(40.0, fault)
    assert np.count_nonzero(~check.is_aside) >= 3


def test_while_one_leg_is_aside_its_residual_is_still_computed() -> None:
    check, _ = walk(20.0, flipped("leg2_base"))
    assert check.normalised[1] > 5.0
    assert np.delete(check.normalised, 1).max() < 1.0


def test_legs_that_slip_together_differently_raise_the_lasting_share() -> None:
    random = np.random.default_rng(6)
    scale = random.normal(0.0, 0.1, LEGS)

    def slip(_: float, position: Array) -> Array:
        changed = position.copy()
        for leg, columns in enumerate(DAISY.leg_joint_slices):
            changed[columns][0] *= 1.0 + scale[leg]
        return changed

    still, moved = walk(20.0, healthy)[0].consistency, walk(20.0, healthy, slip=slip)[0].consistency
    assert moved.lasting_share > 2.0 * max(still.lasting_share, 0.01)


def test_the_body_may_be_anywhere() -> None:
    """The residuals are in body axes: a turned world changes nothing."""
    config = LegCheckConfig()
    checks = [LegCheck(replace_radii(), config, NOISE) for _ in range(2)]
    positions, stances = _cycle()
    for step, (position, stance) in enumerate(zip(positions, stances, strict=True)):
        feet = DAISY.feet(position, np.zeros(JOINTS))
        contact = ContactState(np.ones(LEGS), stance, np.full(LEGS, 40.0))
        reading = Reading(50_000_000 * step, feet, contact, None, (), None, False, position)
        for check, rotation in zip(checks, (np.eye(3), so3.exp(np.array([0.0, 0.0, 2.0]))), strict=True):
            check.push(reading, rotation)
    np.testing.assert_allclose(checks[0].normalised, checks[1].normalised, rtol=1e-6, atol=1e-9)

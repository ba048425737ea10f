# SPDX-License-Identifier: BSD-3-Clause
"""Stances that joint torques end before a lagging foot sensor does."""

from itertools import pairwise

import numpy as np
import pytest

from coclo_vio.robot.contact import ContactConfig, ContactState
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.leg_sensing import LegSensing, Reading
from coclo_vio.robot.model import RobotModel
from coclo_vio.robot.standstill import StandstillConfig
from coclo_vio.robot.unloading import Unloading
from coclo_vio.values.arrays import Array
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample

LIMIT_N = 10.0
STEP_NS = 2_000_000
SENSOR_STANDS = [False] * 5 + [True] * 100 + [False] * 20  # it falls 20 ms after the lift-off of LOAD_N
LOAD_N = [0.0] * 5 + [60.0] * 90 + [-30.0] * 10 + [50.0] * 20  # in swing torques show the inertia of the leg


def stances(load_n: list[float], stands: list[bool]) -> list[bool]:
    """Stance of the first of two feet; the second always stands and bears."""
    unloading, found = Unloading(LIMIT_N, 2), []
    for step, (load, stance) in enumerate(zip(load_n, stands, strict=True)):
        contact = ContactState(np.array([0.9, 0.8]), np.array([stance, True]), np.array([300.0, 300.0]))
        corrected = unloading.corrected(step * STEP_NS, contact, np.array([load, 60.0]))
        assert corrected.is_stance[1]
        assert corrected.probability[1] == 0.8
        assert corrected.probability[0] == (0.0 if stance and not corrected.is_stance[0] else 0.9)
        found.append(bool(corrected.is_stance[0]))
    return found


def test_a_stance_ends_when_the_torques_lose_the_load() -> None:
    assert stances(LOAD_N, SENSOR_STANDS) == [False] * 5 + [True] * 90 + [False] * 30


def test_the_next_stance_begins_as_the_sensor_says() -> None:
    twice = stances(LOAD_N * 2, SENSOR_STANDS * 2)
    assert twice[125:] == twice[:125]


@pytest.mark.parametrize("load_n", [0.0, 19.0, np.nan, 60.0], ids=["zero", "never above twice", "unknown", "stays"])
def test_torques_that_show_no_load_or_never_lose_it_change_nothing(load_n: float) -> None:
    assert stances([load_n] * len(SENSOR_STANDS), SENSOR_STANDS) == SENSOR_STANDS


def test_a_foot_that_bears_again_for_longer_than_a_swing_stands() -> None:
    load_n = [60.0] * 10 + [0.0] * 5 + [60.0] * 100
    found = stances(load_n, [True] * len(load_n))
    assert found == [True] * 10 + [False] * (5 + 75) + [True] * 25


@pytest.fixture(scope="module")
def go1() -> RobotModel:
    return RobotModel(load_robot("go1"))


def readings(robot: RobotModel, config: ContactConfig, scales: list[float]) -> list[Reading]:
    """Of a robot that tilts slowly, on feet that read 300 counts, with torques of a multiple of its weight."""
    sensing = LegSensing(robot, config, StandstillConfig(), force_timeout_s=0.1)
    position = np.tile([0.0, 0.8, -1.6], 4)
    efforts = standing_efforts(robot, position)
    found = []
    for step, scale in enumerate(scales):
        stamp_ns = (step + 1) * STEP_NS
        sensing.push(ImuSample(stamp_ns, np.array([0.5, 0.0, 0.0]), np.array([0.0, 0.0, 9.81])), None)
        sensing.push(FootForceSample(stamp_ns, np.full(4, 300.0)), None)
        reading = sensing.push(
            JointSample(stamp_ns, position, np.zeros(12), scale * efforts), np.array([0.0, 0.0, 1.0])
        )
        assert reading is not None
        found.append(reading)
    return found


def standing_efforts(robot: RobotModel, position: Array) -> Array:
    """Torques of motors that press each foot down by 40 N, of legs without mass."""
    jacobian = robot.feet(position, np.zeros(12)).jacobian[:, 3:]
    return -np.asarray(np.einsum("nij,i->nj", jacobian, np.array([0.0, 0.0, 40.0])).sum(axis=0))


def test_the_go1_uses_its_torques_beside_its_foot_sensors(go1: RobotModel) -> None:
    assert go1.description.contact.unloaded_force is not None
    scales = [1.0] * 10 + [0.0] * 10
    found = readings(go1, go1.description.contact, scales)
    assert [reading.is_stance.all() for reading in found[4:]] == [True] * 6 + [False] * 10
    without = readings(go1, go1.description.contact.model_copy(update={"unloaded_force": None}), scales)
    assert all(reading.is_stance.all() for reading in without[4:])


def test_without_torques_a_go1_stands_by_its_foot_sensors(go1: RobotModel) -> None:
    found = readings(go1, go1.description.contact, [float("nan")] * 10)
    assert all(reading.is_stance.all() for reading in found[4:])
    assert all(np.array_equal(a.contact.probability, b.contact.probability) for a, b in pairwise(found[4:]))


def test_the_paper_has_no_torques_beside_sensors(go1: RobotModel) -> None:
    assert go1.description.contact.for_paper().unloaded_force is None

# SPDX-License-Identifier: BSD-3-Clause
"""An accelerometer that contradicts the estimated attitude: set aside, and used again."""

from collections.abc import Iterable

import numpy as np
import pytest

from coclo_vio.robot.contact import ContactConfig
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.gravity_check import GravityCheck
from coclo_vio.robot.leg_sensing import LegSensing, Reading
from coclo_vio.robot.model import RobotModel
from coclo_vio.robot.standstill import StandstillConfig
from coclo_vio.values.arrays import Array
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample
from coclo_vio.values.units import GRAVITY_MPS2

UP = np.array([0.0, 0.0, 1.0])
GRAVITY = GRAVITY_MPS2 * UP
STEP_NS = 2_000_000
SECOND = 500  # samples


def followed(check: GravityCheck, forces: Iterable[Array], start_ns: int = 0) -> list[tuple[float, str]]:
    """Time in seconds since the first sample and kind of each event."""
    events, stamp_ns = [], start_ns
    for force in forces:
        stamp_ns += STEP_NS
        check.push(stamp_ns, force, UP)
        events += [((stamp_ns - start_ns) * 1e-9, event.kind) for event in check.take_events()]
    return events


def trot(seconds: float, rng: np.random.Generator, impact_mps2: float = 80.0) -> list[Array]:
    """Two bounces of 6 m/s^2 and four impacts of 10 ms a second of a gait, and a body that leans by 10 degrees."""
    times = np.arange(0.0, seconds, STEP_NS * 1e-9)
    forces = GRAVITY + 6.0 * np.sin(2.0 * np.pi * 4.0 * times)[:, None] * UP + 1.7 * np.array([1.0, 0.0, 0.0])
    hit = (times % 0.25) < 0.01
    forces[hit] += impact_mps2 * rng.normal(size=(int(hit.sum()), 3))
    return list(forces)


@pytest.mark.parametrize("seed", range(5))
def test_a_trot_with_impacts_is_no_contradiction(seed: int) -> None:
    assert not followed(GravityCheck("body's"), trot(10.0, np.random.default_rng(seed)))


def test_a_flight_without_a_foot_on_the_ground_is_not_counted(go1: RobotModel) -> None:
    sensing = sensing_of(go1)
    drive(sensing, GRAVITY, 2.0, load=50.0)
    drive(sensing, np.zeros(3), 1.0, load=0.0, start_s=2.0)
    assert not sensing.is_imu_aside
    assert not sensing.take_events()


def test_impacts_after_flights_are_no_contradiction() -> None:
    """A bound: three hard samples at each touch-down, and as long in the air as on the ground."""
    check = GravityCheck("body's")
    for row in range(20 * SECOND):
        phase = row % 90
        force = np.zeros(3) if phase >= 45 else GRAVITY * (20.0 if phase < 3 else 0.8)
        check.push(row * STEP_NS, force, None if phase >= 45 else UP)
    assert not check.take_events()


@pytest.mark.parametrize(
    ("turned", "within_s"),
    [(-GRAVITY, 0.15), (GRAVITY_MPS2 * np.array([1.0, 0.0, 0.0]), 0.25)],
    ids=["reversed", "a quarter turn"],
)
def test_gravity_elsewhere_is_found_within_a_quarter_of_a_second(turned: Array, within_s: float) -> None:
    check = GravityCheck("camera's")
    assert not followed(check, [GRAVITY] * 2 * SECOND)
    ((found_s, kind),) = followed(check, [turned] * SECOND, start_ns=2 * SECOND * STEP_NS)
    assert kind == "imu_set_aside"
    assert found_s < within_s
    assert check.is_aside


def test_it_is_used_again_after_a_second_of_agreement() -> None:
    check = GravityCheck("body's")
    followed(check, [GRAVITY] * 2 * SECOND + [-GRAVITY] * SECOND)
    ((again_s, kind),) = followed(check, [GRAVITY] * 3 * SECOND, start_ns=3 * SECOND * STEP_NS)
    assert kind == "imu_used_again"
    assert 1.0 < again_s < 2.0
    assert not check.is_aside


def test_the_event_names_the_imu_the_value_and_the_limit() -> None:
    check = GravityCheck("camera's")
    for row in range(3 * SECOND):
        check.push(row * STEP_NS, GRAVITY if row < 2 * SECOND else -GRAVITY, UP)
    (event,) = check.take_events()
    assert "the camera's accelerometer measures 6" in event.detail
    assert "limit 6.0" in event.detail
    assert "180 deg" in event.detail


def sensing_of(robot: RobotModel, *, checks: bool = True) -> LegSensing:
    contact = ContactConfig(source="force_sensor", on_force=20.0, off_force=10.0)
    return LegSensing(robot, contact, StandstillConfig(), force_timeout_s=0.1, checks_gravity=checks)


def drive(sensing: LegSensing, force: Array, seconds: float, *, load: float, start_s: float = 0.0) -> list[Reading]:
    readings = []
    for row in range(1, round(seconds * SECOND)):
        stamp_ns = round(start_s * 1e9) + row * STEP_NS
        sensing.push(ImuSample(stamp_ns, np.zeros(3), force), UP)
        sensing.push(FootForceSample(stamp_ns, np.full(4, load)), UP)
        reading = sensing.push(JointSample(stamp_ns, np.full(12, 0.3), np.full(12, 0.5), np.zeros(12)), UP)
        assert reading is not None
        readings.append(reading)
    return readings


@pytest.fixture(scope="module")
def go1() -> RobotModel:
    return RobotModel(load_robot("go1"))


def test_readings_have_no_imu_while_it_is_set_aside(go1: RobotModel) -> None:
    sensing = sensing_of(go1)
    assert drive(sensing, GRAVITY, 2.0, load=50.0)[-1].angular_velocity is not None
    last = drive(sensing, -GRAVITY, 1.0, load=50.0, start_s=2.0)[-1]
    assert (last.angular_velocity, last.specific_force, last.inertial) == (None, None, ())
    assert sensing.counts["imu_contradicts_gravity"] > 0.8 * SECOND
    assert [event.kind for event in sensing.take_events()] == ["imu_set_aside"]
    assert drive(sensing, GRAVITY, 3.0, load=50.0, start_s=3.0)[-1].angular_velocity is not None


def test_an_accelerometer_that_never_agreed_keeps_its_gyroscope(go1: RobotModel) -> None:
    """A driver that subtracts gravity."""
    sensing = sensing_of(go1)
    assert drive(sensing, np.zeros(3), 3.0, load=50.0)[-1].angular_velocity is not None
    assert not sensing.take_events()


def test_estimators_without_the_check_take_every_sample(go1: RobotModel) -> None:
    sensing = sensing_of(go1, checks=False)
    last = drive(sensing, -GRAVITY, 1.0, load=50.0)[-1]
    assert last.angular_velocity is not None
    assert not sensing.take_events()

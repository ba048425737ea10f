# SPDX-License-Identifier: BSD-3-Clause
"""A contact estimator from outside the package: registered by name, chosen by configuration, used by the filter."""

from collections.abc import Iterator

import numpy as np
import pytest

from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.robot.contact import (
    ContactConfig,
    ContactDetector,
    ContactEstimator,
    ContactState,
    contact_estimators,
    register_contact_estimator,
    unregister_contact_estimator,
)
from coclo_vio.robot.description import RobotDescription, load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial, AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.estimates import StateEstimate

SHARE = "load_share"


class LoadShare:
    """Stance of each leg that carries at least ``min_share`` of the whole load."""

    def __init__(self, config: ContactConfig, legs: int) -> None:
        self._min_share = config.parameters.get("min_share", 0.05)

    def update(self, stamp_ns: int, load: Array) -> ContactState:
        known = np.nan_to_num(np.maximum(load, 0.0))
        share = known / max(float(known.sum()), 1e-9)
        return ContactState(np.clip(share / (2.0 * self._min_share), 0.0, 1.0), share >= self._min_share, load)


@pytest.fixture
def load_share() -> Iterator[str]:
    register_contact_estimator(SHARE, LoadShare, "stance from a share of the load on", parameters=("min_share",))
    yield SHARE
    unregister_contact_estimator(SHARE)


@pytest.fixture(scope="module")
def walk() -> AnalyticTrial:
    body = BodyMotionConfig(rest_s=1.0, walk_s=2.5, stop_s=0.0, ramp_s=0.6, speed_mps=0.18)
    return generate(AnalyticTrialConfig(body=body), RobotModel(load_robot("daisy")), seed=9)


def daisy_with(**contact: object) -> RobotModel:
    """Daisy with changed keys of ``contact``, as from a configuration file."""
    values = load_robot("daisy").model_dump()
    values["contact"] |= contact
    return RobotModel(RobotDescription.parse(values, "robot"))


def estimates_of(robot: RobotModel, trial: AnalyticTrial) -> list[StateEstimate]:
    odometry = LegOdometryFilter(robot)
    return [estimate for estimate in map(odometry.push, trial.measurements) if estimate is not None]


def stances(estimates: list[StateEstimate]) -> np.ndarray:
    return np.array([estimate.feet.is_stance for estimate in estimates if estimate.feet is not None])


def test_an_estimator_from_outside_drives_the_filter(load_share: str, walk: AnalyticTrial) -> None:
    estimates = estimates_of(daisy_with(method=load_share), walk)
    moved = walk.truth.positions[-1] - walk.truth.positions[0]
    assert np.linalg.norm(moved) > 0.25
    assert np.linalg.norm(estimates[-1].nav.T_world_body[:3, 3] - moved) < 0.02
    walking = slice(-150, None)
    agrees = stances(estimates)[walking] == walk.stance[walking]
    assert agrees.mean() > 0.9
    built_in = stances(estimates_of(daisy_with(), walk))
    assert (built_in != stances(estimates)).any(), "the decision is that of the estimator from outside"


def test_its_parameters_reach_it(load_share: str, walk: AnalyticTrial) -> None:
    """With more than the share of any leg no leg is in stance, once the robot moves."""
    robot = daisy_with(method=load_share, parameters={"min_share": 0.9})
    assert not stances(estimates_of(robot, walk))[-150:].any()


def test_a_parameter_that_it_does_not_have_is_refused_with_those_it_has(load_share: str) -> None:
    with pytest.raises(ConfigError, match="'load_share' has no parameter min_shar; it has: min_share"):
        daisy_with(method=load_share, parameters={"min_shar": 0.1})


def test_registered_estimators_are_listed_with_their_rule(load_share: str) -> None:
    assert set(contact_estimators()) == {"hysteresis", "kinematic", "kinematic_load", "logistic", "paper", load_share}
    assert contact_estimators()[load_share] == "stance from a share of the load on"
    with pytest.raises(
        ConfigError, match="there are: hysteresis, kinematic, kinematic_load, load_share, logistic, paper"
    ):
        ContactConfig.parse({"method": "load_shar"}, "contact")


def test_without_registration_the_name_is_refused() -> None:
    with pytest.raises(ConfigError, match="no contact estimator 'load_share'"):
        ContactConfig.parse({"method": SHARE}, "contact")


def test_a_name_is_registered_once() -> None:
    with pytest.raises(ConfigError, match=r"'paper' is registered already: .*choose another name"):
        register_contact_estimator("paper", LoadShare, "another rule")
    assert ContactDetector(ContactConfig(method="paper", on_force=20, off_force=12), legs=1).update(
        0, np.array([16.0])
    ).probability[0] == pytest.approx(0.5)


class OneLeg:
    """Returns the contact of one leg, whatever the robot has."""

    def update(self, stamp_ns: int, load: Array) -> ContactState:
        return ContactState(np.ones(1), np.ones(1, dtype=np.bool_), load)


def one_leg(config: ContactConfig, legs: int) -> ContactEstimator:
    return OneLeg()


def test_a_result_for_another_number_of_legs_is_an_error_with_the_numbers() -> None:
    register_contact_estimator("one_leg", one_leg, "always stance")
    try:
        detector = ContactDetector(ContactConfig(method="one_leg"), legs=6)
        with pytest.raises(ConfigError, match=r"'one_leg': probability has shape \(1,\), but the robot has 6 legs"):
            detector.update(0, np.zeros(6))
    finally:
        unregister_contact_estimator("one_leg")

# SPDX-License-Identifier: BSD-3-Clause
"""Contact by the motion of the feet: on an analytic walk without any load, and the kernel against NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.robot import kinematic_kernel
from coclo_vio.robot.contact import ContactConfig, ContactDetector
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.foot_motion import FootMotion
from coclo_vio.robot.kinematic_contact import KinematicContact, KinematicContactConfig, weigh
from coclo_vio.robot.kinematic_kernel import FootEvidence, Scales
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial, AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.measurements import FootForceSample, JointSample, Measurement

UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def go1() -> RobotModel:
    description = load_robot("go1")
    contact = description.contact.model_copy(update={"source": "kinematic"})
    return RobotModel(description.model_copy(update={"contact": contact, "joint_velocity_noise_radps": 0.05}))


@pytest.fixture(scope="module")
def walk(go1: RobotModel) -> AnalyticTrial:
    body = BodyMotionConfig(rest_s=1.0, walk_s=3.0, stop_s=0.0, ramp_s=0.5, speed_mps=0.25)
    return generate(AnalyticTrialConfig(body=body, rate_hz=200.0), go1, seed=5)


def without_load(measurement: Measurement) -> Measurement | None:
    if isinstance(measurement, FootForceSample):
        return None
    if isinstance(measurement, JointSample):
        return replace(measurement, effort=np.full(len(measurement.effort), np.nan))
    return measurement


def estimates_of(robot: RobotModel, trial: AnalyticTrial) -> list[StateEstimate]:
    odometry = LegOdometryFilter(robot)
    kept = [each for each in map(without_load, trial.measurements) if each is not None]
    return [estimate for estimate in map(odometry.push, kept) if estimate is not None]


def test_stance_is_found_without_any_load(go1: RobotModel, walk: AnalyticTrial) -> None:
    estimates = estimates_of(go1, walk)
    stands = np.array([estimate.feet.is_stance for estimate in estimates if estimate.feet is not None])
    truth, moving = walk.stance[-len(stands) :], slice(-500, None)
    truth, stands = truth[moving], stands[moving]
    assert 0.05 < (~truth).mean() < 0.6
    assert stands[truth].mean() > 0.9
    assert stands[~truth].mean() < 0.4  # feet of this walk begin and end their swings slowly
    moved = walk.truth.positions[-1] - walk.truth.positions[0]
    assert np.linalg.norm(moved) > 0.5
    assert np.linalg.norm(estimates[-1].nav.T_world_body[:3, 3] - moved) < 0.08 * np.linalg.norm(moved)


def random_step(rng: np.random.Generator) -> tuple[np.ndarray, FootEvidence, Scales]:
    chances = rng.random(16)
    feet = FootEvidence(
        rng.normal(size=(4, 3)),
        rng.uniform(0.005, 0.05, 4),
        rng.normal(scale=0.05, size=4),
        rng.normal(size=4),
        np.array([True, True, False, True]),
    )
    return chances / chances.sum(), feet, Scales(0.03, 1.2, 0.002, 9e-4, 0.05, 0.2, 0.04)


def test_the_kernel_equals_numpy() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        chances, feet, scales = random_step(rng)
        by_kernel, by_numpy = chances.copy(), chances.copy()
        found, expected = kinematic_kernel.weigh(by_kernel, feet, scales), weigh(by_numpy, feet, scales)
        np.testing.assert_allclose(by_kernel, by_numpy, atol=1e-12)
        np.testing.assert_allclose(found, expected, atol=1e-12)
        assert not np.allclose(by_numpy, chances, atol=1e-3)


def test_transitions_keep_the_sum_and_tend_to_one_half() -> None:
    chances = np.zeros(16)
    chances[0] = 1.0
    for _ in range(200):
        kinematic_kernel.exchange(chances, np.full(4, 0.05), 0.05)
    np.testing.assert_allclose(chances, 1.0 / 16.0, atol=1e-6)


def motion(stamp_ns: int, velocity: np.ndarray, depth_m: np.ndarray) -> FootMotion:
    none = np.zeros(3)
    speed = np.linalg.norm(velocity, axis=1)
    return FootMotion(stamp_ns, velocity, np.zeros(4), depth_m, speed, 9.81 * UP, none, none, UP, is_stationary=False)


def after(seconds: float, velocity: np.ndarray, depth_m: np.ndarray) -> np.ndarray:
    contact = KinematicContact(KinematicContactConfig(), 4)
    at_rest = motion(0, np.zeros((4, 3)), np.full(4, 0.3))
    for k in range(100):
        probability = contact.update(replace(at_rest, stamp_ns=2_000_000 * k))
    for k in range(round(seconds * 500)):
        probability = contact.update(motion(200_000_000 + 2_000_000 * k, velocity, depth_m))
    return probability


def test_the_foot_that_contradicts_the_accelerometer_swings() -> None:
    """The body rests by the accelerometer; two feet move alike, and are higher."""
    velocity = np.array([[0.0, 0, 0], [-0.9, 0, 0], [-0.9, 0, 0], [0.0, 0, 0]])
    probability = after(0.05, velocity, np.array([0.3, 0.26, 0.26, 0.3]))
    assert (probability[[0, 3]] > 0.95).all()
    assert (probability[[1, 2]] < 0.05).all()


def test_a_leg_whose_kinematics_are_unknown_has_probability_zero() -> None:
    velocity = np.zeros((4, 3))
    velocity[2] = np.nan
    probability = after(0.05, velocity, np.where(np.isnan(velocity[:, 0]), np.nan, 0.3))
    assert probability[2] == 0.0
    assert (probability[[0, 1, 3]] > 0.9).all()


def test_more_legs_than_sets_can_be_followed_are_refused() -> None:
    with pytest.raises(ConfigError, match="9 legs are more than 8; set contact"):
        KinematicContact(KinematicContactConfig(), 9)


def test_without_a_load_estimators_of_the_load_give_way_to_motion() -> None:
    config = ContactConfig(source="kinematic", method="hysteresis")
    assert config.estimator == "kinematic"
    assert config.for_paper().estimator == "kinematic"
    assert ContactConfig().for_paper().estimator == "paper"
    detector = ContactDetector(config, 4)
    state = detector.update(0, np.full(4, np.nan), motion(0, np.zeros((4, 3)), np.full(4, 0.3)))
    assert detector.counts["contact_load_missing"] == 0
    assert ((state.probability > 0.0) & (state.probability < 1.0)).all()


def test_a_load_adds_its_odds() -> None:
    """Two feet are in doubt; the load decides."""
    config = ContactConfig(method="kinematic_load", on_force=30.0, off_force=20.0)
    detector = ContactDetector(config, 4)
    velocity = np.array([[0.0, 0, 0], [0.5, 0, 0], [0.5, 0, 0], [0.0, 0, 0]])
    load = np.array([50.0, 50.0, 0.0, 50.0])
    for k in range(10):
        state = detector.update(k * 2_000_000, load, motion(k * 2_000_000, velocity, np.full(4, 0.3)))
    odds = state.probability / (1.0 - state.probability)
    assert odds[1] > 1.5 * odds[2]
    np.testing.assert_array_equal(state.load, load)

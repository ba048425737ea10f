# SPDX-License-Identifier: BSD-3-Clause
"""Standing feet weigh less the further their velocity departs from the body's, against the exact motion of a walk."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from coclo_vio.filter.config import RobustConfig
from coclo_vio.filter.foot_weights import FootWeights, StanceNoise
from coclo_vio.filter.robust_profile import RobustProfile
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.stance import Footholds, FootMotion, Reading
from coclo_vio.filter.state import RATE, VELOCITY, State
from coclo_vio.robot.contact import ContactState
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial
from coclo_vio.values.units import GRAVITY_MPS2

WEIGHED = RobustConfig(weighs_feet=True, estimates_leg_compliance=False)
DT_S = 0.002
LIMIT_MPS = float(np.hypot(WEIGHED.foot_departure_mps, 0.001))  # and the velocity is known to 1 mm/s


class Walk:
    """One sample of a walk without noise, in the middle of it."""

    def __init__(self, robot: RobotModel, trial: AnalyticTrial) -> None:
        self.row = len(trial.truth) // 2
        motion = Footholds(self.reading_of(robot, trial, self.row - 1), robot.description.contact.on_force)
        self.reading = self.reading_of(robot, trial, self.row)
        self.motion: FootMotion = motion.advance(self.reading, speed_mps=0.0, is_gap=False)
        layout = RobustProfile(robot, WEIGHED, Counter()).layout
        vector = np.zeros(layout.dimension)
        vector[VELOCITY], vector[RATE] = trial.body.velocity[self.row], trial.body.angular_velocity[self.row]
        mean = State(layout, trial.body.rotation[self.row], vector, ())
        self.core = SquareRootFilter(mean, np.full(layout.dimension, 0.001), is_wide=False)
        self.radii_m = robot.foot_radii_m

    @staticmethod
    def reading_of(robot: RobotModel, trial: AnalyticTrial, row: int) -> Reading:
        feet = robot.feet(trial.joint_position[row], trial.joint_velocity[row])
        contact = ContactState(trial.stance[row].astype(float), trial.stance[row], trial.load_n[row])
        force = np.array([0.0, 0.0, GRAVITY_MPS2]) @ trial.body.rotation[row]
        rate = trial.body.angular_velocity[row]
        return Reading(int(trial.truth.stamps_ns[row]), feet, contact, rate, (), force, False)

    def noise(self, config: RobustConfig = WEIGHED, reading: Reading | None = None, level: float = 1.0) -> StanceNoise:
        weights = FootWeights(self.radii_m, config, has_soles=False)
        return weights.noise(self.core, reading or self.reading, self.motion, dt_s=DT_S, creep_level=level)

    def sliding(self, leg: int, velocity: np.ndarray) -> Reading:
        """The reading of a foot that slides, m/s, body axes."""
        moved = self.reading.feet.velocity_body.copy()
        moved[leg] += velocity
        return replace(self.reading, feet=replace(self.reading.feet, velocity_body=moved))


@pytest.fixture
def walk(daisy: RobotModel, clean_walk: AnalyticTrial) -> Walk:
    return Walk(daisy, clean_walk)


def test_a_foot_that_rolls_has_the_declared_noise_at_every_rate(walk: Walk) -> None:
    noise, stands = walk.noise(), walk.reading.is_stance
    assert 3 <= stands.sum() < 6
    np.testing.assert_allclose(noise.creep[stands], WEIGHED.stepping_creep, rtol=1e-6)
    np.testing.assert_allclose(noise.velocity, noise.creep / np.sqrt(DT_S), rtol=1e-12)


@pytest.mark.parametrize("speed_mps", [0.05, 0.3, 2.0])
def test_noise_grows_with_the_departure_in_any_direction(walk: Walk, speed_mps: float) -> None:
    leg = int(np.flatnonzero(walk.reading.is_stance)[1])
    expected = np.sqrt(1.0 + (speed_mps / LIMIT_MPS) ** 2)
    for axis in np.eye(3):
        noise = walk.noise(reading=walk.sliding(leg, speed_mps * axis))
        assert noise.creep[leg] == pytest.approx(WEIGHED.stepping_creep * expected, rel=1e-6)
        others = walk.reading.is_stance & (np.arange(6) != leg)
        np.testing.assert_allclose(noise.creep[others], WEIGHED.stepping_creep, rtol=1e-6)


def test_what_the_velocity_is_uncertain_by_is_no_departure(walk: Walk) -> None:
    leg = int(np.flatnonzero(walk.reading.is_stance)[0])
    sliding = walk.sliding(leg, np.array([0.5, 0.0, 0.0]))
    sure = walk.noise(reading=sliding).creep[leg]
    walk.core = SquareRootFilter(walk.core.mean, np.full(walk.core.mean.layout.dimension, 1.0), is_wide=False)
    assert walk.noise(reading=sliding).creep[leg] < 0.2 * sure


def test_a_departure_counts_after_some_samples_and_is_forgotten_at_lift_off(walk: Walk) -> None:
    weights, leg = FootWeights(walk.radii_m, WEIGHED, has_soles=False), int(np.flatnonzero(walk.reading.is_stance)[0])
    sliding = walk.sliding(leg, np.array([0.5, 0.0, 0.0]))

    def push(reading: Reading) -> float:
        noise = weights.noise(walk.core, reading, walk.motion, dt_s=DT_S, creep_level=1.0)
        return float(noise.creep[leg] / WEIGHED.stepping_creep)

    assert push(walk.reading) == pytest.approx(1.0, rel=1e-6)
    first = push(sliding)
    assert 1.0 < first < push(sliding) < 10.0
    for _ in range(20):
        last = push(sliding)
    assert last == pytest.approx(np.hypot(1.0, 0.5 / LIMIT_MPS), rel=0.01)
    lifted = walk.reading.is_stance.copy()
    lifted[leg] = False
    contact = replace(walk.reading.contact, is_stance=lifted)
    push(replace(walk.reading, contact=contact))
    assert push(walk.reading) == pytest.approx(1.0, rel=1e-6)


def test_where_no_foot_agrees_for_some_steps_the_prediction_is_wrong_and_all_count(walk: Walk) -> None:
    """0.5 ln 10 s: until then the share of feet that agree is above a tenth."""
    weights, velocity = FootWeights(walk.radii_m, WEIGHED, has_soles=False), walk.core.mean.vector[VELOCITY]
    velocity[0] += 1.0
    stands, levels = walk.reading.is_stance, []
    for _ in range(700):
        noise = weights.noise(walk.core, walk.reading, walk.motion, dt_s=DT_S, creep_level=1.0)
        levels.append(noise.creep[stands] / WEIGHED.stepping_creep)
    expected = np.hypot(1.0, 1.0 / LIMIT_MPS)
    np.testing.assert_allclose(levels[550], expected, rtol=1e-3)
    np.testing.assert_allclose(levels[600:], 1.0, rtol=1e-12)
    velocity[0] -= 1.0
    for _ in range(100):
        weights.noise(walk.core, walk.reading, walk.motion, dt_s=DT_S, creep_level=1.0)
    leg = int(np.flatnonzero(stands)[0])
    sliding = walk.sliding(leg, np.array([1.0, 0.0, 0.0]))
    for _ in range(20):
        noise = weights.noise(walk.core, sliding, walk.motion, dt_s=DT_S, creep_level=1.0)
    assert noise.creep[leg] > 10.0 * WEIGHED.stepping_creep


def test_at_rest_feet_have_the_creep_of_rest(walk: Walk) -> None:
    noise = walk.noise(reading=replace(walk.reading, is_stationary=True), level=0.5)
    stands = walk.reading.is_stance
    np.testing.assert_allclose(noise.creep[stands], 0.5 * WEIGHED.foothold_creep, rtol=1e-6)
    np.testing.assert_allclose(noise.velocity[stands], WEIGHED.foot_velocity_noise_mps, rtol=1e-12)


def test_without_a_standing_foot_any_foot_has_the_noise_of_no_contact(walk: Walk) -> None:
    contact = replace(walk.reading.contact, is_stance=np.zeros(6, dtype=np.bool_))
    for config in (WEIGHED, RobustConfig()):
        noise = walk.noise(config, reading=replace(walk.reading, contact=contact))
        np.testing.assert_allclose(noise.velocity, config.no_contact_velocity_density / np.sqrt(DT_S), rtol=1e-12)


def test_feet_that_are_not_weighed_have_the_declared_noise(walk: Walk) -> None:
    config = RobustConfig()
    leg = int(np.flatnonzero(walk.reading.is_stance)[0])
    noise = walk.noise(config, reading=walk.sliding(leg, np.array([1.0, 0.0, 0.0])), level=0.4)
    np.testing.assert_allclose(noise.creep, 0.4 * config.foothold_creep, rtol=1e-12)
    np.testing.assert_allclose(noise.velocity, config.foot_velocity_noise_mps, rtol=1e-12)


@pytest.mark.parametrize(
    ("legs", "has_soles", "asked", "expected"),
    [
        (4, False, None, True),
        (2, True, None, False),
        (6, False, None, False),
        (6, False, True, True),
        (4, False, False, False),
    ],
)
def test_round_feet_of_few_legs_are_weighed(legs: int, has_soles: bool, asked: bool | None, expected: bool) -> None:
    weights = FootWeights(np.zeros(legs), RobustConfig(weighs_feet=asked), has_soles=has_soles)
    assert weights.is_used == expected

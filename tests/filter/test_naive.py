# SPDX-License-Identifier: BSD-3-Clause
"""The naive baseline on exact sensors: its only error is the one that it is meant to show."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from coclo_vio.filter.config import FilterConfig
from coclo_vio.filter.naive import NaiveLegOdometry
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import CocloError, RobotModelError
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample, Measurement

Odometry = Callable[..., NaiveLegOdometry]


@pytest.fixture
def odometry(daisy: RobotModel) -> Odometry:
    def make(*, rolls_feet: bool = True, weighs_load: bool = False) -> NaiveLegOdometry:
        return NaiveLegOdometry(daisy, FilterConfig(), rolls_feet=rolls_feet, weighs_load=weighs_load)

    return make


def _estimates(odometry: NaiveLegOdometry, measurements: list[Measurement]) -> list[StateEstimate]:
    return [estimate for sample in measurements if (estimate := odometry.push(sample)) is not None]


def _displacement(estimates: list[StateEstimate]) -> Array:
    return estimates[-1].nav.T_world_body[:3, 3] - estimates[0].nav.T_world_body[:3, 3]


def _travelled(trial: AnalyticTrial, estimates: list[StateEstimate]) -> tuple[Array, int]:
    """The true displacement in the estimator's world, which starts at its first estimate, and that one's index."""
    first = int(np.searchsorted(trial.truth.stamps_ns, estimates[0].stamp_ns))
    return trial.truth.positions[-1] - trial.truth.positions[first], first


@pytest.mark.parametrize("weighs_load", [False, True])
def test_with_rolling_feet_and_exact_sensors_it_hardly_drifts(weighs_load, odometry, clean_walk) -> None:
    estimates = _estimates(odometry(weighs_load=weighs_load), clean_walk.measurements)
    travelled, _ = _travelled(clean_walk, estimates)
    length = np.linalg.norm(travelled)
    assert length > 0.3
    assert np.linalg.norm(_displacement(estimates) - travelled) < 2e-3 * length


def test_without_rolling_the_distance_is_short_by_what_the_feet_rolled(odometry, clean_walk) -> None:
    """The mean motion of the standing foot centres on the ground is missing from its distance."""
    estimates = _estimates(odometry(rolls_feet=False), clean_walk.measurements)
    travelled, first = _travelled(clean_walk, estimates)
    steps = np.diff(clean_walk.feet_world[first:], axis=0)
    stands = (clean_walk.stance[first:-1] & clean_walk.stance[first + 1 :])[:, :, None]
    rolled = ((steps * stands).sum(axis=1) / stands.sum(axis=1)).sum(axis=0)
    share = rolled[0] / travelled[0]
    assert 0.02 < share < 0.06
    missed = (travelled - _displacement(estimates))[0] / travelled[0]
    assert missed == pytest.approx(share, rel=0.1)


def test_the_gyroscope_bias_at_rest_is_subtracted(odometry, clean_walk) -> None:
    bias = np.array([0.004, -0.006, 0.01])
    biased = [
        replace(sample, angular_velocity=sample.angular_velocity + bias) if isinstance(sample, ImuSample) else sample
        for sample in clean_walk.measurements
    ]
    plain, shifted = (_estimates(odometry(), list(samples))[-1] for samples in (clean_walk.measurements, biased))
    np.testing.assert_allclose(shifted.nav.gyroscope_bias, bias, atol=1e-3)
    np.testing.assert_allclose(shifted.nav.T_world_body, plain.nav.T_world_body, atol=2e-3)


def test_the_attitude_starts_level_with_gravity(odometry, clean_walk) -> None:
    first = _estimates(odometry(), clean_walk.measurements)[0]
    np.testing.assert_allclose(first.nav.T_world_body[2, :3], clean_walk.body.rotation[0, 2], atol=1e-6)


def test_without_any_stance_leg_the_last_velocity_goes_on_and_is_counted(odometry, clean_walk) -> None:
    from_ns = int(2.0e9)
    lifted = [
        replace(sample, effort=np.full(18, np.nan))
        if isinstance(sample, JointSample) and sample.stamp_ns > from_ns
        else sample
        for sample in clean_walk.measurements
        if sample.stamp_ns <= from_ns + 100_000_000
    ]
    naive = odometry()
    estimates = [estimate for estimate in _estimates(naive, lifted) if estimate.stamp_ns >= from_ns]
    assert naive.counts["no_stance_leg"] == 10
    velocities = np.array([estimate.nav.velocity_world for estimate in estimates])
    assert np.linalg.norm(velocities[0]) > 0.1
    assert (velocities == velocities[0]).all()
    assert not estimates[-1].feet.is_stance.any()


def test_weighed_legs_count_in_proportion_to_their_load(daisy, clean_walk) -> None:
    """One leg, just loaded, has a false velocity: the error of the mean is in proportion to its share of the weight."""
    share = clean_walk.load_n / clean_walk.load_n.sum(axis=1, keepdims=True)
    is_taking = (share > 0.06) & (share < 0.12)
    sample, leg = (int(index) for index in np.argwhere(is_taking)[-1])
    contact = daisy.description.contact.model_copy(update={"compensation": "gravity", "on_dwell_s": 0.0})
    contact = contact.model_copy(update={"on_force": 6.0, "off_force": 3.0})
    robot = RobotModel(daisy.description.model_copy(update={"contact": contact}))
    error_mps = {}
    for weighs_load in (False, True):
        ends = [
            _estimates(
                NaiveLegOdometry(robot, FilterConfig(), rolls_feet=True, weighs_load=weighs_load),
                _with_false_velocity(clean_walk, sample, daisy.leg_joint_slices[leg], radps),
            )[-1]
            for radps in (0.0, 0.5)
        ]
        error_mps[weighs_load] = np.linalg.norm(ends[1].nav.velocity_world - ends[0].nav.velocity_world)
        stance_legs = ends[0].feet.is_stance.sum()
    assert error_mps[True] / error_mps[False] == pytest.approx(share[sample, leg] * stance_legs, rel=0.1)


def _with_false_velocity(trial: AnalyticTrial, sample: int, joints: slice, radps: float) -> list[Measurement]:
    """The measurements up to a sample, whose joints of one leg turn faster by ``radps``."""
    *before, last = trial.measurements[: 3 * sample + 3]
    assert isinstance(last, JointSample)
    velocity = last.velocity.copy()
    velocity[joints] += radps
    return [*before, replace(last, velocity=velocity)]


def test_a_sample_of_another_robot_is_refused_with_the_numbers(odometry) -> None:
    with pytest.raises(RobotModelError, match="12 joints, robot 'daisy' has 18"):
        odometry().push(JointSample(0, np.zeros(12), np.zeros(12), np.zeros(12)))
    with pytest.raises(CocloError, match="4 entries, robot 'daisy' has 6 legs"):
        odometry().push(FootForceSample(0, np.zeros(4)))

# SPDX-License-Identifier: BSD-3-Clause
"""Revisions of the filter's state: another prior after all measurements, and a gyroscope whose bias has stepped."""

import numpy as np
import pytest
from state_layouts import layout_of, state_of

from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.filter.revision import (
    Prior,
    Snapshot,
    replace_prior,
    replaced_prior,
    resume_from,
    shift_gyroscope,
)
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.state import GYROSCOPE_BIAS, POSITION, RATE, ROTATION, VELOCITY
from coclo_vio.geometry import se3
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import FilterError

LAYOUT = layout_of(2, has_frame=True)


def random_filter(seed: int, sigma: float = 0.01) -> SquareRootFilter:
    random = np.random.default_rng(seed)
    core = SquareRootFilter(state_of(LAYOUT, random), np.ones(LAYOUT.dimension), is_wide=False)
    core.factor = sigma * np.tril(random.normal(size=core.factor.shape))
    return core


def posterior(prior: Prior, rows: Array, measured: Array) -> tuple[Array, Array]:
    """Mean and covariance of six states of which the last three have this prior, by one system of all measurements."""
    information, vector = rows.T @ rows + 1e-2 * np.eye(6), rows.T @ measured
    information[3:, 3:] += np.linalg.inv(prior.covariance) - 1e-2 * np.eye(3)
    vector[3:] += np.linalg.solve(prior.covariance, prior.mean)
    covariance = np.linalg.inv(information)
    return covariance @ vector, covariance


@pytest.mark.parametrize("seed", range(3))
def test_a_replaced_prior_is_as_if_it_had_held_from_the_start(seed: int) -> None:
    random = np.random.default_rng(seed)
    rows, measured = random.normal(size=(7, 6)), random.normal(size=7)
    before = Prior(0.1 * random.normal(size=3), np.diag([0.01, 0.02, 0.03]))
    after = Prior(random.normal(size=3), np.diag([3.0, 2.0, 1.0]) + 0.1)
    mean, covariance = posterior(before, rows, measured)
    columns, step = replaced_prior(covariance, slice(3, 6), mean[3:], before, after)
    expected, expected_covariance = posterior(after, rows, measured)
    np.testing.assert_allclose(covariance + columns @ columns.T, expected_covariance, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(mean + step, expected, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("variances", [(0.005, 0.005, 0.005), (3.0, 0.02, 0.003)])
def test_along_an_axis_on_which_the_new_prior_is_not_wider_only_its_mean_is_replaced(
    variances: tuple[float, float, float],
) -> None:
    random = np.random.default_rng(4)
    rows, measured = random.normal(size=(7, 6)), random.normal(size=7)
    before = Prior(np.zeros(3), np.diag([0.01, 0.02, 0.03]))
    after = Prior(np.array([0.1, -0.2, 0.3]), np.diag(variances))
    mean, covariance = posterior(before, rows, measured)
    columns, step = replaced_prior(covariance, slice(3, 6), mean[3:], before, after)
    widened = Prior(after.mean, np.diag(np.maximum(variances, [0.01, 0.02, 0.03])))
    expected, expected_covariance = posterior(widened, rows, measured)
    np.testing.assert_allclose(covariance + columns @ columns.T, expected_covariance, rtol=5e-3, atol=1e-4)
    np.testing.assert_allclose(mean + step, expected, rtol=5e-3, atol=1e-3)


def test_a_prior_that_nothing_has_measured_is_just_the_new_one() -> None:
    before, after = Prior(np.zeros(3), np.eye(3) * 1e-4), Prior(np.full(3, 0.05), np.eye(3) * 1e-2)
    covariance = np.diag([1.0, 1.0, 1.0, 1e-4, 1e-4, 1e-4])
    columns, step = replaced_prior(covariance, slice(3, 6), np.zeros(3), before, after)
    np.testing.assert_allclose((columns @ columns.T + covariance)[3:, 3:], np.eye(3) * 1e-2, rtol=1e-3)
    np.testing.assert_allclose(step, [0, 0, 0, 0.05, 0.05, 0.05], rtol=1e-3, atol=1e-12)


def test_the_filter_gets_the_new_prior_in_every_state_that_depends_on_it() -> None:
    core = random_filter(1)
    at = slice(LAYOUT.at("camera").start, LAYOUT.at("camera").start + 3)
    covariance, mean = core.factor @ core.factor.T, core.mean
    before = Prior(np.zeros(3), 2.0 * covariance[at, at])
    after = Prior(np.array([0.05, 0.0, -0.05]), 100.0 * covariance[at, at])
    columns, step = replaced_prior(covariance, at, mean.vector[at], before, after)
    replace_prior(core, "camera", before, after)
    np.testing.assert_allclose(core.factor @ core.factor.T, covariance + columns @ columns.T, atol=1e-12)
    np.testing.assert_allclose(core.mean.vector[at], mean.vector[at] + step[at], atol=1e-12)
    assert np.linalg.norm(step[POSITION]) > 1e-3


def test_a_shifted_bias_leaves_what_the_gyroscope_reads() -> None:
    core = random_filter(2)
    before, bias = core.mean.vector, np.array([0.05, -0.02, 0.01])
    reading = np.hstack((np.eye(3), np.eye(3)))
    both = np.r_[RATE, GYROSCOPE_BIAS]
    of_reading = reading @ (core.factor @ core.factor.T)[np.ix_(both, both)] @ reading.T
    shift_gyroscope(core, bias, 0.3)
    after = core.mean.vector
    np.testing.assert_allclose(after[GYROSCOPE_BIAS], bias, atol=1e-12)
    np.testing.assert_allclose(after[RATE] + bias, before[RATE] + before[GYROSCOPE_BIAS], atol=1e-12)
    joint = core.factor @ core.factor.T
    np.testing.assert_allclose(reading @ joint[np.ix_(both, both)] @ reading.T, of_reading, atol=1e-9)
    assert np.sqrt(joint[GYROSCOPE_BIAS, GYROSCOPE_BIAS].diagonal()).min() > 0.29


def test_a_filter_that_resumes_has_the_slow_states_of_before_at_the_new_pose() -> None:
    core, later = random_filter(3), random_filter(4)
    before = Snapshot.of(core)
    T_world_body = se3.exp(np.array([0.1, -0.2, 0.3, 1.0, 2.0, 0.5]))
    now = later.mean
    resume_from(later, before, T_world_body, (0.0, 0.0))
    mean, vector = later.mean, later.mean.vector
    np.testing.assert_allclose(mean.rotation, T_world_body[:3, :3], atol=1e-12)
    np.testing.assert_allclose(vector[POSITION], T_world_body[:3, 3], atol=1e-12)
    for name in ("accelerometer_bias", "gyroscope_bias", "slip", "slip_turn", "leg_scale", "camera"):
        np.testing.assert_array_equal(vector[LAYOUT.at(name)], before.mean.vector[LAYOUT.at(name)])
    in_body = (mean.feet - vector[POSITION]) @ mean.rotation
    np.testing.assert_allclose(in_body, (now.feet - now.vector[POSITION]) @ now.rotation, atol=1e-12)
    np.testing.assert_allclose(mean.rotation.T @ vector[VELOCITY], now.rotation.T @ now.vector[VELOCITY], atol=1e-12)
    pose = np.r_[ROTATION, POSITION]
    covariance, old = later.factor @ later.factor.T, before.factor @ before.factor.T
    np.testing.assert_allclose(covariance[np.ix_(pose, pose)], old[np.ix_(pose, pose)], atol=1e-12)
    assert np.linalg.eigvalsh(covariance)[0] > 0.0


def test_a_filter_that_has_not_started_has_nothing_to_revise() -> None:
    odometry = LegOdometryFilter(RobotModel(load_robot("daisy")), remembers_frames=True)
    with pytest.raises(FilterError, match="has not started"):
        odometry.snapshot()
    with pytest.raises(FilterError, match="has not started"):
        odometry.revise_mounting(Prior(np.zeros(3), np.eye(3)))

# SPDX-License-Identifier: BSD-3-Clause
"""The square-root transform and update against the Kalman filter, and against moments known by hand."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coclo_vio.filter.unscented_transform import SigmaSpread, change_of_gain, correct, lower_factor

STATES, STEPS = 9, 60


def random_factor(random: np.random.Generator, length: int) -> np.ndarray:
    return np.tril(random.normal(size=(length, length))) + length * np.eye(length)


def covariance_of(rows: np.ndarray) -> np.ndarray:
    return rows.T @ rows


def transformed(
    points: SigmaSpread, factor: np.ndarray, model: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of the images of N(0, S S^T) under ``model``, which maps stacks of states."""
    images = model(points.points(factor))
    mean = points.mean(images)
    return mean, covariance_of(points.rows(images - mean))


@pytest.mark.parametrize("curved", [0, 3, STATES])
def test_linear_model_equals_the_kalman_filter(curved: int) -> None:
    """Random dynamics, one to three random rows measured at a time: most of the state is unobserved at every step."""
    random = np.random.default_rng(11)
    points = SigmaSpread(STATES, curved, float(max(curved, 1)))
    mean = random.normal(size=STATES)
    factor = random_factor(random, STATES) / STATES
    kalman_mean, kalman = mean.copy(), factor @ factor.T
    for _ in range(STEPS):
        dynamics = np.eye(STATES) + 0.1 * random.normal(size=(STATES, STATES))
        process_rows = 0.1 * random.normal(size=(4, STATES))  # Q of rank 4
        row_count = int(random.integers(1, 4))
        sensor = random.normal(size=(row_count, STATES)) * (random.uniform(size=STATES) < 0.4)
        noise_rows = np.triu(random.normal(size=(row_count, row_count))) + 2.0 * np.eye(row_count)
        measured = random.normal(size=row_count)

        images = (mean + points.points(factor)) @ dynamics.T
        mean = points.mean(images)
        factor = lower_factor(np.concatenate((points.rows(images - mean), process_rows)))
        predictions = (mean + points.points(factor)) @ sensor.T
        expected = points.mean(predictions)
        correction = correct(factor, points.rows(predictions - expected), noise_rows, measured - expected)
        mean, factor = mean + correction.step, correction.factor

        kalman_mean, kalman = dynamics @ kalman_mean, dynamics @ kalman @ dynamics.T + covariance_of(process_rows)
        innovation = measured - sensor @ kalman_mean
        S = sensor @ kalman @ sensor.T + covariance_of(noise_rows)
        gain = np.linalg.solve(S, sensor @ kalman).T
        kalman_mean, kalman = kalman_mean + gain @ innovation, kalman - gain @ S @ gain.T

        scale = np.abs(kalman).max()
        np.testing.assert_allclose(mean, kalman_mean, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(factor @ factor.T / scale, kalman / scale, rtol=0, atol=1e-10)
        assert correction.innovation_squared == pytest.approx(innovation @ np.linalg.solve(S, innovation), rel=1e-10)
        assert np.array_equal(factor, np.tril(factor)), "QR hands back an upper triangle, the filter keeps the lower"


def test_an_unobserved_state_keeps_its_covariance_and_its_mean() -> None:
    factor = np.diag([1.0, 2.0, 3.0])
    sensor = np.array([[1.0, 0.0, 0.0]])
    correction = correct(factor, factor.T @ sensor.T, np.array([[1.0]]), np.array([2.0]))
    np.testing.assert_allclose(correction.step, [1.0, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(correction.factor @ correction.factor.T, np.diag([0.5, 4.0, 9.0]), atol=1e-14)
    assert correction.innovation_squared == pytest.approx(2.0)


def test_more_measurements_than_states_and_a_certain_state() -> None:
    """Seven rows on three states, one of which has no uncertainty at all: its factor row is zero and stays zero."""
    random = np.random.default_rng(3)
    factor = np.diag([0.7, 0.0, 1.3])
    sensor, innovation = random.normal(size=(7, 3)), random.normal(size=7)
    correction = correct(factor, factor.T @ sensor.T, 0.5 * np.eye(7), innovation)
    P = factor @ factor.T
    S = sensor @ P @ sensor.T + 0.25 * np.eye(7)
    gain = P @ sensor.T @ np.linalg.inv(S)
    np.testing.assert_allclose(correction.step, gain @ innovation, atol=1e-12)
    np.testing.assert_allclose(correction.factor @ correction.factor.T, P - gain @ S @ gain.T, atol=1e-12)
    assert correction.step[1] == 0.0


@given(seed=st.integers(0, 2**32 - 1), curved=st.integers(0, 4))
def test_one_point_is_enough_in_flat_columns(seed: int, curved: int) -> None:
    """The reduced set equals the full one of the same width where the model is linear from column ``curved`` on."""
    random = np.random.default_rng(seed)
    length, outputs = 6, 5
    bend, twist = random.normal(size=(2, outputs, curved)), random.normal(size=(outputs, length))
    mixing = random.normal(size=(outputs, curved, length))

    def model(stack: np.ndarray) -> np.ndarray:
        """Curved in the leading states, linear in the rest given them (bilinear terms included)."""
        lead, rest = stack[:, :curved], stack.copy()
        rest[:, :curved] = 0.0
        waves = np.sin(lead @ bend[0].T) + (lead @ bend[1].T) ** 2
        return waves + stack @ twist.T + np.einsum("oci,pc,pi->po", mixing, lead, rest)

    factor = random_factor(random, length) / length
    width_squared = float(length)
    full = transformed(SigmaSpread(length, length, width_squared), factor, model)
    reduced = transformed(SigmaSpread(length, curved, width_squared), factor, model)
    for one, other in zip(full, reduced, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


def test_a_curved_column_that_is_called_flat_gives_another_result() -> None:
    """The saving is not free of conditions: the test above could fail."""
    factor = np.eye(3)
    full = transformed(SigmaSpread(3, 3, 3.0), factor, lambda stack: stack**2)
    reduced = transformed(SigmaSpread(3, 1, 3.0), factor, lambda stack: stack**2)
    assert np.abs(full[0] - reduced[0]).max() > 0.5


@pytest.mark.parametrize("width_squared", [1.0, 2.0, 3.0])
def test_moments_of_a_quadratic(width_squared: float) -> None:
    """x ~ N(0, s^2): the mean of x^2 is s^2 for every width; its variance s^4 (c^2 - 1), exact (2 s^4) for c^2 = 3."""
    sigma = 0.8
    points = SigmaSpread(1, 1, width_squared)
    mean, variance = transformed(points, np.array([[sigma]]), lambda stack: stack**2)
    assert mean[0] == pytest.approx(sigma**2, rel=1e-12)
    assert variance[0, 0] == pytest.approx(sigma**4 * (width_squared - 1.0), rel=1e-12, abs=1e-14)


def test_mean_of_a_product_is_its_covariance() -> None:
    factor = np.array([[1.5, 0.0], [-0.6, 0.9]])
    points = SigmaSpread(2, 2, 2.0)
    mean, _ = transformed(points, factor, lambda stack: stack[:, :1] * stack[:, 1:])
    assert mean[0] == pytest.approx((factor @ factor.T)[0, 1], rel=1e-12)


@given(seed=st.integers(0, 2**32 - 1), extra=st.integers(0, 20))
def test_lower_factor_is_lower_and_keeps_the_covariance(seed: int, extra: int) -> None:
    random = np.random.default_rng(seed)
    rows = random.normal(size=(5 + extra, 5))
    factor = lower_factor(rows)
    assert np.array_equal(factor, np.tril(factor))
    np.testing.assert_allclose(factor @ factor.T, rows.T @ rows, atol=1e-11)


def test_considered_errors_keep_their_mean_and_reduce_the_gain_of_the_others() -> None:
    """Joseph's form with the gain of two errors set to zero."""
    random = np.random.default_rng(21)
    root = random.normal(size=(6, 6))
    prior, H, R = root @ root.T, random.normal(size=(3, 6)), 0.1 * np.eye(3)
    factor, innovation = np.linalg.cholesky(prior), random.normal(size=3)
    considered = slice(2, 4)
    correction = correct(factor, (H @ factor).T, np.sqrt(0.1) * np.eye(3), innovation, considered)
    gain = prior @ H.T @ np.linalg.inv(H @ prior @ H.T + R)
    gain[considered] = 0.0
    rest = np.eye(6) - gain @ H
    np.testing.assert_allclose(correction.step, gain @ innovation, atol=1e-12)
    np.testing.assert_allclose(
        correction.factor @ correction.factor.T, rest @ prior @ rest.T + gain @ R @ gain.T, atol=1e-9
    )
    np.testing.assert_allclose(np.diag(correction.factor @ correction.factor.T)[considered], np.diag(prior)[considered])


def test_a_conditional_gain_is_that_of_the_covariance_given_the_considered_errors() -> None:
    """Joseph's form with the gain of a filter that knows two errors exactly; they themselves keep mean and variance."""
    random = np.random.default_rng(22)
    root = random.normal(size=(6, 6))
    prior, H, R = root @ root.T, random.normal(size=(3, 6)), 0.1 * np.eye(3)
    factor, innovation = np.linalg.cholesky(prior), random.normal(size=3)
    considered = slice(2, 4)
    known = prior[:, considered] @ np.linalg.inv(prior[considered, considered])
    given = prior - known @ prior[considered]
    gain = given @ H.T @ np.linalg.inv(H @ given @ H.T + R)
    np.testing.assert_allclose(gain[considered], 0.0, atol=1e-10)
    optimal = correct(factor, (H @ factor).T, np.sqrt(0.1) * np.eye(3), innovation)
    change, shares = change_of_gain(prior[:, considered], optimal.triangle[:, 3:], considered)
    np.testing.assert_allclose(optimal.step + change @ (shares @ optimal.whitened), gain @ innovation, atol=1e-9)
    rest = np.eye(6) - gain @ H
    changed = change @ shares
    np.testing.assert_allclose(
        optimal.factor @ optimal.factor.T + changed @ changed.T,
        rest @ prior @ rest.T + gain @ R @ gain.T,
        atol=1e-8,
    )

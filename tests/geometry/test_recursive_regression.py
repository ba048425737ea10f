# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from coclo_vio.geometry.recursive_regression import RecursiveRegression

TRUTH = np.array([0.3, -0.2])


def batches(rng: np.random.Generator, count: int, sigma: float, *, wrong: float = 0.0) -> list[tuple[np.ndarray, ...]]:
    rows = [np.column_stack((np.ones(20), rng.normal(size=20))) for _ in range(count)]
    scales = [np.where(rng.random(20) < wrong, 10.0, sigma) for _ in rows]
    noise = [rng.normal(scale=each) for each in scales]
    return [(each, each @ TRUTH + off) for each, off in zip(rows, noise, strict=True)]


def learnt(values: list[tuple[np.ndarray, ...]], memory: float = 1e9, **prior: float) -> RecursiveRegression:
    regression = RecursiveRegression(np.full(2, prior.get("sigma", 10.0)), 0.1, 1e-6, memory)
    for rows, of_rows in values:
        regression.learn(rows, of_rows)
    return regression


def test_errors_are_as_large_as_claimed() -> None:
    rng = np.random.default_rng(1)
    found = [learnt(batches(rng, 25, 0.1)) for _ in range(100)]
    normalised = np.array([(each.estimate - TRUTH) / each.sigmas for each in found])
    np.testing.assert_allclose(np.square(normalised).mean(axis=0), 1.0, atol=0.45)


def test_the_spread_of_the_values_is_learnt() -> None:
    assert learnt(batches(np.random.default_rng(2), 200, 0.5), memory=500.0).sigma == pytest.approx(0.5, rel=0.15)


def test_a_tenth_of_wrong_values_hardly_matters() -> None:
    found = learnt(batches(np.random.default_rng(3), 50, 0.1, wrong=0.1))
    np.testing.assert_allclose(found.estimate, TRUTH, atol=0.02)


def test_a_narrow_prior_holds_against_few_values_and_is_never_forgotten() -> None:
    found = learnt(batches(np.random.default_rng(4), 1000, 0.1), memory=40.0, sigma=1e-3)
    assert np.abs(found.estimate).max() < 0.01


def test_constants_that_change_are_followed() -> None:
    rng = np.random.default_rng(5)
    regression = learnt(batches(rng, 50, 0.1), memory=200.0)
    for rows, values in batches(rng, 50, 0.1):
        regression.learn(rows, values + 0.5)
    assert regression.estimate[0] == pytest.approx(TRUTH[0] + 0.5, abs=0.05)


def test_a_constant_that_is_known_to_be_zero_stays_zero() -> None:
    assert np.abs(learnt(batches(np.random.default_rng(6), 50, 0.1), sigma=0.0).estimate).max() < 1e-9


def test_nothing_changes_nothing() -> None:
    regression = learnt([(np.zeros((0, 2)), np.zeros(0))])
    np.testing.assert_array_equal(regression.estimate, 0.0)
    np.testing.assert_allclose(regression.sigmas, 10.0)

# SPDX-License-Identifier: BSD-3-Clause
"""Whole steps of both profiles equal an unscented Kalman filter in plain covariance form.

The dense filter below takes all 2 L + 1 sigma points from a Cholesky factor, weighs the centre by ``1 - L / c^2``
(negative where the points are near), sums outer products and subtracts ``K S K^T``.
"""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest

from coclo_vio.filter.config import PaperConfig, RobustConfig
from coclo_vio.filter.paper_profile import PaperProfile
from coclo_vio.filter.robust_profile import RobustProfile
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.stance import Reading
from coclo_vio.filter.state import LEG_COMPLIANCE, LEG_SCALE, POSITION, VELOCITY, State
from coclo_vio.geometry import so3
from coclo_vio.geometry.compiled import IS_COMPILED
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial
from coclo_vio.values.measurements import Measurement

STEPS, FIRST = 60, 130
DT_S, GYROSCOPE_NOISE = 0.01, 2e-3


class DenseFilter:
    """The steps of ``SquareRootFilter`` with a covariance instead of a factor."""

    def __init__(self, mean: State, sigmas: np.ndarray, *, is_wide: bool) -> None:
        self.mean, self.covariance, self.is_wide = mean, np.diag(sigmas**2), is_wide

    def _points(self, curved: int) -> tuple[np.ndarray, np.ndarray]:
        length = len(self.covariance)
        width_squared = float(length if self.is_wide else curved)
        columns = np.sqrt(width_squared) * np.linalg.cholesky(self.covariance).T
        weights = np.full(2 * length + 1, 0.5 / width_squared)
        weights[0] = 1.0 - length / width_squared
        return np.concatenate((np.zeros((1, length)), columns, -columns)), weights

    def predict(self, process: Callable[[State], State], noise: Callable[[State], np.ndarray]) -> None:
        errors, weights = self._points(self.mean.layout.curved_in_process)
        moved = process(self.mean.spread(errors))
        vector = moved.vector[0].copy()
        layout = self.mean.layout
        for at in layout.rotations:
            vector[at] = 0.0
        centre = State(layout, moved.rotation[0], vector, self.mean.remembered)
        shift = weights @ centre.errors_of(moved)
        self.mean = centre.corrected(shift)
        deviations = self.mean.errors_of(moved)
        added = noise(self.mean)
        self.covariance = (weights[:, None] * deviations).T @ deviations + added.T @ added

    def observe(self, model: Callable[[State], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        errors, weights = self._points(self.mean.layout.curved_in_measurement)
        images = model(self.mean.spread(errors))
        mean = weights @ images
        deviations = images - mean
        self._cross = (weights[:, None] * errors).T @ deviations
        values, vectors = np.linalg.eigh((weights[:, None] * deviations).T @ deviations)
        self._rows = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
        return mean, self._rows

    def variance(self, errors: slice) -> np.ndarray:
        return np.diag(self.covariance)[errors]

    def update(
        self,
        rows: np.ndarray,
        noise_rows: np.ndarray,
        innovation: np.ndarray,
        considered: slice = slice(0, 0),
        *,
        is_conditional: bool = False,
    ) -> None:
        """``rows`` are columns of what ``observe`` gave; the places of these columns are found again."""
        kept = [int(np.flatnonzero((self._rows == column[:, None]).all(axis=0))[0]) for column in rows.T]
        S = rows.T @ rows + noise_rows.T @ noise_rows
        cross = self._cross[:, kept]
        gain = np.linalg.solve(S, cross.T).T
        if is_conditional:  # the gain by the covariances given the considered errors
            own = np.linalg.inv(self.covariance[considered, considered])
            given = cross - self.covariance[:, considered] @ own @ cross[considered]
            gain = np.linalg.solve(S - cross[considered].T @ own @ cross[considered], given.T).T
        gain[considered] = 0.0
        covariance = self.covariance - gain @ cross.T - cross @ gain.T + gain @ S @ gain.T
        self.covariance = 0.5 * (covariance + covariance.T)
        self.mean = self.mean.corrected(gain @ innovation)


def start(profile: RobustProfile | PaperProfile, reading: Reading, truth: AnalyticTrial) -> tuple[State, np.ndarray]:
    """A mean near the truth, in a turned world far from its origin, and sigmas that differ from error to error."""
    random = np.random.default_rng(5)
    layout = profile.layout
    turn = so3.about_z(2.5)
    rotation = turn @ truth.body.rotation[FIRST] @ so3.exp(0.02 * random.normal(size=3))
    position = np.array([30.0, -20.0, 0.4])
    vector = np.zeros(layout.dimension)
    vector[VELOCITY] = turn @ truth.body.velocity[FIRST]
    vector[POSITION] = position
    vector[layout.feet] = (position + reading.feet.position_body @ rotation.T).ravel()
    if layout.has_contacts:
        vector[layout.at("contacts")] = reading.contact.probability
    for name in layout.poses:
        vector[layout.position_of(name)] = position - 0.1
    sigmas = random.uniform(0.01, 0.05, layout.dimension)
    sigmas[LEG_SCALE] = 0.02
    sigmas[LEG_COMPLIANCE] = 0.002
    return State(layout, rotation, vector, so3.exp(random.normal(size=(len(layout.poses), 3)))), sigmas


def slipping(reading: Reading) -> Reading:
    """One foot moves as no foot in stance does."""
    velocity = reading.feet.velocity_body.copy()
    velocity[int(np.flatnonzero(reading.is_stance)[0])] += (0.5, -0.5, 0.0)
    return replace(reading, feet=replace(reading.feet, velocity_body=velocity))


def compare(
    make: Callable[[Counter[str], bool], RobustProfile | PaperProfile],
    readings: list[Reading],
    trial: AnalyticTrial,
    *,
    is_wide: bool,
    tolerance: float,
) -> Counter[str]:
    counts: tuple[Counter[str], Counter[str]] = (Counter(), Counter())
    profiles = [make(counts[0], IS_COMPILED), make(counts[1], False)]
    mean, sigmas = start(profiles[0], readings[FIRST], trial)
    ours, dense = SquareRootFilter(mean, sigmas, is_wide=is_wide), DenseFilter(mean, sigmas, is_wide=is_wide)
    for profile in profiles:
        profile.start(readings[FIRST])
    for reading in readings[FIRST + 1 : FIRST + 1 + STEPS]:
        for profile, core in zip(profiles, (ours, dense), strict=True):
            profile.step(core, reading, DT_S, GYROSCOPE_NOISE, is_gap=False)  # type: ignore[arg-type]
        deviation = np.sqrt(np.diag(dense.covariance))
        stack = replace(dense.mean, rotation=dense.mean.rotation[None], vector=dense.mean.vector[None])
        apart = ours.mean.errors_of(stack)[0] / deviation
        np.testing.assert_allclose(apart, 0.0, rtol=0, atol=tolerance)
        np.testing.assert_allclose(dense.mean.remembered, ours.mean.remembered, rtol=0, atol=tolerance)
        covariance = ours.factor @ ours.factor.T / np.outer(deviation, deviation)
        dense_covariance = dense.covariance / np.outer(deviation, deviation)
        np.testing.assert_allclose(covariance, dense_covariance, rtol=0, atol=tolerance)
        assert np.array_equal(ours.factor, np.tril(ours.factor))
    assert counts[0] == counts[1]
    return counts[0]


@pytest.mark.parametrize(("is_wide", "takes_slip_for_known"), [(False, None), (True, None), (False, True)])
def test_robust_steps_equal_a_dense_ukf(
    is_wide: bool,
    takes_slip_for_known: bool | None,
    daisy: RobotModel,
    noisy_walk: AnalyticTrial,
    readings_of: Callable[[Iterable[Measurement]], list[Reading]],
) -> None:
    readings = readings_of(noisy_walk.measurements)
    readings[FIRST + 20] = slipping(readings[FIRST + 20])
    stances = np.array([reading.is_stance for reading in readings[FIRST : FIRST + STEPS]])
    assert stances.all(axis=1).any(), "some steps use gravity"
    assert (np.diff(stances.astype(int), axis=0) == 1).any(), "feet land"
    assert (np.diff(stances.astype(int), axis=0) == -1).any(), "feet lift off"
    config = RobustConfig(estimates_leg_scale=True, takes_slip_for_known=takes_slip_for_known)
    counts = compare(
        lambda counts, is_compiled: RobustProfile(daisy, config, counts, is_compiled=is_compiled),
        readings,
        noisy_walk,
        is_wide=is_wide,
        tolerance=1e-8,
    )
    assert counts["leg_rejected"] >= 1


def test_paper_steps_equal_a_dense_ukf(
    daisy: RobotModel,
    noisy_walk: AnalyticTrial,
    readings_of: Callable[[Iterable[Measurement]], list[Reading]],
) -> None:
    readings = readings_of(noisy_walk.measurements)
    compare(
        lambda counts, _: PaperProfile(daisy, PaperConfig(), counts), readings, noisy_walk, is_wide=True, tolerance=1e-9
    )

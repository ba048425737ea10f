# SPDX-License-Identifier: BSD-3-Clause
"""Mean and square-root covariance together: predict, update, clone. Knows no robot and no sensor."""

from collections.abc import Callable

import numpy as np

from coclo_vio.arrays import Array
from coclo_vio.filter.square_root import Correction, SigmaSpread, correct, lower_factor
from coclo_vio.filter.state import POSITION, ROTATION, State

MOST_ROTATION_SIGMA_RAD = 0.6
"""Larger uncertainties of a rotation are reported as this; narrow sigma points stand up to sqrt(7) times as far."""


class SquareRootFilter:
    """A square-root unscented Kalman filter on the manifold of ``State``.

    Invariant: ``factor`` is lower triangular and ``factor @ factor.T`` is the covariance of the errors of ``mean``.

    Attributes:
        mean: the mean.
        factor: (L, L).
        is_wide: sigma points sqrt(L) standard deviations away, as in the paper, rather than sqrt(curved).
    """

    def __init__(self, mean: State, sigmas: Array, *, is_wide: bool) -> None:
        self.mean = mean
        self.factor: Array = np.diag(sigmas)
        self.is_wide = is_wide

    def spread(self, curved: int) -> SigmaSpread:
        """The sigma points for a model that bends in the first ``curved`` errors."""
        dimension = len(self.factor)
        return SigmaSpread(dimension, curved, float(dimension if self.is_wide else max(curved, 1)))

    def predict(self, process: Callable[[State], State], noise: Callable[[State], Array], curved: int) -> None:
        """Move the state: ``process`` maps sigma points, ``noise`` gives the rows of Q at the new mean."""
        points = self.spread(curved)
        moved = process(self.mean.spread(points.points(self.factor)))
        self.mean, deviations = moved.mean_and_deviations(points)
        self.factor = lower_factor(np.concatenate((points.rows(deviations), noise(self.mean))))
        self._bound_rotation()

    def _bound_rotation(self) -> None:
        """Keep the rotation sigmas below ``MOST_ROTATION_SIGMA_RAD``, so that no sigma point passes half a turn.

        Yaw is never observed and its uncertainty grows without end, which a rotation cannot follow. Its errors are
        scaled, here and in the clone, with all their correlations: nothing is learned from it.
        """
        for start in (ROTATION.start, self.mean.layout.clone_rotation.start):
            rows = slice(start, start + 3)
            sigmas = np.sqrt(self.variance(rows))
            if sigmas.max() > MOST_ROTATION_SIGMA_RAD:
                self.factor[rows] *= np.minimum(1.0, MOST_ROTATION_SIGMA_RAD / sigmas)[:, None]

    def observe(self, model: Callable[[State], Array], curved: int) -> tuple[Array, Array]:
        """Mean (M,) and square-root rows (L + extra, M) of a predicted measurement."""
        points = self.spread(curved)
        images = model(self.mean.spread(points.points(self.factor)))
        mean = points.mean(images)
        return mean, points.rows(images - mean)

    def update(self, rows: Array, noise_rows: Array, innovation: Array) -> Correction:
        """Take a measurement whose ``observe`` gave ``rows``; ``noise_rows`` ``N`` has ``N^T N = R``."""
        correction = correct(self.factor, rows, noise_rows, innovation)
        self.factor = correction.factor
        self.mean = self.mean.corrected(correction.step)
        return correction

    def variance(self, errors: slice) -> Array:
        """Variances of some errors, (k,)."""
        return np.asarray(np.einsum("ij,ij->i", self.factor[errors], self.factor[errors]))

    def clone(self) -> None:
        """Remember the present pose as the cloned one, with all its correlations; the last clone is forgotten."""
        layout = self.mean.layout
        rows = self.factor.T.copy()
        rows[:, layout.clone_rotation] = rows[:, ROTATION]
        rows[:, layout.clone_position] = rows[:, POSITION]
        self.factor = lower_factor(rows)
        vector = self.mean.vector.copy()
        vector[layout.clone_position] = vector[POSITION]
        self.mean = State(layout, self.mean.rotation, vector, self.mean.rotation)

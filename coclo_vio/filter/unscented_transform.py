# SPDX-License-Identifier: BSD-3-Clause
"""The square-root unscented transform, by QR alone: no downdate, so no step that can fail.

All weights are non-negative (alpha = 1), hence a covariance is always a sum of outer products ``A^T A`` and its
factor the triangle of one QR. Source: van der Merwe and Wan, "The square-root unscented Kalman filter", 2001, with
the two downdates of its equations (21) and (29) replaced by the QR of the stacked deviations.

Two exact savings, neither of which changes a result:

* A pair of sigma points ``m + d``, ``m - d`` is carried as its odd half ``(y+ - y-) / 2`` and its even half
  ``(y+ + y-) / 2``, an orthogonal change of rows under which ``A^T A`` stays the same.
* The factor is lower triangular, so column j moves only the states from j on. Where the model is linear in all of
  those (the *flat* columns), the pair is symmetric whatever its distance: one point is enough, and its even half is
  the centre's. The states in which the model is nonlinear (rotation, leg scale, rate) come first and only their
  columns (the *curved* ones) need both points.

Since the distance of the flat points does not matter, the curved ones alone decide how far from the mean the points
have to lie for the weights to be non-negative: sqrt(7) instead of sqrt(50) standard deviations for six legs.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from coclo_vio.values.arrays import Array


@dataclass(frozen=True, slots=True)
class SigmaSpread:
    """Positions of the sigma points of a state and weights of their images.

    Points are ordered: the centre, ``+`` of the curved columns, ``-`` of the curved columns, ``+`` of the flat ones.
    The point of a column has the weight ``1 / (2 c^2)``, the centre the rest.

    Attributes:
        dimension: L, the length of the error state.
        curved: number of leading columns in which the model is not linear.
        width_squared: c^2, squared distance of the points in standard deviations, at least ``curved``; L gives the
            2 L points of the unscented transform with alpha = 1, kappa = 0.
    """

    dimension: int
    curved: int
    width_squared: float

    def points(self, factor: Array) -> Array:
        """Error-state sigma points, (1 + L + curved, L), of the lower factor ``S`` (L, L), ``P = S S^T``."""
        columns = np.sqrt(self.width_squared) * factor.T
        bent = columns[: self.curved]
        return np.concatenate((np.zeros((1, self.dimension)), bent, -bent, columns[self.curved :]))

    def mean(self, images: Array) -> Array:
        """Weighted mean (M,) of the images (points, M) of the sigma points."""
        centre = images[0]
        bent = images[1 : 1 + 2 * self.curved]
        shift = bent.sum(axis=0) - 2 * self.curved * centre
        mean: Array = centre + shift / (2.0 * self.width_squared)
        return mean

    def rows(self, deviations: Array) -> Array:
        """Rows ``A``, (L + curved + 1, M), with ``A^T A`` the covariance of the images.

        Args:
            deviations: images less their mean, (points, M).
        """
        curved = self.curved
        centre = deviations[0]
        plus, minus = deviations[1 : 1 + curved], deviations[1 + curved : 1 + 2 * curved]
        flat = deviations[1 + 2 * curved :] - centre
        stacked = np.concatenate((0.5 * (plus - minus), flat, 0.5 * (plus + minus), centre[None]))
        stacked[:-1] *= 1.0 / np.sqrt(self.width_squared)
        stacked[-1] *= np.sqrt(1.0 - curved / self.width_squared)
        return stacked


def lower_factor(rows: Array) -> Array:
    """Lower triangle ``S`` (L, L) with ``S S^T = A^T A`` of rows ``A`` (m, L), m >= L."""
    columns = rows.shape[1]
    triangle, _, _, _ = lapack.dgeqrf(rows, lwork=32 * columns)
    return np.ascontiguousarray(np.triu(triangle[:columns]).T)


@dataclass(frozen=True, slots=True)
class Correction:
    """The result of an update.

    Attributes:
        step: the error-state correction, (L,).
        factor: the new lower factor, (L, L).
        triangle: ``[S_y^T, (gain S_y)^T]`` of the optimal gain, (M, M + L).
        whitened: the innovation in units of its factor, ``S_y^-1`` times it, (M,).
    """

    step: Array
    factor: Array
    triangle: Array
    whitened: Array

    @property
    def innovation_squared(self) -> float:
        """Normalised innovation squared, chi-square with M degrees of freedom."""
        return float(self.whitened @ self.whitened)


def change_of_gain(covariance: Array, gains: Array, considered: slice) -> tuple[Array, Array]:
    """From the optimal gain to the one of a filter that takes some errors for known, and for exactly what it expects.

    With ``u`` the considered errors, ``P_uu = C C^T``, ``B = K S_y`` the optimal gain in units of the innovation,
    ``W = C^-1 B_u`` and ``E = P_xu C^-T``, the gain by the covariance given ``u`` is
    ``K' S_y = (B - E W) (I - W^T W)^-1``, and ``K' S_y - B = F W`` with ``F = (B - E W) W^T (I - W W^T)^-1 - E``: of
    the rank of ``u``. Errors ``u`` themselves have the gain zero.

    Args:
        covariance: of all errors with the considered ones, before the update, (n, k).
        gains: ``B^T``, (M, n).
        considered: which errors.

    Returns:
        ``F``, (n, k), and ``W``, (k, M).
    """
    root = np.linalg.cholesky(covariance[considered])
    units, _ = lapack.dtrtrs(root, covariance.T, lower=1)
    shares, _ = lapack.dtrtrs(root, gains[:, considered].T, lower=1)
    squared = shares @ shares.T
    toward = shares @ gains - squared @ units
    change = np.linalg.solve(np.eye(len(root)) - squared, toward) - units
    return np.ascontiguousarray(change.T), shares


def correct(
    factor: Array, observed_rows: Array, noise_rows: Array, innovation: Array, considered: slice = slice(0, 0)
) -> Correction:
    """Measurement update: one QR yields the innovation factor, the gain and the new factor together.

    The triangle of ``[[A_y, A_x], [R^(1/2), 0]]`` is ``[[S_y^T, (gain S_y)^T], [0, S_new^T]]``. Errors that are only
    considered (Schmidt, 1966) take no step, and the information of the step on them is taken back: with a gain that
    is changed by ``D``, the covariance is larger by ``D S_y S_y^T D^T``.

    Args:
        factor: lower factor of the prior, (L, L); its transpose is ``A_x``, padded with zeros.
        observed_rows: ``SigmaSpread.rows`` of the predicted measurements, (L + extra, M).
        noise_rows: ``N`` with ``N^T N = R``, (M, M).
        innovation: measured less predicted, (M,).
        considered: errors whose mean is not corrected.
    """
    length, width = len(factor), len(innovation)
    observed = len(observed_rows)
    stacked = np.zeros((observed + len(noise_rows), width + length), order="F")
    stacked[:observed, :width] = observed_rows
    stacked[:length, width:] = factor.T
    stacked[observed:, :width] = noise_rows
    triangle, _, _, _ = lapack.dgeqrf(stacked, lwork=32 * (width + length), overwrite_a=1)
    whitened, _ = lapack.dtrtrs(triangle[:width, :width], innovation, lower=0, trans=1)
    step = triangle[:width, width:].T @ whitened
    new_factor = np.ascontiguousarray(np.triu(triangle[width : width + length, width:]).T)
    if considered.stop > considered.start:
        few = considered.stop - considered.start
        gained = lower_factor(np.concatenate((triangle[:width, width:][:, considered], np.zeros((few, few)))))
        forgone = np.zeros((few, length))
        forgone[:, considered] = gained.T
        new_factor, step[considered] = lower_factor(np.concatenate((new_factor.T, forgone))), 0.0
    return Correction(step, new_factor, triangle[:width], whitened)

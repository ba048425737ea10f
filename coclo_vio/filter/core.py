# SPDX-License-Identifier: BSD-3-Clause
"""Mean and square-root covariance together: predict, update, clone. Knows no robot and no sensor."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from coclo_vio.filter.square_root import Correction, SigmaSpread, correct, lower_factor
from coclo_vio.filter.state import POSITION, RATE, ROTATION, VELOCITY, State
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array

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
        scaled, here and in the clones, with all their correlations: nothing is learned from it.
        """
        layout = self.mean.layout
        for rows in (ROTATION, layout.clone_rotation, layout.frame_rotation, layout.anchor_rotation):
            if rows.stop == rows.start:
                continue
            sigmas = np.sqrt(self.variance(rows))
            if sigmas.max() > MOST_ROTATION_SIGMA_RAD:
                self.factor[rows] *= np.minimum(1.0, MOST_ROTATION_SIGMA_RAD / sigmas)[:, None]

    def observe(self, model: Callable[[State], Array], curved: int) -> tuple[Array, Array]:
        """Mean (M,) and square-root rows (L + extra, M) of a predicted measurement."""
        points = self.spread(curved)
        images = model(self.mean.spread(points.points(self.factor)))
        mean = points.mean(images)
        return mean, points.rows(images - mean)

    def update(self, rows: Array, noise_rows: Array, innovation: Array, considered: slice = slice(0, 0)) -> Correction:
        """Take a measurement whose ``observe`` gave ``rows``; ``noise_rows`` ``N`` has ``N^T N = R``.

        Errors that are only considered (Schmidt, 1966) count in the uncertainty, but their mean learns nothing.
        """
        correction = correct(self.factor, rows, noise_rows, innovation, considered)
        self.apply(correction)
        return correction

    def apply(self, correction: Correction) -> None:
        """Move to where a correction leads."""
        self.factor = correction.factor
        self.mean = self.mean.corrected(correction.step)

    def variance(self, errors: slice) -> Array:
        """Variances of some errors, (k,)."""
        return np.asarray(np.einsum("ij,ij->i", self.factor[errors], self.factor[errors]))

    def widen_places(self, times: float) -> None:
        """Multiply the sigmas of rotation and of all places but the anchor's, with all their correlations."""
        layout = self.mean.layout
        for rows in (ROTATION, POSITION, layout.feet, layout.clone_rotation, layout.clone_position):
            self.factor[rows] *= times
        self.factor[layout.frame_rotation.start : layout.frame_position.stop] *= times

    def clone(self) -> None:
        """Remember the present pose as the cloned one, with all its correlations; the last clone is forgotten."""
        layout = self.mean.layout
        vector = self.mean.vector.copy()
        vector[layout.clone_position] = vector[POSITION]
        self._copy([(layout.clone_rotation, ROTATION), (layout.clone_position, POSITION)])
        self.mean = replace(self.mean, vector=vector, clone_rotation=self.mean.rotation)

    def mark_frame(self, dt_s: float, noise: tuple[float, float] = (0.0, 0.0)) -> None:
        """Remember the pose ``dt_s`` from now as the frame's, with all its correlations; the last one is forgotten.

        The body is taken to go on as it does: ``R exp(w dt)``, ``r + v dt``. The errors of rate and velocity go along.

        Args:
            dt_s: from the present to the frame, s.
            noise: one sigma of what the body turns (rad) and moves (m) otherwise, each axis.
        """
        mean, layout = self.mean, self.mean.layout
        vector = mean.vector.copy()
        vector[layout.frame_position] = vector[POSITION] + vector[VELOCITY] * dt_s
        turning = mean.rotation * dt_s
        moving = so3.hat(vector[layout.frame_position]) @ turning  # a rotation error turns the place too
        along = np.zeros((len(vector), 6))
        along[RATE] = np.concatenate((turning, moving)).T
        along[VELOCITY, 3:] = np.eye(3) * dt_s
        self._copy([(layout.frame_rotation, ROTATION), (layout.frame_position, POSITION)], along)
        self.mean = replace(mean, vector=vector, frame_rotation=mean.rotation @ so3.exp(vector[RATE] * dt_s))
        self._widen_frame(*noise)

    def _widen_frame(self, turn_rad: float, way_m: float) -> None:
        """Independent noise on the frame's pose; what turns it leaves its place where it is."""
        if turn_rad == 0.0 and way_m == 0.0:
            return
        layout = self.mean.layout
        rows = np.zeros((6, len(self.factor)))
        rows[:3, layout.frame_rotation] = turn_rad * np.eye(3)
        rows[:3, layout.frame_position] = turn_rad * so3.hat(self.mean.vector[layout.frame_position]).T
        rows[3:, layout.frame_position] = way_m * np.eye(3)
        self.factor = lower_factor(np.concatenate((self.factor.T, rows)))

    def keep_frame(self) -> None:
        """The frame's pose becomes the cloned one."""
        layout = self.mean.layout
        vector = self.mean.vector.copy()
        vector[layout.clone_position] = vector[layout.frame_position]
        self._copy([(layout.clone_rotation, layout.frame_rotation), (layout.clone_position, layout.frame_position)])
        self.mean = replace(self.mean, vector=vector, clone_rotation=self.mean.frame_rotation)

    def anchor(self) -> None:
        """The frame's pose becomes the anchor."""
        layout = self.mean.layout
        vector = self.mean.vector.copy()
        vector[layout.anchor_position] = vector[layout.frame_position]
        self._copy([(layout.anchor_rotation, layout.frame_rotation), (layout.anchor_position, layout.frame_position)])
        self.mean = replace(self.mean, vector=vector, anchor_rotation=self.mean.frame_rotation)

    def _copy(self, places: Sequence[tuple[slice, slice]], along: Array | None = None) -> None:
        """Errors at the first places become those at the second ones, plus ``along.T`` (6, L) times all errors."""
        rows = self.factor.T.copy()
        added = np.zeros((len(rows), 6)) if along is None else self.factor.T @ along
        for part, (to, of) in enumerate(places):
            rows[:, to] = self.factor.T[:, of] + added[:, 3 * part : 3 * part + 3]
        self.factor = lower_factor(rows)

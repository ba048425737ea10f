# SPDX-License-Identifier: BSD-3-Clause
"""Mean and square-root covariance together: predict, update, remember poses. Independent of robot and sensors."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from coclo_vio.filter.state import POSITION, RATE, ROTATION, VELOCITY, State
from coclo_vio.filter.unscented_transform import Correction, SigmaSpread, correct, lower_factor
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array

MAX_ROTATION_SIGMA_RAD = 0.6
"""Upper limit of the sigma of a rotation; sigma points lie up to sqrt(7) times as far from the mean."""


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
        """The sigma points for a model that is nonlinear in the first ``curved`` errors."""
        dimension = len(self.factor)
        return SigmaSpread(dimension, curved, float(dimension if self.is_wide else max(curved, 1)))

    def predict(self, process: Callable[[State], State], noise: Callable[[State], Array], curved: int) -> None:
        """Predict: ``process`` maps sigma points, ``noise`` returns the rows of Q at the new mean."""
        points = self.spread(curved)
        moved = process(self.mean.spread(points.points(self.factor)))
        self.mean, deviations = moved.mean_and_deviations(points)
        self.factor = lower_factor(np.concatenate((points.rows(deviations), noise(self.mean))))
        self._bound_rotation()

    def _bound_rotation(self) -> None:
        """Keep the rotation sigmas below ``MAX_ROTATION_SIGMA_RAD``, so that no sigma point passes half a turn.

        Yaw is not observable and its uncertainty grows without bound, which a rotation cannot represent. Its errors are
        scaled, here and in the remembered poses, with all their correlations: the mean does not change.
        """
        layout = self.mean.layout
        for rows in (ROTATION, layout.keyframe_rotation, layout.frame_rotation, layout.anchor_rotation):
            if rows.stop == rows.start:
                continue
            sigmas = np.sqrt(self.variance(rows))
            if sigmas.max() > MAX_ROTATION_SIGMA_RAD:
                self.factor[rows] *= np.minimum(1.0, MAX_ROTATION_SIGMA_RAD / sigmas)[:, None]

    def observe(self, model: Callable[[State], Array], curved: int) -> tuple[Array, Array]:
        """Mean (M,) and square-root rows (L + extra, M) of a predicted measurement."""
        points = self.spread(curved)
        images = model(self.mean.spread(points.points(self.factor)))
        mean = points.mean(images)
        return mean, points.rows(images - mean)

    def update(self, rows: Array, noise_rows: Array, innovation: Array, considered: slice = slice(0, 0)) -> Correction:
        """Update by a measurement with the ``rows`` of ``observe``; ``noise_rows`` ``N`` has ``N^T N = R``.

        Errors that are only considered (Schmidt, 1966) count in the uncertainty, but their mean is not corrected.
        """
        correction = correct(self.factor, rows, noise_rows, innovation, considered)
        self.apply(correction)
        return correction

    def apply(self, correction: Correction) -> None:
        """Apply a correction to mean and factor."""
        self.factor = correction.factor
        self.mean = self.mean.corrected(correction.step)

    def variance(self, errors: slice) -> Array:
        """Variances of some errors, (k,)."""
        return np.asarray(np.einsum("ij,ij->i", self.factor[errors], self.factor[errors]))

    def inflate_poses(self, inflation: float) -> None:
        """Multiply the sigmas of rotation and of all positions but the anchor's, with all their correlations."""
        layout = self.mean.layout
        for rows in (ROTATION, POSITION, layout.feet, layout.keyframe_rotation, layout.keyframe_position):
            self.factor[rows] *= inflation
        self.factor[layout.frame_rotation.start : layout.frame_position.stop] *= inflation

    def mark_frame(self, dt_s: float, noise: tuple[float, float] = (0.0, 0.0)) -> None:
        """Remember the pose ``dt_s`` from now as the frame's, with all its correlations; it replaces the last one.

        Rate and velocity are constant until then: ``R exp(w dt)``, ``r + v dt``; their errors are propagated.

        Args:
            dt_s: from the present to the frame, s.
            noise: one sigma of the rotation (rad) and motion (m) beyond that, each axis.
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
        self._add_frame_noise(*noise)

    def _add_frame_noise(self, rotation_rad: float, motion_m: float) -> None:
        """Independent noise on the frame's pose; noise of the rotation leaves the position as it is."""
        if rotation_rad == 0.0 and motion_m == 0.0:
            return
        layout = self.mean.layout
        rows = np.zeros((6, len(self.factor)))
        rows[:3, layout.frame_rotation] = rotation_rad * np.eye(3)
        rows[:3, layout.frame_position] = rotation_rad * so3.hat(self.mean.vector[layout.frame_position]).T
        rows[3:, layout.frame_position] = motion_m * np.eye(3)
        self.factor = lower_factor(np.concatenate((self.factor.T, rows)))

    def keep_frame(self) -> None:
        """The frame's pose becomes the keyframe's."""
        layout = self.mean.layout
        vector = self.mean.vector.copy()
        vector[layout.keyframe_position] = vector[layout.frame_position]
        self._copy(
            [(layout.keyframe_rotation, layout.frame_rotation), (layout.keyframe_position, layout.frame_position)]
        )
        self.mean = replace(self.mean, vector=vector, keyframe_rotation=self.mean.frame_rotation)

    def anchor_frame(self) -> None:
        """The frame's pose becomes the anchor."""
        layout = self.mean.layout
        vector = self.mean.vector.copy()
        vector[layout.anchor_position] = vector[layout.frame_position]
        self._copy([(layout.anchor_rotation, layout.frame_rotation), (layout.anchor_position, layout.frame_position)])
        self.mean = replace(self.mean, vector=vector, anchor_rotation=self.mean.frame_rotation)

    def _copy(self, places: Sequence[tuple[slice, slice]], along: Array | None = None) -> None:
        """Errors at the first slices become those at the second, plus ``along.T`` (6, L) times all errors."""
        rows = self.factor.T.copy()
        added = np.zeros((len(rows), 6)) if along is None else self.factor.T @ along
        for part, (to, of) in enumerate(places):
            rows[:, to] = self.factor.T[:, of] + added[:, 3 * part : 3 * part + 3]
        self.factor = lower_factor(rows)

# SPDX-License-Identifier: BSD-3-Clause
"""Mean and square-root covariance together: predict, update, remember poses. Independent of robot and sensors."""

from collections.abc import Callable

import numpy as np

from coclo_vio.filter.passive_states import PassiveStates
from coclo_vio.filter.state import POSITION, RATE, ROTATION, VELOCITY, State
from coclo_vio.filter.state_blocks import ANCHOR, FRAME
from coclo_vio.filter.unscented_transform import Correction, SigmaSpread, change_of_gain, correct, lower_factor
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array

MAX_ROTATION_SIGMA_RAD = 0.6
"""Upper limit of the sigma of a rotation; sigma points lie up to sqrt(7) times as far from the mean."""


class SquareRootFilter:
    """A square-root unscented Kalman filter on the manifold of ``State``.

    Invariant: ``factor`` is lower triangular and ``factor @ factor.T`` is the covariance of the errors of ``mean``.
    Prediction and update run on the active errors, and the passive ones follow (``PassiveStates``).

    Attributes:
        mean: the mean.
        active_factor: lower factor of the active errors, (a, a).
        passive: covariance of the passive errors.
        is_wide: sigma points sqrt(L) standard deviations away, as in the paper, rather than sqrt(curved).
    """

    def __init__(self, mean: State, sigmas: Array, *, is_wide: bool) -> None:
        active = mean.layout.active
        self.mean = mean
        self.active_factor: Array = np.diag(sigmas[:active])
        self.passive = PassiveStates(np.zeros((active, len(sigmas) - active)), np.diag(sigmas[active:] ** 2))
        self.is_wide = is_wide
        self._joint: Array | None = None  # factor of all errors, where it is known
        self._is_fresh = True  # passive errors were replaced since the last prediction

    @property
    def factor(self) -> Array:
        """Lower factor of all errors, (L, L), read only where there are passive ones; a change is assigned."""
        if not len(self.passive):
            return self.active_factor
        if self._joint is None:
            self._joint = self.passive.joint_factor(self.active_factor)
            self._joint.flags.writeable = False
        return self._joint

    @factor.setter
    def factor(self, factor: Array) -> None:
        """Replace it; the array is taken over, and read only from then on where there are passive errors."""
        active = self.mean.layout.active
        self.active_factor = np.ascontiguousarray(factor[:active, :active])
        self.passive = PassiveStates.of_factor(factor, active)
        self._joint, self._is_fresh = factor if len(self.passive) else None, True
        factor.flags.writeable = not len(self.passive)

    def spread(self, curved: int) -> SigmaSpread:
        """The sigma points for a model that is nonlinear in the first ``curved`` errors."""
        width_squared = self.mean.layout.dimension if self.is_wide else max(curved, 1)
        return SigmaSpread(len(self.active_factor), curved, float(width_squared))

    def predict(self, process: Callable[[State], State], noise: Callable[[State], Array]) -> None:
        """Predict: ``process`` maps sigma points, ``noise`` returns the rows of Q at the new mean."""
        active = len(self.active_factor)
        points = self.spread(self.mean.layout.curved_in_process)
        moved = process(self.mean.spread(points.points(self.active_factor)))
        self.mean, deviations = moved.mean_and_deviations(points)
        rows = points.rows(deviations[:, :active])
        self.passive.predict(self.active_factor, rows[:active])
        self.replace_active(lower_factor(np.concatenate((rows, noise(self.mean)[:, :active]))))
        self._bound_rotation()

    def replace_active(self, factor: Array) -> None:
        """Replace the factor of the active errors, after the passive ones have followed the same step."""
        self.active_factor, self._joint = factor, None

    def _bound_rotation(self) -> None:
        """Keep the rotation sigmas below ``MAX_ROTATION_SIGMA_RAD``, so that no sigma point passes half a turn.

        Yaw is not observable and its uncertainty grows without bound, which a rotation cannot represent. Its errors are
        scaled, here and in the remembered poses, with all their correlations: the mean does not change.
        """
        scales = _bounding_scales(self.variance(ROTATION))
        self.active_factor[ROTATION] *= scales[:, None]
        self.follow_bound(scales)

    def follow_bound(self, scales: Array) -> None:
        """Scale the passive errors where the rotation's have been scaled (3,), and where their own are too large."""
        if not len(self.passive):
            return
        self._joint = None
        if scales.min() < 1.0:
            self.passive.scale_active(ROTATION, scales)
        if self._is_fresh:
            for at in self.mean.layout.rotations[1:]:
                errors = slice(at.start - len(self.active_factor), at.stop - len(self.active_factor))
                self.passive.scale(errors, _bounding_scales(self.variance(at)))
            self._is_fresh = False

    def observe(self, model: Callable[[State], Array]) -> tuple[Array, Array]:
        """Mean (M,) and square-root rows (L + extra, M) of a predicted measurement."""
        points = self.spread(self.mean.layout.curved_in_measurement)
        images = model(self.mean.spread(points.points(self.active_factor)))
        mean = points.mean(images)
        return mean, points.rows(images - mean)

    def update(
        self,
        rows: Array,
        noise_rows: Array,
        innovation: Array,
        considered: slice = slice(0, 0),
        *,
        is_conditional: bool = False,
    ) -> Correction:
        """Update by a measurement with the ``rows`` of ``observe``; ``noise_rows`` ``N`` has ``N^T N = R``.

        Errors that are only considered (Schmidt, 1966) count in the uncertainty, but their mean is not corrected. If it
        is conditional, the others are corrected as if the considered ones were known: ``change_of_gain``.
        """
        observed = self.passive.observed(self.active_factor, rows[: len(self.active_factor)])
        if is_conditional:
            return self._update_conditionally(rows, noise_rows, innovation, considered, observed)
        correction = correct(self.active_factor, rows, noise_rows, innovation, considered)
        step = self.passive.correct(observed, correction.triangle, correction.whitened)
        self.replace_active(correction.factor)
        self.mean = self.mean.corrected(np.concatenate((correction.step, step)))
        return correction

    def _update_conditionally(
        self, rows: Array, noise_rows: Array, innovation: Array, considered: slice, observed: Array
    ) -> Correction:
        factor, active = self.active_factor, len(self.active_factor)
        covariance = np.concatenate((factor @ factor[considered].T, self.passive.cross[considered].T))
        correction = correct(factor, rows, noise_rows, innovation)
        own_gains = self.passive.gains(observed, correction.triangle, len(innovation))
        gains = np.concatenate((correction.triangle[:, len(innovation) :], own_gains), axis=1)
        step = np.concatenate(
            (correction.step, self.passive.correct(observed, correction.triangle, correction.whitened))
        )
        change, shares = change_of_gain(covariance, gains, considered)
        self.passive.change_gain(change[:active], change[active:], shares)
        added = np.linalg.qr(shares.T, mode="r") @ change[:active].T
        self.replace_active(lower_factor(np.concatenate((correction.factor.T, added))))
        step += change @ (shares @ correction.whitened)
        step[considered] = 0.0
        self.mean = self.mean.corrected(step)
        return correction

    def apply(self, correction: Correction) -> None:
        """Apply a correction of all errors to mean and factor."""
        self.factor = correction.factor
        self.mean = self.mean.corrected(correction.step)

    def variance(self, errors: slice) -> Array:
        """Variances of some errors, (k,), active or passive."""
        active = len(self.active_factor)
        if errors.start >= active:
            return self.passive.own.diagonal()[errors.start - active : errors.stop - active].copy()
        return np.asarray(np.einsum("ij,ij->i", self.active_factor[errors], self.active_factor[errors]))

    def mean_variance(self, errors: slice) -> float:
        """Mean of the variances of some active errors."""
        rows = self.active_factor[errors]
        return float(np.vdot(rows, rows)) / len(rows)

    def add_noise(self, name: str, sigma: float) -> None:
        """Add independent noise to each error of a block, of this sigma in its unit."""
        at, active = self.mean.layout.at(name), len(self.active_factor)
        if at.start >= active:
            errors = np.arange(at.start - active, at.stop - active)
            own = self.passive.own.copy()
            own[errors, errors] += sigma**2
            self.passive, self._joint = PassiveStates(self.passive.cross, own), None
            return
        rows = np.zeros((at.stop - at.start, active))
        rows[:, at] = sigma * np.eye(len(rows))
        self.replace_active(lower_factor(np.concatenate((self.active_factor.T, rows))))

    def report(self, name: str) -> tuple[Array, Array]:
        """Value and one sigma of each error of a plain block of the state, (k,) each."""
        at = self.mean.layout.at(name)
        return self.mean.vector[at], np.sqrt(self.variance(at))

    def inflate_poses(self, inflation: float) -> None:
        """Multiply the sigmas of rotation and of all positions but the anchor's, with all their correlations."""
        layout = self.mean.layout
        remembered = [layout.at(name) for name in layout.poses if name != ANCHOR]
        factor = self.factor.copy()
        for rows in (ROTATION, POSITION, layout.feet, *remembered):
            factor[rows] *= inflation
        self.factor = factor

    def mark_frame(
        self,
        dt_s: float,
        noise: tuple[float, float] = (0.0, 0.0),
        T_now_frame: Array | None = None,
        name: str = FRAME,
    ) -> None:
        """Remember the pose ``dt_s`` from now as the frame's, with all its correlations; it replaces the last one.

        Rate and velocity are constant until then: ``R exp(w dt)``, ``r + v dt``; their errors are propagated.

        Args:
            dt_s: from the present to the frame, s.
            noise: one sigma of the rotation (rad) and motion (m) beyond that, each axis.
            T_now_frame: the motion to the frame where it is known, (4, 4), with ``dt_s`` of 0.
            name: of the remembered pose.
        """
        mean, layout = self.mean, self.mean.layout
        rotation = mean.rotation @ so3.exp(mean.vector[RATE] * dt_s)
        position = mean.vector[POSITION] + mean.vector[VELOCITY] * dt_s
        if T_now_frame is not None:
            rotation = mean.rotation @ T_now_frame[:3, :3]
            position = mean.vector[POSITION] + mean.rotation @ T_now_frame[:3, 3]
        turning = mean.rotation * dt_s
        along = np.zeros((6, layout.dimension))
        along[:3, RATE] = turning
        along[3:, RATE] = so3.hat(position) @ turning  # a rotation error turns the place too
        along[3:, VELOCITY] = np.eye(3) * dt_s
        along[:3, ROTATION] = along[3:, POSITION] = np.eye(3)
        self._replace(name, along)
        self.mean = mean.remembering(name, rotation, position)
        self._add_frame_noise(name, *noise)

    def _add_frame_noise(self, name: str, rotation_rad: float, motion_m: float) -> None:
        """Independent noise on the frame's pose; noise of the rotation leaves the position as it is."""
        if rotation_rad == 0.0 and motion_m == 0.0:
            return
        rotation, position = self.mean.layout.rotation_of(name), self.mean.layout.position_of(name)
        rows = np.zeros((6, len(self.factor)))
        rows[:3, rotation] = rotation_rad * np.eye(3)
        rows[:3, position] = rotation_rad * so3.hat(self.mean.vector[position]).T
        rows[3:, position] = motion_m * np.eye(3)
        self.factor = lower_factor(np.concatenate((self.factor.T, rows)))

    def copy_pose(self, of: str, to: str) -> None:
        """One remembered pose becomes another, by name, with all its correlations."""
        layout = self.mean.layout
        along = np.zeros((6, layout.dimension))
        along[:, layout.at(of)] = np.eye(6)
        self._replace(to, along)
        position = self.mean.vector[layout.position_of(of)]
        self.mean = self.mean.remembering(to, self.mean.remembered_rotation(of), position)

    def _replace(self, name: str, along: Array) -> None:
        """The errors of a block (k,) become ``along`` (k, L) times all errors."""
        rows = self.factor.T.copy()
        rows[:, self.mean.layout.at(name)] = self.factor.T @ along.T
        self.factor = lower_factor(rows)


def _bounding_scales(variances: Array) -> Array:
    """Factors (k,) that bring sigmas of these variances down to ``MAX_ROTATION_SIGMA_RAD``, 1 where they are below."""
    return np.minimum(1.0, MAX_ROTATION_SIGMA_RAD / np.sqrt(np.maximum(variances, 1e-30)))

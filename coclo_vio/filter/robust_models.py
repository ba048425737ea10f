# SPDX-License-Identifier: BSD-3-Clause
"""The models of the ``robust`` profile in NumPy: the readable form of a step, and the oracle of the compiled one."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from coclo_vio.filter import measurement_model, process_model
from coclo_vio.filter.foot_weights import StanceNoise, unweighed
from coclo_vio.filter.measurement_model import NO_LEG, LegConstants
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.stance import FootMotion, Reading
from coclo_vio.filter.state import CONSIDERED_BY_LEGS, State
from coclo_vio.values.arrays import Array, BoolArray, IntArray


class Expectation(Protocol):
    """The measurements of one joint sample against what the filter expects of them."""

    @property
    def rejected(self) -> BoolArray:
        """Legs whose innovation is larger than its covariance allows (chi-square gate), (n,)."""

    @property
    def innovation_squared(self) -> float:
        """Normalised innovation squared of all rows."""

    @property
    def degrees_of_freedom(self) -> int:
        """Of ``innovation_squared``: the number of rows."""

    @property
    def mean_excess(self) -> float:
        """Mean over the rows of the squared innovation less the variance of what the filter expects."""

    def update(self, core: SquareRootFilter, rejected: BoolArray) -> None:
        """Update the filter by all rows but those of the rejected legs (n,)."""


class RobustModels(Protocol):
    """Prediction and measurements of one joint sample.

    Attributes:
        imu_delay_s: of the gyroscope behind the joints, s: the state's rate is late by it, its rotation is not.
        acceleration_density: of the body's white acceleration in the next prediction, m/s^2/sqrt(Hz).
        stance_noise: of the feet in stance in the next prediction and measurement.
    """

    imu_delay_s: float
    acceleration_density: float
    stance_noise: StanceNoise

    def foot_noise(self, reading: Reading) -> Array:
        """Lower factors (n, 3, 3) of the covariance of each foot position, body frame, m; of an unknown leg any."""

    def predict(self, core: SquareRootFilter, motion: FootMotion, dt_s: float, foot_noise: Array) -> None:
        """Predict to the next sample."""

    def expect(
        self,
        core: SquareRootFilter,
        reading: Reading,
        motion: FootMotion,
        *,
        foot_noise: Array,
        gyroscope_noise_radps: float,
    ) -> Expectation | None:
        """The measurements of a joint sample; None where there are none. Arguments as in ``measurement_model``."""

    def expect_gravity(self, core: SquareRootFilter, force_body: Array, sigma: float) -> Expectation:
        """Gravity as measured, body frame, m/s^2, (3,), with one sigma of each axis."""


class DirectModels:
    """The models by NumPy, over stacks of sigma points.

    Args:
        sensing: the legs and the parameters.
        encoder_noise_rad: one sigma of a joint position.
        gate: limits of the normalised innovation squared of 3 and of 6 rows.
    """

    def __init__(self, sensing: LegConstants, encoder_noise_rad: float, gate: dict[int, float]) -> None:
        self._sensing, self._encoder_noise_rad, self._gate = sensing, encoder_noise_rad, gate
        self.imu_delay_s, self.acceleration_density = 0.0, sensing.config.acceleration_density
        self.stance_noise = unweighed(len(sensing.radii_m), sensing.config)

    def foot_noise(self, reading: Reading) -> Array:
        """Encoders through the Jacobian, and bending."""
        linear = np.where(reading.is_known[:, None, None], reading.feet.jacobian[:, 3:], 0.0)
        encoders = linear @ np.swapaxes(linear, 1, 2) * self._encoder_noise_rad**2
        bending = self._sensing.config.foot_position_noise_m**2 * np.eye(3)
        return np.asarray(np.linalg.cholesky(encoders + bending))

    def predict(self, core: SquareRootFilter, motion: FootMotion, dt_s: float, foot_noise: Array) -> None:
        """By ``process_model``."""
        sensing = self._sensing
        interval = process_model.Interval(dt_s, self.imu_delay_s, self.acceleration_density, self.stance_noise.creep)
        core.predict(
            lambda stack: process_model.predict(stack, dt_s, motion, sensing.radii_m, sensing.hips_body),
            lambda mean: process_model.noise_rows(
                mean,
                interval,
                motion,
                radii_m=sensing.radii_m,
                foot_noise=foot_noise,
                angular_acceleration=sensing.config.angular_acceleration_density,
            ),
        )

    def expect(
        self,
        core: SquareRootFilter,
        reading: Reading,
        motion: FootMotion,
        *,
        foot_noise: Array,
        gyroscope_noise_radps: float,
    ) -> "DirectExpectation | None":
        """By ``measurement_model``."""
        blocks = measurement_model.blocks(
            self._sensing,
            reading,
            motion,
            core.mean,
            foot_noise=foot_noise,
            foot_velocity_noise_mps=self.stance_noise.velocity,
            gyroscope_noise_radps=gyroscope_noise_radps,
        )
        if not blocks:
            return None

        def model(stack: State) -> Array:
            return np.concatenate([block.model(stack) for block in blocks], axis=1)

        predicted, rows = core.observe(model)
        innovation = np.concatenate([block.measured for block in blocks]) - predicted
        noise = noise_rows_of(np.concatenate([block.noise for block in blocks]))
        owner = np.repeat(np.concatenate([block.legs for block in blocks]), 3)
        rejected = self._rejected(rows.T @ rows + noise.T @ noise, innovation, owner)
        is_conditional = self._sensing.takes_slip_for_known
        return DirectExpectation(rows, noise, innovation, owner, rejected, CONSIDERED_BY_LEGS, is_conditional)

    def expect_gravity(self, core: SquareRootFilter, force_body: Array, sigma: float) -> "DirectExpectation":
        """By ``measurement_model``."""
        predicted, rows = core.observe(measurement_model.specific_force_at_rest)
        legs = len(self._sensing.radii_m)
        owner, rejected = np.full(3, NO_LEG), np.zeros(legs, dtype=np.bool_)
        return DirectExpectation(rows, sigma * np.eye(3), force_body - predicted, owner, rejected, slice(0, 0))

    def _rejected(self, covariance: Array, innovation: Array, owner: IntArray) -> BoolArray:
        legs = len(self._sensing.radii_m)
        rejected = np.zeros(legs, dtype=np.bool_)
        counts = np.bincount(owner[owner > NO_LEG], minlength=legs)
        order = np.argsort(owner, kind="stable")[np.count_nonzero(owner == NO_LEG) :]
        ends = np.cumsum(counts)
        for size, limit in self._gate.items():
            of_size = np.flatnonzero(counts == size)
            if len(of_size):
                own = order[ends[of_size, None] - size + np.arange(size)]
                own_innovation = innovation[own][:, :, None]
                solved = np.linalg.solve(covariance[own[:, :, None], own[:, None, :]], own_innovation)
                rejected[of_size] = (own_innovation * solved).sum(axis=(1, 2)) > limit
        return rejected


@dataclass(frozen=True, slots=True, eq=False)
class DirectExpectation:
    """``Expectation`` of ``DirectModels``.

    Attributes:
        rows: square-root rows of the predicted measurement, (L + extra, M).
        noise: rows ``N`` with ``N^T N = R``, (M, M).
        innovation: measured less predicted, (M,).
        owner: the leg of each row, (M,); ``NO_LEG`` where none.
        rejected: as in ``Expectation``.
        considered: errors whose mean is not corrected.
        is_conditional: whether all others are corrected as if those were known.
    """

    rows: Array
    noise: Array
    innovation: Array
    owner: IntArray
    rejected: BoolArray
    considered: slice
    is_conditional: bool = False

    @property
    def innovation_squared(self) -> float:
        """As in ``Expectation``."""
        return innovation_squared_of(self.rows, self.noise, self.innovation)

    @property
    def degrees_of_freedom(self) -> int:
        """As in ``Expectation``."""
        return len(self.innovation)

    @property
    def mean_excess(self) -> float:
        """As in ``Expectation``."""
        return mean_excess_of(self.rows, self.innovation)

    def update(self, core: SquareRootFilter, rejected: BoolArray) -> None:
        """One update by the rows that are left."""
        rows, noise, innovation = self.rows, self.noise, self.innovation
        keep = ~np.isin(self.owner, np.flatnonzero(rejected))
        if not keep.all():
            rows, noise, innovation = rows[:, keep], noise[np.ix_(keep, keep)], innovation[keep]
        if len(innovation):
            core.update(rows, noise, innovation, considered=self.considered, is_conditional=self.is_conditional)


def noise_rows_of(factors: Array) -> Array:
    """Rows ``N``, (3 k, 3 k), with ``N^T N`` the noise covariance of k blocks with these lower factors, (k, 3, 3)."""
    count = len(factors)
    rows = np.zeros((count, 3, count, 3))
    each = np.arange(count)
    rows[each, :, each, :] = np.swapaxes(factors, 1, 2)
    return rows.reshape(3 * count, 3 * count)


def innovation_squared_of(rows: Array, noise: Array, innovation: Array) -> float:
    """Normalised innovation squared, of rows (m, M) of the predicted measurement and (k, M) of the noise."""
    return float(innovation @ np.linalg.solve(rows.T @ rows + noise.T @ noise, innovation))


def mean_excess_of(rows: Array, innovation: Array) -> float:
    """Mean of squared innovations (M,) less the variances of the predicted measurement, with rows (m, M)."""
    return float(np.mean(np.square(innovation) - np.sum(np.square(rows), axis=0)))

# SPDX-License-Identifier: BSD-3-Clause
"""The models of the ``robust`` profile by compiled kernels: the same numbers as ``robust_models``, many times faster.

The kernels write the arrays that LAPACK triangularises, and read its triangles.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from coclo_vio.filter import (
    correction_kernel,
    measurement_kernel,
    process_kernel,
    state_kernels,
)
from coclo_vio.filter.foot_weights import unweighed
from coclo_vio.filter.measurement_model import LegConstants
from coclo_vio.filter.measurement_table import Measured, Sensed, SensingConstants, gravity_table
from coclo_vio.filter.process_kernel import ProcessConstants
from coclo_vio.filter.process_model import Interval
from coclo_vio.filter.robust_models import innovation_squared_of, mean_excess_of, noise_rows_of
from coclo_vio.filter.square_root_filter import MAX_ROTATION_SIGMA_RAD, SquareRootFilter
from coclo_vio.filter.stance import FootMotion, Reading
from coclo_vio.filter.state import CONSIDERED_BY_LEGS, State, StateLayout
from coclo_vio.filter.triangle_kernels import foot_noises
from coclo_vio.values.arrays import Array, BoolArray

_BLOCK = 32  # columns that LAPACK reflects together
_CONSIDERED = (CONSIDERED_BY_LEGS.start, CONSIDERED_BY_LEGS.stop)
_NO_RATE = np.zeros(3)
_NO_PRIOR = np.zeros((0, 0))


class CompiledModels:
    """The models by kernels; arguments as in ``DirectModels``, and the layout of the state."""

    def __init__(
        self, sensing: LegConstants, encoder_noise_rad: float, gate: dict[int, float], layout: StateLayout
    ) -> None:
        self._config = config = sensing.config
        self._is_conditional = sensing.takes_slip_for_known
        self.imu_delay_s, self.acceleration_density = 0.0, float(config.acceleration_density)
        self.stance_noise = unweighed(len(sensing.radii_m), config)
        self._encoder_noise_rad = float(encoder_noise_rad)
        radii_m, hips_body = np.array(sensing.radii_m), np.array(sensing.hips_body)
        self._sensing = SensingConstants(
            radii_m,
            hips_body,
            float(sensing.joint_velocity_noise_radps),
            float(config.standstill_velocity_noise_mps),
            float(config.standstill_rate_noise_radps),
            (gate[3], gate[6]),
            layout.world.stop,
        )
        self._process = ProcessConstants(
            radii_m,
            hips_body,
            float(config.angular_acceleration_density),
            layout.walks,
            layout.walking,
            layout.memories_s,
            layout.world.stop,
            layout.active,
        )

    def foot_noise(self, reading: Reading) -> Array:
        """Encoders through the Jacobian, and bending."""
        return foot_noises(reading.feet.jacobian, self._encoder_noise_rad, self._config.foot_position_noise_m)

    def predict(self, core: SquareRootFilter, motion: FootMotion, dt_s: float, foot_noise: Array) -> None:
        """By ``process_kernel``."""
        mean, factor = core.mean, core.active_factor
        layout, length = mean.layout, len(factor)
        rotation, active, rows, core.passive.cross = process_kernel.predicted(
            mean.rotation,
            mean.vector[:length],
            (factor, core.passive.cross),
            motion,
            foot_noise,
            self._process,
            Interval(dt_s, self.imu_delay_s, self.acceleration_density, self.stance_noise.creep),
            core.spread(layout.curved_in_process).width_squared,
        )
        triangle, _, _, _ = lapack.dgeqrf(rows, lwork=_BLOCK * length, overwrite_a=1)
        factor, scales = state_kernels.bounded_factor(triangle, MAX_ROTATION_SIGMA_RAD)
        core.replace_active(factor)
        core.follow_bound(scales)
        core.mean = State(layout, rotation, np.concatenate((active, mean.vector[length:])), mean.remembered)

    def expect(
        self,
        core: SquareRootFilter,
        reading: Reading,
        motion: FootMotion,
        *,
        foot_noise: Array,
        gyroscope_noise_radps: float,
    ) -> "CompiledExpectation | None":
        """By ``measurement_kernel``."""
        mean, feet, rate = core.mean, reading.feet, reading.angular_velocity
        sensed = Sensed(
            feet.position_body,
            np.ascontiguousarray(feet.velocity_body),
            np.ascontiguousarray(feet.angular_velocity_body),
            feet.jacobian,
            reading.is_stance if reading.stands else reading.is_known,
            self.stance_noise.velocity,
            _NO_RATE if rate is None else rate,
            0.0 if rate is None else gyroscope_noise_radps,
            reading.is_stationary,
        )
        measured = measurement_kernel.measured_of(
            sensed,
            motion,
            foot_noise,
            (mean.rotation, mean.vector[: mean.layout.active]),
            (core.active_factor, core.passive.cross),
            core.spread(mean.layout.curved_in_measurement).width_squared,
            self._sensing,
        )
        if not len(measured.innovation):
            return None
        return CompiledExpectation(measured, _CONSIDERED, is_conditional=self._is_conditional)

    def expect_gravity(self, core: SquareRootFilter, force_body: Array, sigma: float) -> "CompiledExpectation":
        """By ``measurement_kernel``."""
        mean, layout = core.mean, core.mean.layout
        table = gravity_table(force_body, sigma)
        predicted, rows, observed = measurement_kernel.expected(
            mean.rotation,
            mean.vector[: layout.active],
            core.active_factor,
            core.passive.cross,
            table,
            layout.world.stop,
            core.spread(layout.curved_in_measurement).width_squared,
        )
        rejected = np.zeros(layout.legs, dtype=np.bool_)
        return CompiledExpectation(Measured(table, rows, observed, force_body - predicted, rejected), (0, 0))


@dataclass(frozen=True, slots=True, eq=False)
class CompiledExpectation:
    """``Expectation`` of ``CompiledModels``.

    Attributes:
        measured: the measurements.
        considered: first error that is only considered, and the one after the last.
        is_conditional: whether all others are corrected as if those were known.
    """

    measured: Measured
    considered: tuple[int, int]
    is_conditional: bool = False

    @property
    def rejected(self) -> BoolArray:
        """As in ``Expectation``."""
        return self.measured.rejected

    @property
    def innovation_squared(self) -> float:
        """As in ``Expectation``."""
        rows, noise = self.measured.rows, noise_rows_of(self.measured.table.noise)
        return innovation_squared_of(rows, noise, self.measured.innovation)

    @property
    def degrees_of_freedom(self) -> int:
        """As in ``Expectation``."""
        return len(self.measured.innovation)

    @property
    def mean_excess(self) -> float:
        """As in ``Expectation``."""
        return mean_excess_of(self.measured.rows, self.measured.innovation)

    def update(self, core: SquareRootFilter, rejected: BoolArray) -> None:
        """One update by the rows that are left."""
        mean, measured = core.mean, self.measured
        layout = mean.layout
        stacked, innovation, observed = correction_kernel.stacked(
            measured.rows, core.active_factor, measured.table, measured.innovation, rejected, measured.observed
        )
        if not len(innovation):
            return
        prior = _NO_PRIOR
        if self.is_conditional:
            known = core.active_factor[slice(*self.considered)]
            prior = np.concatenate((core.active_factor @ known.T, core.passive.cross[slice(*self.considered)].T))
        triangle, _, _, _ = lapack.dgeqrf(stacked, lwork=_BLOCK * stacked.shape[1], overwrite_a=1)
        step, factor = correction_kernel.solved(
            triangle, innovation, self.considered, prior, observed, core.passive.cross, core.passive.own
        )
        core.replace_active(factor)
        moved = state_kernels.corrected(
            mean.rotation, mean.vector, mean.remembered, step, layout.world.stop, layout.active
        )
        core.mean = State(layout, *moved)

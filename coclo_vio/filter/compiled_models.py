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
from coclo_vio.filter.measurement_kernel import Sensed, SensingConstants, Triples
from coclo_vio.filter.measurement_model import LegConstants
from coclo_vio.filter.process_kernel import ProcessConstants
from coclo_vio.filter.square_root_filter import MAX_ROTATION_SIGMA_RAD, SquareRootFilter
from coclo_vio.filter.stance import FootMotion, Reading
from coclo_vio.filter.state import LEG_COMPLIANCE, SLIP, State, StateLayout
from coclo_vio.filter.triangle_kernels import foot_noises
from coclo_vio.values.arrays import Array, BoolArray

_BLOCK = 32  # columns that LAPACK reflects together
_CONSIDERED = (SLIP.start, SLIP.stop)
_NO_RATE = np.zeros(3)


class CompiledModels:
    """The models by kernels; arguments as in ``DirectModels``, and the layout of the state."""

    def __init__(
        self, sensing: LegConstants, encoder_noise_rad: float, gate: dict[int, float], layout: StateLayout
    ) -> None:
        self._config = config = sensing.config
        self._encoder_noise_rad = float(encoder_noise_rad)
        self._limits = (gate[3], gate[6])
        radii_m, hips_body = np.array(sensing.radii_m), np.array(sensing.hips_body)
        self._sensing = SensingConstants(
            radii_m,
            hips_body,
            float(sensing.joint_velocity_noise_radps),
            float(config.standstill_velocity_noise_mps),
            float(config.standstill_rate_noise_radps),
        )
        self._process = ProcessConstants(
            radii_m,
            hips_body,
            float(config.angular_acceleration_density),
            float(config.acceleration_density),
            float(config.foothold_creep),
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
            dt_s,
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
        dt_s: float,
    ) -> "CompiledExpectation | None":
        """By ``measurement_kernel``."""
        mean, feet, rate, config = core.mean, reading.feet, reading.angular_velocity, self._config
        has_stance = bool(reading.is_stance.any())
        sensed = Sensed(
            feet.position_body,
            np.ascontiguousarray(feet.velocity_body),
            np.ascontiguousarray(feet.angular_velocity_body),
            feet.jacobian,
            reading.is_stance if has_stance else reading.is_known,
            config.foot_velocity_noise_mps if has_stance else config.no_contact_velocity_density / float(np.sqrt(dt_s)),
            _NO_RATE if rate is None else rate,
            0.0 if rate is None else gyroscope_noise_radps,
            reading.is_stationary,
        )
        compliance_m = float(mean.vector[LEG_COMPLIANCE.start])
        table = measurement_kernel.triples_of(sensed, motion, foot_noise, mean.rotation, compliance_m, self._sensing)
        if not len(table.leg):
            return None
        layout, width_squared = mean.layout, core.spread(mean.layout.curved_in_measurement).width_squared
        predicted, rows, observed = measurement_kernel.expected(
            mean.rotation,
            mean.vector[: layout.active],
            core.active_factor,
            core.passive.cross,
            table,
            layout.world.stop,
            width_squared,
        )
        innovation = table.measured.ravel() - predicted
        rejected = measurement_kernel.rejected_legs(rows, innovation, table, self._limits, layout.legs)
        return CompiledExpectation(rows, table, innovation, observed, rejected)


@dataclass(frozen=True, slots=True, eq=False)
class CompiledExpectation:
    """``Expectation`` of ``CompiledModels``.

    Attributes:
        rows: square-root rows of the predicted measurement, (L + extra, M).
        table: the M / 3 triples.
        innovation: measured less predicted, (M,).
        observed: covariance with the passive errors, (M, p).
        rejected: as in ``Expectation``.
    """

    rows: Array
    table: Triples
    innovation: Array
    observed: Array
    rejected: BoolArray

    def update(self, core: SquareRootFilter, rejected: BoolArray) -> None:
        """One update by the rows that are left; the slip is only considered."""
        mean = core.mean
        layout = mean.layout
        stacked, innovation, observed = correction_kernel.stacked(
            self.rows, core.active_factor, self.table, self.innovation, rejected, self.observed
        )
        if not len(innovation):
            return
        triangle, _, _, _ = lapack.dgeqrf(stacked, lwork=_BLOCK * stacked.shape[1], overwrite_a=1)
        step, factor = correction_kernel.solved(
            triangle, innovation, _CONSIDERED, observed, core.passive.cross, core.passive.own
        )
        core.replace_active(factor)
        moved = state_kernels.corrected(
            mean.rotation, mean.vector, mean.remembered, step, layout.world.stop, layout.active
        )
        core.mean = State(layout, *moved)

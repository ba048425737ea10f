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
    measurement_model,
    process_kernel,
    process_model,
    state_kernels,
)
from coclo_vio.filter.measurement_kernel import Sensed, SensingConstants, Triples
from coclo_vio.filter.measurement_model import LegConstants
from coclo_vio.filter.process_kernel import ProcessConstants
from coclo_vio.filter.square_root_filter import MAX_ROTATION_SIGMA_RAD, SquareRootFilter
from coclo_vio.filter.stance import FootMotion, Reading
from coclo_vio.filter.state import LEG_COMPLIANCE, SLIP, State
from coclo_vio.filter.triangle_kernels import foot_noises, lower_of
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.calibration import ImuCalibration

_BLOCK = 32  # columns that LAPACK reflects together
_NO_RATE = np.zeros(3)


class CompiledModels:
    """The models by kernels; arguments as in ``DirectModels``."""

    def __init__(
        self, sensing: LegConstants, encoder_noise_rad: float, imu: ImuCalibration, gate: dict[int, float]
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
            float(imu.gyroscope_bias_walk),
            float(imu.accelerometer_bias_walk),
            float(config.leg_scale_walk * config.estimates_leg_scale),
            float(config.leg_compliance_walk_m * config.estimates_leg_compliance),
            float(config.slip_turn_per_m),
            float(config.slip_share),
            float(config.foothold_creep),
            float(config.slip_memory_s),
        )

    def foot_noise(self, reading: Reading) -> Array:
        """Encoders through the Jacobian, and bending."""
        return foot_noises(reading.feet.jacobian, self._encoder_noise_rad, self._config.foot_position_noise_m)

    def predict(self, core: SquareRootFilter, motion: FootMotion, dt_s: float, foot_noise: Array) -> None:
        """By ``process_kernel``."""
        mean = core.mean
        width_squared = core.spread(process_model.CURVED_COLUMNS).width_squared
        rotation, vector, rows = process_kernel.predicted(
            mean.rotation, mean.vector, core.factor, motion, foot_noise, self._process, dt_s, width_squared
        )
        length = len(vector)
        triangle, _, _, _ = lapack.dgeqrf(rows, lwork=_BLOCK * length, overwrite_a=1)
        core.factor = lower_of(triangle, 0, length)
        state_kernels.bound_rotations(core.factor, MAX_ROTATION_SIGMA_RAD, mean.layout.legs)
        core.mean = State(
            mean.layout, rotation, vector, mean.keyframe_rotation, mean.frame_rotation, mean.anchor_rotation
        )

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
        legs, width_squared = mean.layout.legs, core.spread(measurement_model.CURVED_COLUMNS).width_squared
        predicted, rows = measurement_kernel.expected(
            mean.rotation, mean.vector, core.factor, table, legs, width_squared
        )
        innovation = table.measured.ravel() - predicted
        rejected = measurement_kernel.rejected_legs(rows, innovation, table, self._limits, legs)
        return CompiledExpectation(rows, table, innovation, rejected)


@dataclass(frozen=True, slots=True, eq=False)
class CompiledExpectation:
    """``Expectation`` of ``CompiledModels``.

    Attributes:
        rows: square-root rows of the predicted measurement, (L + extra, M).
        table: the M / 3 triples.
        innovation: measured less predicted, (M,).
        rejected: as in ``Expectation``.
    """

    rows: Array
    table: Triples
    innovation: Array
    rejected: BoolArray

    def update(self, core: SquareRootFilter, rejected: BoolArray) -> None:
        """One update by the rows that are left; the slip is only considered."""
        mean = core.mean
        layout = mean.layout
        stacked, innovation = correction_kernel.stacked(self.rows, core.factor, self.table, self.innovation, rejected)
        if not len(innovation):
            return
        triangle, _, _, _ = lapack.dgeqrf(stacked, lwork=_BLOCK * stacked.shape[1], overwrite_a=1)
        step, core.factor = correction_kernel.solved(triangle, innovation, SLIP.start, SLIP.stop)
        remembered = mean.keyframe_rotation[None]
        if layout.has_frame:
            remembered = np.stack((mean.keyframe_rotation, mean.frame_rotation, mean.anchor_rotation))
        rotation, vector, remembered = state_kernels.corrected(
            mean.rotation, mean.vector, remembered, step, layout.legs
        )
        core.mean = State(layout, rotation, vector, *remembered)

# SPDX-License-Identifier: BSD-3-Clause
"""Simulated faults of an IMU: silent, constant, other axes or signs, offsets, shocks, and a range that is too small."""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from coclo_vio.datasets.corrections import axes_matrix
from coclo_vio.runs.fault_kinds.fault_form import SPAN, FaultForm, Spans, TimedFault, active, one_or_more
from coclo_vio.runs.fault_spans import Span
from coclo_vio.values.arrays import Array
from coclo_vio.values.config import StageConfig
from coclo_vio.values.measurements import CameraImuSample, ImuSample
from coclo_vio.values.units import NS_PER_S

SATURATION = FaultForm("START:SECONDS:RADPS:MPS2", "20:5:0.3:12", ((1e-3, 100.0), (0.1, 1e4)))
FORCE_OFFSET = FaultForm("START:SECONDS:MPS2", "20:5:1", ((0.0, 100.0),))
SHOCKS = FaultForm("START:SECONDS:MPS2", "20:5:100", ((0.0, 1e4),))
_SHOCK_EVERY_NS = NS_PER_S // 5
_SHOCK_S = 0.005
_SHOCK_LASTS = 8.0  # in that unit

_Sample = ImuSample | CameraImuSample
_AXES_EXAMPLE = "20:5:y -x z"


def axes_span(text: str) -> tuple[Span, Array]:
    """Span and matrix (3, 3), from the axes that are meant to those that are read, of ``START:SECONDS:AXES``.

    Raises:
        ValueError: no span, or not three axes.
    """
    front, _, axes = text.rpartition(":")
    names = axes.split()
    if len(names) != 3 or sorted(name.lstrip("+-") for name in names) != ["x", "y", "z"] or ":" not in front:
        raise ValueError(f"{text!r} is no START:SECONDS:AXES with each axis once, such as {_AXES_EXAMPLE}")
    return Span.parse(front), axes_matrix(axes)


def _axes_text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError(f'must be text START:SECONDS:AXES, such as "{_AXES_EXAMPLE}"')
    axes_span(value)
    return value


_Axes = Annotated[tuple[Annotated[str, BeforeValidator(_axes_text)], ...], BeforeValidator(one_or_more)]
_Limits = Annotated[tuple[Annotated[str, BeforeValidator(SATURATION.checked)], ...], BeforeValidator(one_or_more)]
_Forces = Annotated[tuple[Annotated[str, BeforeValidator(FORCE_OFFSET.checked)], ...], BeforeValidator(one_or_more)]
_Shocks = Annotated[tuple[Annotated[str, BeforeValidator(SHOCKS.checked)], ...], BeforeValidator(one_or_more)]


class InertialFaultsConfig(StageConfig):
    """What goes wrong with an IMU."""

    faulty_imu: Annotated[
        Literal["body", "camera", "both"], Field(description="which IMU the faults of IMUs are on")
    ] = "body"
    silent_imu: Annotated[Spans, Field(description="START:SECONDS each: no reading of the IMU")] = ()
    constant_imu: Annotated[Spans, Field(description="START:SECONDS each: the last reading comes again and again")] = ()
    imu_axes: Annotated[
        _Axes,
        Field(description="START:SECONDS:AXES each: the IMU's axes that are read as x, y and z; -x -y -z: other signs"),
    ] = ()
    accelerometer_offset: Annotated[
        _Forces, Field(description="START:SECONDS:MPS2 each: added to every axis of the accelerometer")
    ] = ()
    imu_shocks: Annotated[
        _Shocks,
        Field(description="START:SECONDS:MPS2 each: five times a second a shock of the accelerometer of this size"),
    ] = ()
    imu_saturation: Annotated[
        _Limits, Field(description="START:SECONDS:RADPS:MPS2 each: no axis reads more than this rate and this force")
    ] = ()


class InertialFaults:
    """The faults of a configuration on the readings of the IMUs."""

    def __init__(self, config: InertialFaultsConfig, seed: int) -> None:
        """Take the faults; ``seed`` decides the directions of shocks."""
        kinds: dict[str, tuple[type[_Sample], ...]] = {
            "body": (ImuSample,),
            "camera": (CameraImuSample,),
            "both": (ImuSample, CameraImuSample),
        }
        self._kinds = kinds[config.faulty_imu]
        self._seed = seed
        self._silent, self._constant = SPAN.parsed(config.silent_imu), SPAN.parsed(config.constant_imu)
        self._axes = [axes_span(text) for text in config.imu_axes]
        self._offsets = FORCE_OFFSET.parsed(config.accelerometer_offset)
        self._shocks = SHOCKS.parsed(config.imu_shocks)
        self._limits = SATURATION.parsed(config.imu_saturation)
        self._held: dict[type, _Sample] = {}

    def is_on(self, sample: _Sample) -> bool:
        """Whether the faults are on the IMU that this reading is of."""
        return isinstance(sample, self._kinds)

    def applied(self, sample: _Sample, after_ns: int) -> _Sample | None:
        """The reading, or what becomes of it; None where there is none."""
        if not self.is_on(sample):
            return sample
        if active(self._silent, after_ns):
            return None
        kind = type(sample)
        held = self._held.get(kind)
        if held is None or not active(self._constant, after_ns):
            held = self._held[kind] = sample
        rate, force = self._changed(held.angular_velocity, held.specific_force, after_ns)
        if rate is sample.angular_velocity and force is sample.specific_force:
            return sample
        return kind(sample.stamp_ns, rate, force)

    def _changed(self, rate: Array, force: Array, after_ns: int) -> tuple[Array, Array]:
        for span, matrix in self._axes:
            if after_ns in span:
                rate, force = matrix @ rate, matrix @ force
        for fault in active(self._offsets, after_ns):
            force = force + fault.values[0]
        for fault in active(self._shocks, after_ns):
            force = force + _shock(fault, after_ns, self._seed)
        for fault in active(self._limits, after_ns):
            most_radps, most_mps2 = (abs(value) for value in fault.values)
            rate, force = np.clip(rate, -most_radps, most_radps), np.clip(force, -most_mps2, most_mps2)
        return rate, force


def _shock(fault: TimedFault, after_ns: int, seed: int) -> Array:
    """Specific force of the newest shock, m/s^2, (3,): ``A (1 - x) exp(-x)`` of x = time / 5 ms, of no net velocity."""
    number, since_ns = divmod(after_ns - fault.span.start_ns, _SHOCK_EVERY_NS)
    x = since_ns / NS_PER_S / _SHOCK_S
    if x > _SHOCK_LASTS:
        return np.zeros(3)
    direction = np.random.default_rng([seed, 2, number]).normal(size=3)
    return np.asarray(fault.values[0] * (1.0 - x) * np.exp(-x) * direction / np.linalg.norm(direction))

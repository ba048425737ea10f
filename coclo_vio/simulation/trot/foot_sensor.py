# SPDX-License-Identifier: BSD-3-Clause
"""Sensors of foot force as a Unitree Go1 has them: raw counts of pressure in a rubber foot.

In a real log a foot in the air reads a few counts, a standing one some two hundred, one of two in a trot several
hundred; the reading follows a touch-down late and lingers after a lift-off. No maker publishes figures; these are
chosen.
"""

from collections.abc import Iterator
from typing import Annotated

import numpy as np
from pydantic import Field

from coclo_vio.simulation.trial.motion import Motion
from coclo_vio.simulation.trial.sensors import interpolated_at, sample_times
from coclo_vio.values.arrays import Array
from coclo_vio.values.config import StageConfig
from coclo_vio.values.measurements import FootForceSample


class FootSensorConfig(StageConfig):
    """Raw counts of each foot: gain times the delayed force, offset, hysteresis, drift, noise, saturation."""

    is_present: Annotated[bool, Field(description="whether the robot has such sensors")] = True
    counts_per_n: Annotated[float, Field(gt=0, description="gain; a standing Go1 reads 227 counts at 32 N")] = 7.0
    gain_spread: Annotated[float, Field(ge=0, le=0.45, description="of that, foot by foot, relative")] = 0.12
    offset: Annotated[float, Field(ge=0, description="standard deviation of a foot's reading in the air, counts")] = 4.0
    rise_s: Annotated[float, Field(gt=0, le=0.2, description="time constant of a rising reading, s")] = 0.006
    fall_s: Annotated[float, Field(gt=0, le=0.5, description="time constant of a falling reading, s")] = 0.012
    lingering: Annotated[
        float, Field(ge=0, le=1, description="share of the reading that falls with the slow time constant")
    ] = 0.2
    lingering_s: Annotated[float, Field(gt=0, le=2, description="slow time constant of a falling reading, s")] = 0.05
    hysteresis: Annotated[float, Field(ge=0, description="counts by which a reading lags a reversal")] = 6.0
    drift: Annotated[float, Field(ge=0, description="random walk of the offset, counts/sqrt(s)")] = 0.5
    noise: Annotated[float, Field(ge=0, description="white, a sample, counts")] = 3.0
    largest: Annotated[float, Field(gt=0, description="beyond it readings saturate, counts")] = 1200.0
    dead_foot: Annotated[int | None, Field(ge=0, le=3, description="foot that reads its offset only; null: none")] = (
        None
    )


def foot_force_samples(
    motion: Motion, config: FootSensorConfig, rate_hz: float, generator: np.random.Generator
) -> Iterator[FootForceSample]:
    """Readings of the foot sensors in whole counts, ``rate_hz`` a second; nothing where the robot has none."""
    if not config.is_present:
        return
    stamps, offsets = sample_times(float(motion.time_s[-1]), rate_hz)
    feet = motion.foot_force.shape[1]
    gain = config.counts_per_n * (1.0 + config.gain_spread * np.clip(generator.standard_normal(feet), -2.0, 2.0))
    step_s = float(motion.time_s[1] - motion.time_s[0])
    pressed = gain * interpolated_at(motion.time_s, _delayed(motion.foot_force, config, step_s), offsets)
    counts = _with_play(pressed, config.hysteresis)
    walk = config.drift / np.sqrt(rate_hz) * generator.standard_normal(counts.shape)
    offset = config.offset * generator.standard_normal(feet) + np.cumsum(walk, axis=0)
    if config.dead_foot is not None:
        counts[:, config.dead_foot] = 0.0
    counts += offset + config.noise * generator.standard_normal(counts.shape)
    for stamp, reading in zip(stamps, np.rint(np.minimum(counts, config.largest)), strict=True):
        yield FootForceSample(int(stamp), reading)


def _delayed(force: Array, config: FootSensorConfig, step_s: float) -> Array:
    """Two low-pass filters in parallel that rise fast and fall more slowly, (N, feet)."""
    rise = 1.0 - np.exp(-step_s / config.rise_s)
    falls = [1.0 - np.exp(-step_s / time_s) for time_s in (config.fall_s, config.lingering_s)]
    result = np.zeros_like(force)
    for fall, share in zip(falls, (1.0 - config.lingering, config.lingering), strict=True):
        value, rows = force[0].copy(), np.empty_like(force)
        for row, wanted in enumerate(force):
            error = wanted - value
            value += np.where(error > 0.0, rise, fall) * error
            rows[row] = value
        result += share * rows
    return result


def _with_play(values: Array, width: float) -> Array:
    """The play operator of hysteresis: the result moves only when it is half of ``width`` behind, (N, feet)."""
    half = width / 2.0
    state, rows = values[0].copy(), np.empty_like(values)
    for row, value in enumerate(values):
        state = np.clip(state, value - half, value + half)
        rows[row] = state
    return rows

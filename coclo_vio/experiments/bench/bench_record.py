# SPDX-License-Identifier: BSD-3-Clause
"""What a benchmark measured, as JSON, and the change against an earlier one."""

from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from coclo_vio.experiments.results.provenance import Provenance
from coclo_vio.values.record import Record

NEXT_STEP = "measure again with `make bench`"


class StageCost(BaseModel):
    """The cost of one stage.

    Attributes:
        what: is counted, in words.
        ms: processor time of one unit, ms.
        units: the same as a multiple of the calibration loop of this run: what compares between machines.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    what: str
    ms: float
    units: float


class Sweep(BaseModel):
    """How a cost grows with one size, all else equal.

    Attributes:
        what: is counted, in words.
        size: what grows, in words.
        sizes: ascending.
        ms: processor time at each size, ms.
        units: the same in calibration loops timed beside each, for the speed of a shared core varies.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    what: str
    size: str
    sizes: tuple[float, ...]
    ms: tuple[float, ...]
    units: tuple[float, ...]

    @property
    def ms_at_one_speed(self) -> tuple[float, ...]:
        """The costs at the mean speed of the core, ms."""
        return _at_one_speed(self.ms, self.units)

    @property
    def exponent(self) -> float:
        """The power of the size with which the cost grows, by least squares of the logarithms over all sizes."""
        slope, _ = np.polyfit(np.log(self.sizes), np.log(self.units), 1)
        return float(slope)

    @property
    def last_exponent(self) -> float:
        """The same from the last but one size to the last, where fixed costs count least."""
        return float(np.log(self.units[-1] / self.units[-2]) / np.log(self.sizes[-1] / self.sizes[-2]))


class Endurance(BaseModel):
    """A long input: time a sample and memory as it goes on.

    Attributes:
        what: is counted, in words.
        minutes: of input, ascending.
        ms: processor time a sample in the stretch that ends there, ms.
        units: the same in calibration loops timed at its end.
        resident_mb: memory of the process there, MiB.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    what: str
    minutes: tuple[float, ...]
    ms: tuple[float, ...]
    units: tuple[float, ...]
    resident_mb: tuple[float, ...]

    @property
    def ms_at_one_speed(self) -> tuple[float, ...]:
        """The costs at the mean speed of the core, ms."""
        return _at_one_speed(self.ms, self.units)


def _at_one_speed(ms: Sequence[float], units: Sequence[float]) -> tuple[float, ...]:
    unit_ms = float(np.mean(np.array(ms) / np.array(units)))
    return tuple(unit_ms * each for each in units)


class BenchRecord(Record):
    """``bench.json``.

    Attributes:
        origin: commit, date, machine, versions, command.
        calibration_ms: the unit, processor time of the calibration loop, ms.
        compile_s: processor time of the first run's compilation of all kernels, s; None where there is no numba.
        stages: costs by name.
        combined_realtime_factor: four legs at 500 Hz and stereo at 15 Hz, seconds of recording per second of one core.
        sweeps: by name.
        endurance: by name.
    """

    next_step: ClassVar[str] = NEXT_STEP
    schema_version: Literal[1] = 1

    origin: Provenance
    calibration_ms: float
    compile_s: float | None
    stages: dict[str, StageCost]
    combined_realtime_factor: float
    sweeps: dict[str, Sweep]
    endurance: dict[str, Endurance]

    def changes_from(self, before: "BenchRecord") -> dict[str, float]:
        """How many times as fast as in an earlier record each stage is, in calibration units, by name."""
        return {
            name: before.stages[name].units / stage.units
            for name, stage in self.stages.items()
            if name in before.stages
        }

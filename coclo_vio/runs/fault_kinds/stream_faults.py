# SPDX-License-Identifier: BSD-3-Clause
"""Simulated faults of stamps and arrival: samples out of order or repeated, stamps ahead, clocks that step.

What a driver does to good samples; times of faults are by the true stamps.
"""

import heapq
from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field

from coclo_vio.datasets.read_report import STREAM_NAMES
from coclo_vio.runs.fault_kinds.fault_form import FaultForm, TimedFault, active, one_or_more
from coclo_vio.values.config import StageConfig
from coclo_vio.values.errors import listing
from coclo_vio.values.measurements import Measurement
from coclo_vio.values.units import NS_PER_S

ALL_STREAMS = "all"
SHUFFLED = FaultForm("START:SECONDS:LATE_S", "20:5:0.03", ((0.0, 10.0),))
REPEATED = FaultForm("START:SECONDS:SHARE", "20:5:0.2", ((0.0, 1.0),))
AHEAD = FaultForm("STREAM:START:SECONDS:AHEAD_S", "joints:20:5:3600", ((1e-9, 1e9),))
STEP = FaultForm("STREAM:START:SECONDS:STEP_S", "all:20:1000:-0.5", ((1e-9, 1e9),))
_AHEAD_SHARE = 0.05  # of the samples


def _known_stream(text: str) -> str:
    name = text.partition(":")[0]
    if name != ALL_STREAMS and name not in STREAM_NAMES.values():
        raise ValueError(f"there is no stream {name}; there are: {listing([ALL_STREAMS, *STREAM_NAMES.values()])}")
    return text


_Shuffled = Annotated[tuple[Annotated[str, BeforeValidator(SHUFFLED.checked)], ...], BeforeValidator(one_or_more)]
_Repeated = Annotated[tuple[Annotated[str, BeforeValidator(REPEATED.checked)], ...], BeforeValidator(one_or_more)]
_Ahead = Annotated[
    tuple[Annotated[str, BeforeValidator(AHEAD.checked), AfterValidator(_known_stream)], ...],
    BeforeValidator(one_or_more),
]
_Steps = Annotated[
    tuple[Annotated[str, BeforeValidator(STEP.checked), AfterValidator(_known_stream)], ...],
    BeforeValidator(one_or_more),
]


class StreamFaultsConfig(StageConfig):
    """What drivers do to stamps and to the order of samples."""

    shuffled: Annotated[
        _Shuffled,
        Field(description="START:SECONDS:LATE_S each: every sample comes late by up to this, at random; stamps stay"),
    ] = ()
    repeated_samples: Annotated[
        _Repeated, Field(description="START:SECONDS:SHARE each: this share of the samples comes twice, at random")
    ] = ()
    future_stamps: Annotated[
        _Ahead,
        Field(description="STREAM:START:SECONDS:AHEAD_S each: one stamp in twenty is ahead by this; STREAM or all"),
    ] = ()
    clock_steps: Annotated[
        _Steps, Field(description="STREAM:START:SECONDS:STEP_S each: stamps are off by this; STREAM or all")
    ] = ()


class StreamFaults:
    """The faults of a configuration on samples in the order of their true stamps; they leave in that of arrival."""

    def __init__(self, config: StreamFaultsConfig, seed: int) -> None:
        """Take the faults; ``seed`` decides on everything random."""
        self._shuffled, self._repeated = SHUFFLED.parsed(config.shuffled), REPEATED.parsed(config.repeated_samples)
        self._ahead, self._steps = AHEAD.parsed(config.future_stamps), STEP.parsed(config.clock_steps)
        self._random = np.random.default_rng([seed, 4])
        self._late: list[tuple[int, int, Measurement]] = []  # arrival, number
        self._number = 0

    def push(self, measurement: Measurement, after_ns: int) -> Iterator[Measurement]:
        """Take one; those that have arrived by then."""
        while self._late and self._late[0][0] <= after_ns:
            yield heapq.heappop(self._late)[2]
        stamped = self._stamped(measurement, after_ns)
        copies = 1 + sum(self._random.random() < fault.values[0] for fault in active(self._repeated, after_ns))
        delays = active(self._shuffled, after_ns)
        for _ in range(copies):
            if not delays:
                yield stamped
                continue
            self._number += 1
            late_ns = sum(round(self._random.uniform(0.0, abs(fault.values[0])) * NS_PER_S) for fault in delays)
            heapq.heappush(self._late, (after_ns + late_ns, self._number, stamped))

    def finish(self) -> Iterator[Measurement]:
        """Those that are still under way."""
        while self._late:
            yield heapq.heappop(self._late)[2]

    def _stamped(self, measurement: Measurement, after_ns: int) -> Measurement:
        """The sample with the stamp that its driver gives it."""
        name = STREAM_NAMES[type(measurement)]
        off_s = sum(fault.values[0] for fault in active(self._steps, after_ns) if _is_of(fault, name))
        for fault in active(self._ahead, after_ns):
            if _is_of(fault, name) and self._random.random() < _AHEAD_SHARE:
                off_s += fault.values[0]
        if not off_s:
            return measurement
        moved: Any = replace(measurement, stamp_ns=measurement.stamp_ns + round(off_s * NS_PER_S))
        return moved  # type: ignore[no-any-return]


def _is_of(fault: TimedFault, stream: str) -> bool:
    return fault.of in {ALL_STREAMS, stream}

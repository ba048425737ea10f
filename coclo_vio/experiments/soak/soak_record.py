# SPDX-License-Identifier: BSD-3-Clause
"""``soak.json``: latency, memory and drift over a long time, and whether memory and time a sample stay as they are."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from coclo_vio.geometry import so3
from coclo_vio.runs.latency import IntervalRecord, LatencyRecord
from coclo_vio.values.arrays import Array
from coclo_vio.values.record import Record
from coclo_vio.values.trajectory import Trajectory
from coclo_vio.values.units import NS_PER_S

FLAT_WITHIN_PERCENT = 5.0
_FEWEST_INTERVALS = 10
_MOST_MISSING_S = 1.0  # of a round's end
_SETTLING_S = 1.0  # images that jump back to the start are a motion that no robot makes: a round counts from here on
_LEAST_PATH_M = 0.1
_EARLY, _LATE = (0.1, 0.4), (0.7, 1.0)  # shares of the time that are compared; the first tenth is the start


class _Part(BaseModel):
    """A part of the record."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class RoundRecord(_Part):
    """One round of the recording, for one trajectory: where it ends, seen from where it was a second after it began.

    Attributes:
        trajectory: its name.
        number: of the round, from 0.
        time_s: of its end, by stamps since the first measurement.
        drift_m: distance of the estimated end from the true one, both seen from that pose.
        drift_percent: the same by the path of the round.
        yaw_deg: error of the heading's change, left positive.
    """

    trajectory: str
    number: int
    time_s: float
    drift_m: float
    drift_percent: float
    yaw_deg: float


class GrowthRecord(_Part):
    """A quantity between 10 and 40 % of the time, and over its last 30 %: medians of the intervals."""

    early: float
    late: float
    growth_percent: float
    is_flat: bool


class SoakRecord(Record):
    """What a recording came to that was played round after round.

    Attributes:
        recording: name of it.
        minutes: of wall time that were played.
        rounds: by trajectory and number.
        memory_mb: resident memory of the estimator's processes together.
        cpu_ms_per_sample: their processor time for one measurement.
        is_flat: whether neither of the two grew by more than 5 %; None where the time was too short to say so.
        latency: all times, over all rounds.
    """

    schema_version: Literal[1] = 1
    recording: str
    minutes: float
    rounds: tuple[RoundRecord, ...]
    memory_mb: GrowthRecord | None
    cpu_ms_per_sample: GrowthRecord | None
    is_flat: bool | None
    latency: LatencyRecord


def soak_record(
    recording: str,
    latency: LatencyRecord,
    estimates: Mapping[str, Trajectory],
    truth: Trajectory | None,
    period_ns: int,
) -> SoakRecord:
    """The record of a recording that was played.

    Args:
        recording: its name.
        latency: its times.
        estimates: of all rounds, by the name of the trajectory.
        truth: of the first round; None where there is none.
        period_ns: from the beginning of a round to that of the next one.
    """
    memory = growth_of(latency.intervals, _memory_mb)
    cpu = growth_of(latency.intervals, _cpu_ms_per_sample)
    drifts = () if truth is None else [rounds_of(name, one, truth, period_ns) for name, one in estimates.items()]
    return SoakRecord(
        recording=recording,
        minutes=latency.intervals[-1].time_s / 60.0 if latency.intervals else 0.0,
        rounds=tuple(one for of_one in drifts for one in of_one),
        memory_mb=memory,
        cpu_ms_per_sample=cpu,
        is_flat=None if memory is None or cpu is None else memory.is_flat and cpu.is_flat,
        latency=latency,
    )


def growth_of(
    intervals: Sequence[IntervalRecord], value: Callable[[IntervalRecord], float | None]
) -> GrowthRecord | None:
    """How a value of the intervals grew; None with fewer than ten intervals, or where it is not known."""
    known = [(one.time_s, at) for one in intervals if (at := value(one)) is not None]
    if len(known) < _FEWEST_INTERVALS:
        return None
    times_s, values = np.array(known).T
    shares = times_s / times_s[-1]
    early, late = (float(np.median(values[(shares >= begin) & (shares <= end)])) for begin, end in (_EARLY, _LATE))
    growth = 100.0 * (late / early - 1.0)
    return GrowthRecord(early=early, late=late, growth_percent=growth, is_flat=growth <= FLAT_WITHIN_PERCENT)


def _memory_mb(interval: IntervalRecord) -> float | None:
    loads = [load.rss_mb for name, load in interval.processes.items() if name != "source"]
    return sum(loads) if loads else None


def _cpu_ms_per_sample(interval: IntervalRecord) -> float | None:
    loads = [load.cpu_percent for name, load in interval.processes.items() if name != "source"]
    return 10.0 * sum(loads) * interval.length_s / interval.measurements if loads and interval.measurements else None


def rounds_of(name: str, estimate: Trajectory, truth: Trajectory, period_ns: int) -> Iterator[RoundRecord]:
    """Each whole round of a trajectory against the truth of the first round, from a second after its beginning on.

    Args:
        name: of the trajectory.
        estimate: of all rounds.
        truth: of the first one.
        period_ns: from the beginning of a round to that of the next one.
    """
    first_ns = int(estimate.stamps_ns[0])
    for number in range(1 + (int(estimate.stamps_ns[-1]) - first_ns) // period_ns):
        shift_ns = number * period_ns
        begin_ns, end_ns = (int(stamp_ns) + shift_ns for stamp_ns in truth.stamps_ns[[0, -1]])
        begin_ns += round(_SETTLING_S * NS_PER_S)
        part = estimate.between(begin_ns, end_ns)
        if len(part) < 2 or end_ns - int(part.stamps_ns[-1]) > _MOST_MISSING_S * NS_PER_S:
            continue  # cut short by the end of the time
        ends_ns = part.stamps_ns[[0, -1]]
        true = truth.restamped(truth.stamps_ns + shift_ns).interpolated(ends_ns)
        (by_truth, true_yaw), (by_estimate, yaw) = (
            _motion(one.T_world_body) for one in (true, part.interpolated(ends_ns))
        )
        drift_m = float(np.linalg.norm(by_estimate - by_truth))
        length_m = truth.between(int(ends_ns[0]) - shift_ns, int(ends_ns[1]) - shift_ns).path_length_m()
        off = float(np.degrees(np.angle(np.exp(1j * (yaw - true_yaw)))))
        yield RoundRecord(
            trajectory=name,
            number=number,
            time_s=(int(ends_ns[1]) - first_ns) / NS_PER_S,
            drift_m=drift_m,
            drift_percent=100.0 * drift_m / max(length_m, _LEAST_PATH_M),
            yaw_deg=off,
        )


def _motion(T_world_body: Array) -> tuple[Array, float]:
    """From the first to the second of two poses, (2, 4, 4): displacement in the heading of the first, m, and turn."""
    yaw = so3.yaw(T_world_body[:, :3, :3])
    displacement = so3.about_z(float(yaw[0])).T @ (T_world_body[1, :3, 3] - T_world_body[0, :3, 3])
    return displacement, float(yaw[1] - yaw[0])

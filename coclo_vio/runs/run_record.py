# SPDX-License-Identifier: BSD-3-Clause
"""``run.json``: what a run folder holds and how its estimators fared, as a versioned record."""

from collections.abc import Iterable, Mapping
from typing import Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field

from coclo_vio.datasets.read_report import ReadReport
from coclo_vio.diagnosis.finding import Finding
from coclo_vio.values.outputs import Calibration, ClockStepEvent, Event, SlipEvent
from coclo_vio.values.record import Record
from coclo_vio.values.units import NS_PER_S

Interval = tuple[int, int]
"""Stamps of a beginning and an end, ns."""
Status = Literal["running", "finished", "interrupted", "failed"]
"""Of a run or a mode: ``running`` also of one that was killed, ``interrupted`` by a signal, ``failed`` by an error."""


class _Part(BaseModel):
    """A part of a record."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class EventRecord(_Part):
    """An event of an estimator; ``time_s`` counts from the beginning of the recording."""

    time_s: float
    stamp_ns: int
    kind: str
    detail: str

    @classmethod
    def of(cls, event: Event, start_ns: int) -> "EventRecord":
        """The record of an event."""
        time_s = (event.stamp_ns - start_ns) / NS_PER_S
        return cls(time_s=time_s, stamp_ns=event.stamp_ns, kind=event.kind, detail=event.detail)


class CalibrationRecord(_Part):
    """What was learnt of the cameras by the end of the run; see ``values.outputs.Calibration``."""

    stamp_ns: int
    rotation_body_rad: tuple[float, float, float]
    rotation_sigma_rad: tuple[float, float, float]
    stereo_scale: float
    stereo_scale_sigma: float

    @classmethod
    def of(cls, calibration: Calibration) -> "CalibrationRecord":
        """The record of a calibration."""
        x, y, z = calibration.rotation_body.tolist()
        a, b, c = calibration.rotation_sigma.tolist()
        scale, sigma = calibration.stereo_scale, calibration.stereo_scale_sigma
        return cls(
            stamp_ns=calibration.stamp_ns,
            rotation_body_rad=(x, y, z),
            rotation_sigma_rad=(a, b, c),
            stereo_scale=scale,
            stereo_scale_sigma=sigma,
        )


class ClockStepRecord(_Part):
    """A step of the clock of all streams, which the files of the run do not have.

    Attributes:
        at_ns: from there on, by the clock that the run began with.
        step_ns: clock of the samples after the step less that before.
    """

    at_ns: int
    step_ns: int

    @classmethod
    def of_events(cls, events: Iterable[Event]) -> tuple["ClockStepRecord", ...]:
        """The steps among events, in their order."""
        return tuple(cls(at_ns=each.at_ns, step_ns=each.step_ns) for each in events if isinstance(each, ClockStepEvent))


class FindingRecord(_Part):
    """What a check found in the recording; see ``diagnosis.finding.Finding``."""

    kind: str
    stage: str
    severity: str
    sentence: str
    streams: tuple[str, ...]
    remedy: tuple[str, ...]
    is_certain: bool

    @classmethod
    def of(cls, finding: Finding) -> "FindingRecord":
        """The record of a finding."""
        return cls.model_validate(finding.to_json())


class SlipRecord(_Part):
    """How often and how far one foot slid while its contact was in stance."""

    count: int
    distance_m: float
    duration_s: float

    @classmethod
    def by_foot(cls, events: Iterable[Event]) -> dict[str, "SlipRecord"]:
        """The slips among events, by the name of the foot; feet that did not slip are left out."""
        found: dict[str, SlipRecord] = {}
        for event in events:
            if isinstance(event, SlipEvent):
                before = found.get(event.foot, cls(count=0, distance_m=0.0, duration_s=0.0))
                found[event.foot] = cls(
                    count=before.count + 1,
                    distance_m=before.distance_m + event.distance_m,
                    duration_s=before.duration_s + event.duration_s,
                )
        return found


class KeyframeSummary(_Part):
    """An estimator's keyframes: their number, medians and 95th percentiles; None where a figure is not defined."""

    count: int
    tracks_median: float | None
    tracks_p95: float | None
    reprojection_px_median: float | None
    reprojection_px_p95: float | None
    iterations_median: float | None
    iterations_p95: float | None
    compute_ms_median: float | None
    compute_ms_p95: float | None


class TrajectoryRecord(_Part):
    """One trajectory of a run, and how the mode fared that gave it.

    Attributes:
        mode: that gave it.
        sensors: streams that the mode read.
        measurements: how many it took.
        estimates: how many poses the trajectory has.
        compute_s: time spent in the estimator, s.
        realtime_factor: seconds of recording per second of computing.
        counts: what the estimator counted.
        events: what happened in it.
        slips: by foot, how often and how far it slid; empty where none did.
        keyframes: its keyframes, None where it has none.
        calibration: what it learnt of the cameras, None where nothing.
        pictures: how many were written.
        recording_ns: first and last stamp of its cameras, where it has any.
        failure: why it stopped early, None where it went through.
        status: whether it still runs, or how it ended.
        last_ns: stamp of its last estimate, None without any.
        resumed_ns: stamps of the measurements after which ``--resume`` went on.
        clock_steps: steps of the clock of all streams. Stamps of the run are by the clock before the first of them; a
            sample's own stamp is that and ``step_ns`` of every step whose ``at_ns`` it has reached.
    """

    mode: str
    sensors: tuple[str, ...]
    measurements: int
    estimates: int
    compute_s: float
    realtime_factor: float | None
    counts: dict[str, int]
    events: tuple[EventRecord, ...]
    slips: dict[str, SlipRecord] = Field(default_factory=dict)
    keyframes: KeyframeSummary | None
    calibration: CalibrationRecord | None
    pictures: int
    recording_ns: Interval | None
    failure: str | None
    status: Status = "finished"
    last_ns: int | None = None
    resumed_ns: tuple[int, ...] = ()
    clock_steps: tuple[ClockStepRecord, ...] = ()


class GroundTruthRecord(_Part):
    """The ground truth of a run folder: where it comes from, and whether its stamps are real."""

    source: str
    has_stamps: bool


class RunRecord(Record):
    """``run.json`` of a run folder.

    Attributes:
        version: of the package that made the run.
        dataset: path of the recording.
        robot: its name, None without one.
        imu_calibration: whether mounting and noise of the body's IMU are the ``recording``'s or the ``robot``'s.
        ground_truth: of the run folder, None without any.
        faults: those that were applied, None without any.
        recording_ns: first and last stamp of the recording, None where it is not known.
        estimators: the trajectories by name.
        reader: what was read, None where the recording cannot be read through.
        findings: what physics or the recording itself contradict in it, before the run.
        status: whether the run still goes on, or how it ended.
        updated: when this record was written, ISO 8601, UTC.
        failure: of the run as a whole, such as a full disk; None where there was none.
    """

    next_step: ClassVar[str] = "run again with `coclo-vio run` or `coclo-vio compare`"

    schema_version: Literal[3] = 3
    version: str
    dataset: str
    robot: str | None
    imu_calibration: Literal["recording", "robot"]
    ground_truth: GroundTruthRecord | None
    faults: dict[str, Any] | None
    recording_ns: Interval | None = None
    estimators: dict[str, TrajectoryRecord] = Field(default_factory=dict)
    reader: ReadReport | None = None
    findings: tuple[FindingRecord, ...] = ()
    status: Status = "finished"
    updated: str | None = None
    failure: str | None = None

    def by_mode(self) -> Mapping[str, TrajectoryRecord]:
        """The first trajectory of each mode, by the name of the mode."""
        first: dict[str, TrajectoryRecord] = {}
        for trajectory in self.estimators.values():
            first.setdefault(trajectory.mode, trajectory)
        return first

    def events(self) -> Iterable[tuple[str, EventRecord]]:
        """Mode and event of everything that happened, each once though a mode has several trajectories."""
        for mode, trajectory in self.by_mode().items():
            for event in trajectory.events:
                yield mode, event


def union(one: Interval | None, other: Interval | None) -> Interval | None:
    """The shortest interval that holds both."""
    if one is None or other is None:
        return one or other
    return min(one[0], other[0]), max(one[1], other[1])

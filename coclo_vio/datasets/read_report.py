# SPDX-License-Identifier: BSD-3-Clause
"""The report on a recording: samples, rates, gaps, defective stamps, and what was left out and why."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from coclo_vio.values.arrays import has_nan
from coclo_vio.values.measurements import (
    BodyTwistSample,
    CameraImuSample,
    FootForceSample,
    ImuSample,
    JointSample,
    Measurement,
    StereoFrame,
    StereoTracks,
)
from coclo_vio.values.units import NS_PER_S

_STEPS_FOR_MEDIAN = 32  # the median step of a stream is taken from its first steps
_GAP_STEPS = 2.5  # a pause of fewer median steps is not a gap, however slow the sensor
STREAM_NAMES: Mapping[type, str] = {
    FootForceSample: "foot_force",
    ImuSample: "imu",
    JointSample: "joints",
    CameraImuSample: "camera_imu",
    StereoFrame: "stereo",
    StereoTracks: "stereo_tracks",
    BodyTwistSample: "body_twist",
}


@dataclass(frozen=True, slots=True)
class StreamReport:
    """The samples of one sensor, as passed on.

    Attributes:
        name: one of ``STREAM_NAMES``.
        samples: number of samples passed on.
        rate_hz: samples per second outside the gaps; 0 for fewer than two samples.
        start_ns: the earliest stamp.
        end_ns: the latest stamp.
        gaps: number of pauses longer than ``DatasetConfig.gap_s`` and than 2.5 of the stream's median steps.
        longest_gap_s: the longest pause between two samples, s.
        longest_gap_start_ns: the stamp before it.
        repeated_stamps: samples with the stamp of the one before.
        backward_stamps: samples older than the one before.
        samples_with_nan: samples in which a position or force is NaN.
    """

    name: str
    samples: int
    rate_hz: float
    start_ns: int
    end_ns: int
    gaps: int
    longest_gap_s: float
    longest_gap_start_ns: int
    repeated_stamps: int
    backward_stamps: int
    samples_with_nan: int

    @property
    def duration_s(self) -> float:
        """Seconds from the earliest stamp to the latest."""
        return (self.end_ns - self.start_ns) / NS_PER_S


@dataclass(frozen=True, slots=True)
class ReadReport:
    """What a reader found in a recording.

    Attributes:
        format: the name of the recording's format.
        streams: one entry for each sensor that has samples.
        dropped: number of rows or messages left out, by reason (``<file, topic or stream>: <reason>``).
        notes: sentences for the user on what was estimated, assumed, or not read.
    """

    format: str
    streams: tuple[StreamReport, ...]
    dropped: Mapping[str, int]
    notes: tuple[str, ...]

    def stream(self, name: str) -> StreamReport | None:
        """The stream called ``name``, or None where it has no sample."""
        return next((stream for stream in self.streams if stream.name == name), None)


@dataclass(slots=True)
class StreamTally:
    """Counts the stamps of one sensor in constant memory.

    The median of its first steps sets how long a gap is.
    """

    gap_ns: int
    samples: int = 0
    first_ns: int = 0
    last_ns: int = 0
    previous_ns: int = 0
    gaps: int = 0
    longest_ns: int = 0
    longest_start_ns: int = 0
    repeated: int = 0
    backward: int = 0
    with_nan: int = 0
    _steady_ns: int = 0
    _steady_steps: int = 0
    _first_steps_ns: list[int] = field(default_factory=list)
    _longest_steady_ns: float | None = None

    def add(self, stamp_ns: int, *, has_nan: bool) -> None:
        """Count one sample."""
        self.with_nan += has_nan
        if self.samples == 0:
            self.first_ns = self.last_ns = stamp_ns
        else:
            self._add_step(stamp_ns)
        self.first_ns, self.last_ns = min(self.first_ns, stamp_ns), max(self.last_ns, stamp_ns)
        self.previous_ns = stamp_ns
        self.samples += 1

    def _add_step(self, stamp_ns: int) -> None:
        step_ns = stamp_ns - self.previous_ns
        if step_ns > self.longest_ns:
            self.longest_ns, self.longest_start_ns = step_ns, self.previous_ns
        if step_ns == 0:
            self.repeated += 1
        elif step_ns < 0:
            self.backward += 1
        elif self._longest_steady_ns is not None:
            self._count_step(step_ns, self._longest_steady_ns)
        else:
            self._first_steps_ns.append(step_ns)
            if len(self._first_steps_ns) == _STEPS_FOR_MEDIAN:
                self._set_gap_length()

    def _set_gap_length(self) -> None:
        """Set the length of a gap from the median of the first steps, and count the gaps among them."""
        if self._longest_steady_ns is not None or not self._first_steps_ns:
            return
        median_ns = sorted(self._first_steps_ns)[(len(self._first_steps_ns) - 1) // 2]
        self._longest_steady_ns = max(self.gap_ns, _GAP_STEPS * median_ns)
        for step_ns in self._first_steps_ns:
            self._count_step(step_ns, self._longest_steady_ns)
        self._first_steps_ns.clear()

    def _count_step(self, step_ns: int, longest_steady_ns: float) -> None:
        if step_ns > longest_steady_ns:
            self.gaps += 1
        else:
            self._steady_ns += step_ns
            self._steady_steps += 1

    def report(self, name: str) -> StreamReport:
        """The counts as a value."""
        self._set_gap_length()
        rate_hz = self._steady_steps * NS_PER_S / self._steady_ns if self._steady_ns else 0.0
        return StreamReport(
            name,
            self.samples,
            rate_hz,
            self.first_ns,
            self.last_ns,
            self.gaps,
            self.longest_ns / NS_PER_S,
            self.longest_start_ns,
            self.repeated,
            self.backward,
            self.with_nan,
        )


@dataclass(slots=True)
class ReadTally:
    """Collects a ``ReadReport`` while a recording is read.

    Attributes:
        format: the name of the format.
        gap_s: a longer pause counts as a gap, s.
        dropped: number of rows left out, by reason.
        notes: sentences without repetition, in order.
    """

    format: str
    gap_s: float
    dropped: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)
    _streams: dict[str, StreamTally] = field(default_factory=dict)

    def note(self, sentence: str) -> None:
        """Add a sentence to the report."""
        if sentence not in self.notes:
            self.notes.append(sentence)

    def watch(self, measurements: Iterable[Measurement]) -> Iterator[Measurement]:
        """The same measurements, each counted."""
        for sample in measurements:
            self.count(type(sample), sample.stamp_ns, has_nan=_has_nan(sample))
            yield sample

    def count(self, kind: type, stamp_ns: int, *, has_nan: bool = False) -> None:
        """Count one sample of a sensor by its stamp; an image need not be decoded for that."""
        name = STREAM_NAMES[kind]
        tally = self._streams.get(name)
        if tally is None:
            tally = self._streams[name] = StreamTally(round(self.gap_s * NS_PER_S))
        tally.add(stamp_ns, has_nan=has_nan)

    def report(self) -> ReadReport:
        """The report on what was counted so far."""
        streams = tuple(tally.report(name) for name, tally in sorted(self._streams.items()))
        return ReadReport(self.format, streams, dict(self.dropped), tuple(self.notes))


def _has_nan(sample: Measurement) -> bool:
    match sample:
        case JointSample():
            return has_nan(sample.position)
        case FootForceSample():
            return has_nan(sample.force)
        case _:
            return False

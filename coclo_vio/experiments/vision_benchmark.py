# SPDX-License-Identifier: BSD-3-Clause
"""Speed of vision: front end and smoother on the bundled sample, frame by frame; and their memory.

Milliseconds are of processor time: those of one core if ``OPENBLAS_NUM_THREADS=1`` is set before Python starts.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from time import process_time
from typing import TypeVar

import numpy as np

from coclo_vio.backend.window.inertial_source import InertialSource
from coclo_vio.backend.window.smoother import SlidingWindowSmoother
from coclo_vio.datasets.dataset import Dataset, open_dataset
from coclo_vio.datasets.sample import sample_path
from coclo_vio.experiments.resident_memory import resident_mb
from coclo_vio.frontend.frontend import StereoFrontend
from coclo_vio.fusion.visual_odometry import VisualOdometry
from coclo_vio.runs.equipment import Equipment
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.arrays import Array, ByteImage
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.keyframes import FrameResult, OdometryDelta, PoseEvidence, PoseMarginal
from coclo_vio.values.measurements import (
    BodyTwistSample,
    CameraImuSample,
    InertialReading,
    Measurement,
    StereoFrame,
    StereoTracks,
)
from coclo_vio.values.outputs import KeyframeHealth
from coclo_vio.values.units import MS_PER_S, NS_PER_S

_SENSORS: frozenset[type] = frozenset({CameraImuSample, StereoFrame})
_MEMORY_S = 15.0  # of the sample, its images decoded and kept, where memory is measured
_T = TypeVar("_T")


class Stopwatch:
    """Adds up the processor time of what is run under it, s."""

    def __init__(self) -> None:
        self.taken_s = 0.0

    def time(self, run: Callable[[], _T]) -> _T:
        """The result of ``run``."""
        began_s = process_time()
        try:
            return run()
        finally:
            self.taken_s += process_time() - began_s

    def read(self) -> float:
        """The seconds since the last reading."""
        taken_s, self.taken_s = self.taken_s, 0.0
        return taken_s


class TimedFrontend:
    """A front end under a stopwatch."""

    def __init__(self, frontend: StereoFrontend) -> None:
        self._frontend = frontend
        self.rig: RectifiedStereo = frontend.rig
        self.watch = Stopwatch()

    def track(self, frame: StereoFrame, T_previous_current: Array | None = None) -> StereoTracks:
        """The tracks of a frame."""
        return self.watch.time(lambda: self._frontend.track(frame, T_previous_current))

    def overlay(self) -> ByteImage:
        """The last frame with its tracks drawn on it."""
        return self._frontend.overlay()

    @property
    def counts(self) -> Mapping[str, int]:
        """How often each thing happened."""
        return self._frontend.counts


class TimedSmoother:
    """A smoother under a stopwatch, its IMU readings included."""

    def __init__(self, smoother: SlidingWindowSmoother) -> None:
        self._smoother = smoother
        self.watch = Stopwatch()

    @property
    def latest_pose(self) -> Array | None:
        """``T_world_body`` of the last frame."""
        return self._smoother.latest_pose

    @property
    def keyframe_ns(self) -> int | None:
        """Stamp of the last keyframe."""
        return self._smoother.keyframe_ns

    @property
    def counts(self) -> Mapping[str, int]:
        """How often each thing happened."""
        return self._smoother.counts

    def push_imu(self, sample: InertialReading) -> None:
        """Take a reading."""
        self.watch.time(lambda: self._smoother.push_imu(sample))

    def push_twist(self, sample: BodyTwistSample) -> None:
        """Take a twist."""
        self.watch.time(lambda: self._smoother.push_twist(sample))

    def predicted_pose(self, stamp_ns: int) -> Array | None:
        """``T_world_body`` expected at a stamp."""
        return self.watch.time(lambda: self._smoother.predicted_pose(stamp_ns))

    def start_from(self, marginal: PoseMarginal, velocity: tuple[Array, float] | None = None) -> None:
        """Start with the frame of this stamp."""
        self._smoother.start_from(marginal, velocity)

    def begin_anew(self, detail: str, late_s: float) -> None:
        """Begin a window with the next frame."""
        self._smoother.begin_anew(detail, late_s)

    def push_tracks(
        self, tracks: StereoTracks, odometry: OdometryDelta | None = None, evidence: PoseEvidence | None = None
    ) -> FrameResult:
        """The result of a frame."""
        return self.watch.time(lambda: self._smoother.push_tracks(tracks, odometry, evidence))


def vision_figures(until_s: float = 15.0, rounds: int = 1) -> dict[str, float | None]:
    """The figures of ``vins`` on the bundled sample (stereo 640 x 480 at 7.5 Hz), by name.

    ``frontend_ms_*`` are per frame, ``smoother_ms_*`` per keyframe with all readings since the frame before,
    ``vision_ms_per_frame`` is the mean of both together, ``vision_ms_p95`` their 95th percentile; figures of a keyframe
    (tracks, factors, landmarks, iterations of the solver) are medians. None where there was no keyframe.

    Args:
        until_s: seconds of the sample.
        rounds: repetitions; the fastest of each figure counts.
    """
    figures = [_timed(until_s) for _ in range(rounds)]
    return {name: _least(of_round[name] for of_round in figures) for name in figures[0]}


def vision_resident_mb(frames: int, samples: int = 10) -> tuple[float, ...]:
    """Memory of this process (MiB) at even distances over so many frames through ``vins``, the first at their start.

    The sample's first 15 s are processed forwards and backwards in turn, so that the world never jumps: backwards in
    time rates change their sign and specific forces do not.

    Raises:
        DatasetError: the system does not report the memory of a process (Linux does, in /proc).
    """
    dataset, odometry, _, _ = _stages()
    recorded = tuple(_beginning(dataset, _MEMORY_S))
    due = [round(frames * number / samples) for number in range(samples + 1)]
    held: list[float] = []
    frames_done = 0
    for measurement in _to_and_fro(recorded):
        odometry.push(measurement)
        frames_done += isinstance(measurement, StereoFrame)
        if frames_done > due[len(held)]:
            held.append(resident_mb())
            if len(held) > samples:
                break
    return tuple(held)


def _stages() -> tuple[Dataset, VisualOdometry, TimedFrontend, TimedSmoother]:
    config = RunConfig()
    dataset = open_dataset(sample_path(), None)
    equipment = Equipment.of(dataset, config, _SENSORS)
    _, imu = equipment.require_vision_imu()
    frontend = TimedFrontend(StereoFrontend(equipment.require_cameras(), config.frontend))
    sources = [InertialSource(imu, config.smoother)]
    smoother = TimedSmoother(SlidingWindowSmoother(frontend.rig, config.smoother, imu, sources))
    return dataset, VisualOdometry("vins", smoother, frontend, imu_kind=CameraImuSample), frontend, smoother


def _timed(until_s: float) -> dict[str, float | None]:
    """One pass over the sample; images are decoded beside the clock."""
    dataset, odometry, frontend, smoother = _stages()
    frontend_ms, smoother_ms, is_keyframe = [], [], []
    keyframes: list[KeyframeHealth] = []
    for measurement in _beginning(dataset, until_s):
        outputs = odometry.push(measurement)
        if isinstance(measurement, StereoFrame):
            health = [output for output in outputs if isinstance(output, KeyframeHealth)]
            keyframes += health
            frontend_ms.append(frontend.watch.read() * MS_PER_S)
            smoother_ms.append(smoother.watch.read() * MS_PER_S)
            is_keyframe.append(bool(health))
    front, window = np.array(frontend_ms), np.array(smoother_ms)
    at_keyframes = window[np.array(is_keyframe, dtype=np.bool_)]
    return {
        "frontend_ms_median": _share(front, 50.0),
        "frontend_ms_p95": _share(front, 95.0),
        "smoother_ms_median": _share(at_keyframes, 50.0),
        "smoother_ms_p95": _share(at_keyframes, 95.0),
        "vision_ms_per_frame": float((front + window).mean()) if len(front) else None,
        "vision_ms_p95": _share(front + window, 95.0),
        "keyframes_per_frame": len(keyframes) / len(front) if len(front) else None,
        **{
            f"keyframe_{name}": _share(np.array([getattr(keyframe, name) for keyframe in keyframes]), 50.0)
            for name in ("tracks", "factors", "landmarks", "iterations")
        },
    }


def _beginning(dataset: Dataset, until_s: float) -> Iterator[Measurement]:
    """The measurements of the first seconds."""
    end_ns: float | None = None
    for measurement in dataset.measurements(_SENSORS):
        end_ns = measurement.stamp_ns + until_s * NS_PER_S if end_ns is None else end_ns
        if measurement.stamp_ns > end_ns:
            return
        yield measurement


def _share(values: Array, share: float) -> float | None:
    return float(np.percentile(values, share)) if len(values) else None


def _least(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return min(known) if known else None


def _to_and_fro(recorded: tuple[Measurement, ...]) -> Iterator[Measurement]:
    """The measurements forwards and backwards for ever, with stamps that go on."""
    first_ns, last_ns = recorded[0].stamp_ns, recorded[-1].stamp_ns
    begin_ns = first_ns
    while True:
        for measurement in recorded[1:]:
            yield replace(measurement, stamp_ns=begin_ns + measurement.stamp_ns - first_ns)
        begin_ns += last_ns - first_ns
        for measurement in recorded[-2::-1]:
            yield _turned(measurement, begin_ns + last_ns - measurement.stamp_ns)
        begin_ns += last_ns - first_ns


def _turned(measurement: Measurement, stamp_ns: int) -> Measurement:
    if isinstance(measurement, InertialReading):
        return replace(measurement, stamp_ns=stamp_ns, angular_velocity=-measurement.angular_velocity)
    return replace(measurement, stamp_ns=stamp_ns)

# SPDX-License-Identifier: BSD-3-Clause
"""An estimator fed by another process at the pace of a recording's stamps, and the times that it takes.

Where the estimator falls behind, images are left out before they reach it, and joint samples where that does not
suffice; every other measurement is pushed.
"""

import gc
import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from coclo_vio.fusion.child_process import ChildProcess
from coclo_vio.fusion.combined_beside import CombinedBeside
from coclo_vio.fusion.overload import ImageOverload, JointOverload
from coclo_vio.fusion.shared_images import SharedFrame, SharedImages
from coclo_vio.online.guarded_estimator import GuardedEstimator
from coclo_vio.runs.latency import LatencyRecord
from coclo_vio.runs.paced_source import Due, Ended, Pace, serve_recording
from coclo_vio.runs.pipeline import Spanning
from coclo_vio.runs.play_times import PlayTimes
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.calibration import StereoCalibration
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.measurements import JointSample, Measurement, StereoFrame, StereoTracks
from coclo_vio.values.outputs import Estimate, Estimator, Output
from coclo_vio.values.units import NS_PER_S

MAX_LAG_S = 0.2
"""An image that has waited for longer when its turn comes is left out."""

_FAR_BEHIND, _KEPT_PACE = 2.0, 0.5  # times that lag: joint samples are thinned from there, and no longer below
_ONE_OF = (2, 4, 8)  # joint samples is used, the further behind the estimator is
_SLOTS = 8  # images on their way from the source
_MOST_WAITING = 4096  # measurements here; further ones wait in the source
_LOOK_S = 0.5


class PacedFeed:
    """Plays a recording to an estimator, and keeps the times.

    Attributes:
        pace: what is played, and how fast.
        interval_s: length of an interval of ``LatencyRecord.intervals``.
    """

    def __init__(self, pace: Pace, *, interval_s: float = 1.0, max_lag_s: float = MAX_LAG_S) -> None:
        """Take the pace; ``max_lag_s``: an image that has waited for longer is left out."""
        self.pace, self.interval_s = pace, interval_s
        self._max_lag_ns = round(max_lag_s * NS_PER_S)
        self._times: PlayTimes | None = None

    @contextmanager
    def open(
        self,
        estimator: Estimator,
        path: Path,
        config: RunConfig,
        sensors: frozenset[type],
        stereo: StereoCalibration | None,
    ) -> Iterator[tuple[Estimator, Iterator[Measurement]]]:
        """The estimator with its times taken, and the measurements as they come; the source ends with the context.

        Args:
            estimator: a fresh one.
            path: of the recording.
            config: that it is read with.
            sensors: that the estimator uses.
            stereo: the cameras, whose images go through shared memory; None: they are pickled.
        """
        memory = _memory_for(stereo) if StereoFrame in sensors else None
        shared = None if memory is None else (memory.image_bytes, memory.slots, memory.descriptor)
        source = ChildProcess(
            serve_recording,
            path,
            config,
            sensors,
            self.pace,
            shared,
            descriptors=() if memory is None else (memory.descriptor,),
        )
        try:
            beside = _beside(estimator)
            if beside is not None:
                beside.prepare()
            self._times = times = PlayTimes(self.interval_s, self.pace.rate, _processes(estimator, source))
            gc.collect()
            gc.freeze()  # what is loaded by now is never looked through again
            yield _Timed(estimator, times, self._max_lag_ns), _received(source, memory, times)
        finally:
            gc.unfreeze()
            source.end(0.5)

    def record(self, mode: str, config: RunConfig) -> LatencyRecord:
        """The times of what was played last.

        Args:
            mode: its name.
            config: that it was made with.

        Raises:
            DatasetError: nothing has been played.
        """
        if self._times is None:
            raise DatasetError("nothing was played: the recording or the mode was refused before")
        return self._times.record(mode, config.bridge.vision)


def _memory_for(stereo: StereoCalibration | None) -> SharedImages | None:
    if stereo is None:
        return None
    return SharedImages(max(camera.width_px * camera.height_px for camera in (stereo.left, stereo.right)), _SLOTS)


def _processes(estimator: Estimator, source: ChildProcess) -> Mapping[str, Callable[[], int | None]]:
    """The numbers of the processes that take part, by name."""
    processes: dict[str, Callable[[], int | None]] = {"estimator": os.getpid, "source": lambda: source.pid}
    if _beside(estimator) is not None:
        processes["vision"] = lambda: None if (beside := _beside(estimator)) is None else beside.vision_pid
    return processes


def _beside(estimator: Estimator) -> CombinedBeside | None:
    """The estimator with a process of vision, itself or behind the guard."""
    inner = estimator.estimator if isinstance(estimator, GuardedEstimator) else estimator
    return inner if isinstance(inner, CombinedBeside) else None


def _received(source: ChildProcess, memory: SharedImages | None, times: PlayTimes) -> Iterator[Measurement]:
    """The measurements in order, from the source's first on."""
    waiting: deque[tuple[int, Measurement]] = deque()
    ended: Ended | None = None
    try:
        source.connection.send("begin")
        while True:
            while (
                ended is None
                and len(waiting) < _MOST_WAITING
                and not (waiting and waiting[0][0] == times.due_ns)  # the rest of a message first
                and source.has_message(0.0 if waiting else _LOOK_S)
            ):
                message: Due | Ended = source.connection.recv()
                if isinstance(message, Ended):
                    ended = message
                    break
                for measurement in message.measurements:
                    if isinstance(measurement, SharedFrame):
                        assert memory is not None, "the source writes where there is memory only"
                        measurement = memory.read(measurement)  # noqa: PLW2901
                    waiting.append((message.due_ns, measurement))
            if not waiting and ended is not None:
                break
            if waiting:
                times.waiting(len(waiting))
                times.due_ns, measurement = waiting.popleft()
                yield measurement
    except (EOFError, OSError) as error:
        raise DatasetError(
            f"the process that reads the recording has ended (status {source.status}); play it again"
        ) from error
    if ended is not None and ended.error is not None:
        raise ended.error


class _Timed:
    """An estimator whose pushes and outputs are timed, and which gets no image that is too late."""

    def __init__(self, estimator: Estimator, times: PlayTimes, max_lag_ns: int) -> None:
        self._estimator, self._times, self._max_lag_ns = estimator, times, max_lag_ns
        self._spanning = estimator if isinstance(estimator, Spanning) else None  # a protocol is slow to look up
        self._overload = ImageOverload("the estimator does not keep pace with the measurements")
        self._joint_overload = JointOverload("the estimator does not keep pace with the measurements")
        self._joints_since_used: int | None = None  # while joint samples are thinned

    @property
    def counts(self) -> Mapping[str, int]:
        """What the estimator counted, and images left out before."""
        left_out = {"image_left_out": self._times.images_left_out, "joints_left_out": self._times.joints_left_out}
        return {**self._estimator.counts, **{name: count for name, count in left_out.items() if count}}

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Earliest and latest stamp of the samples that the estimator used; None where it does not say."""
        return None if self._spanning is None else self._spanning.span_ns

    def push(self, measurement: Measurement) -> Sequence[Output]:
        """Push a measurement, unless it is an image that is too late, or a joint sample of too many."""
        began_ns, due_ns = time.monotonic_ns(), self._times.due_ns
        cpu_ns = time.thread_time_ns()
        outputs: list[Output] = []
        if isinstance(measurement, StereoFrame | StereoTracks):
            if began_ns - due_ns > self._max_lag_ns:
                self._times.leave_out()
                return self._overload.leave_out(measurement.stamp_ns)
            outputs += self._overload.take(measurement.stamp_ns)
        elif isinstance(measurement, JointSample):
            if self._is_thinned(began_ns - due_ns):
                self._times.leave_out_joints()
                return self._joint_overload.leave_out(measurement.stamp_ns)
            outputs += self._joint_overload.take(measurement.stamp_ns)
        for output in self._estimator.push(measurement):
            if isinstance(output, Estimate):
                self._times.estimate(output.name, output.state.stamp_ns)
            outputs.append(output)
        self._times.pushed(measurement, began_ns, time.thread_time_ns() - cpu_ns)
        return outputs

    def _is_thinned(self, lag_ns: int) -> bool:
        """Whether a joint sample is left out: one of two, or more of them the further behind the estimator is."""
        if lag_ns < _KEPT_PACE * self._max_lag_ns:
            self._joints_since_used = None
        elif self._joints_since_used is None and lag_ns > _FAR_BEHIND * self._max_lag_ns:
            self._joints_since_used = 0
        if self._joints_since_used is None:
            return False
        one_of = next((each for each in _ONE_OF if lag_ns < each * _FAR_BEHIND * self._max_lag_ns), _ONE_OF[-1])
        self._joints_since_used = (self._joints_since_used + 1) % one_of
        return self._joints_since_used != 0

    def finish(self) -> Iterator[Output]:
        """What the estimator holds back."""
        for output in self._estimator.finish():
            if isinstance(output, Estimate):
                self._times.estimate(output.name, output.state.stamp_ns)
            yield output
        self._times.end_interval(time.monotonic_ns())

# SPDX-License-Identifier: BSD-3-Clause
"""One mode over a recording into a run folder: from the beginning, or on from its checkpoint."""

import logging
import struct
import zlib
from collections.abc import Iterable, Iterator
from contextlib import nullcontext, suppress
from dataclasses import dataclass

from coclo_vio.runs import pipeline
from coclo_vio.runs.checkpoint import Checkpoints, Position
from coclo_vio.runs.modes.mode import Mode
from coclo_vio.runs.observers import Observers
from coclo_vio.runs.recorder import OutputRecorder, RecorderState
from coclo_vio.runs.recording_view import seen
from coclo_vio.runs.run_journal import Progressed, RunJournal
from coclo_vio.runs.run_source import RunSource
from coclo_vio.runs.stop_request import StopRequest
from coclo_vio.values.errors import DatasetError, interrupt_in
from coclo_vio.values.measurements import Measurement
from coclo_vio.values.object_fields import CheckpointPostponed, CheckpointUnsupported
from coclo_vio.values.outputs import Estimator, Output
from coclo_vio.values.units import NS_PER_S

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class PreparedMode:
    """A mode that can run.

    Attributes:
        mode: which.
        estimator: a fresh one.
        sensors: what it reads of the recording.
        leg_names: of the robot whose legs it follows.
        checkpoint_s: seconds of recording between two checkpoints; 0 for none.
    """

    mode: Mode
    estimator: Estimator
    sensors: frozenset[type]
    leg_names: tuple[str, ...]
    checkpoint_s: float


class ModeRun:
    """One mode that runs: what it has read, its files, its record and its checkpoints."""

    def __init__(
        self,
        ready: PreparedMode,
        journal: RunJournal,
        observers: Observers,
        stop: StopRequest | None,
        *,
        resumes: bool,
    ) -> None:
        """Open the files.

        Args:
            ready: the mode.
            journal: of the run.
            observers: of the run.
            stop: asked before each measurement whether to stop; None: nobody stops it.
            resumes: go on from the checkpoint, if there is one; from the beginning otherwise.

        Raises:
            DatasetError: the checkpoint is of another version or configuration, or files have lost lines since.
            OSError: a file cannot be written.
        """
        self._ready, self._journal, self._observers, self._stop = ready, journal, observers, stop
        self._spanning = ready.estimator if isinstance(ready.estimator, pipeline.Spanning) else None
        self._tally = pipeline.Tally()
        self._checkpoints = Checkpoints(journal.folder, ready.mode.name, ready.estimator)
        self._may_save = ready.checkpoint_s > 0.0
        self._next_ns: int | None = None
        self._now_ns = 0  # of the newest measurement
        self._checksum = self._taken_checksum = 0  # of what was read, and of what the estimator has taken
        self._skip: Position | None = None
        state = RecorderState()
        self._resumed_ns: tuple[int, ...] = ()
        found = self._checkpoints.load() if resumes else None
        if found is not None:
            self._skip, others = found
            self._tally, state, self._resumed_ns = others["tally"], others["recorder"], others["resumed_ns"]
            self._next_ns, self._taken_checksum = others["next_ns"], self._skip.checksum
            self._resumed_ns += (self._skip.stamp_ns,)
            self._now_ns = self._skip.stamp_ns
        elif not resumes:
            self._checkpoints.forget()
        self._recorder = OutputRecorder(journal.folder, ready.mode, ready.leg_names, state)

    def run(self, source: RunSource) -> None:
        """Run it to its end, or until it is asked to stop; what it comes to is kept in the journal.

        Raises:
            OSError: a file cannot be written.
            DatasetError: the recording is not the one that the checkpoint was made with.
        """
        ready, stop, view = self._ready, self._stop, self._observers.view
        with self._recorder:
            self._journal.update(self._progressed())
            try:
                with (
                    source.opened(ready.estimator, ready.sensors) as (estimator, measurements),
                    nullcontext() if stop is None else stop.polled(),
                ):
                    left = self._counted(measurements)
                    summary = pipeline.run(
                        estimator,
                        left if view is None else seen(left, view),
                        self._take,
                        self._advance,
                        tally=self._tally,
                        stop=self._is_to_stop,
                        keep=self._keep,
                    )
            except BaseException as error:
                with suppress(OSError):
                    self._journal.update(self._progressed())
                interrupt = interrupt_in(error)
                if interrupt is None or interrupt is error:
                    raise
                raise interrupt from error
        records = self._recorder.records(summary, ready.sensors, resumed_ns=self._resumed_ns)
        self._journal.update((summary.recording_ns, records))
        if not summary.is_stopped:
            self._checkpoints.forget()

    def _counted(self, source: Iterable[Measurement]) -> Iterator[Measurement]:
        """The measurements after those that were taken before the checkpoint."""
        skip = self._skip
        for number, measurement in enumerate(source, 1):
            kind = type(measurement).__name__.encode("ascii")
            self._checksum = zlib.crc32(struct.pack("<q", measurement.stamp_ns) + kind, self._checksum)
            if skip is None or number > skip.measurements:
                yield measurement
            elif number == skip.measurements and self._checksum != skip.checksum:
                raise DatasetError(
                    f"the first {number} measurements are not those that the run was checkpointed with: the recording "
                    "has changed; begin anew with --overwrite"
                )

    def _is_to_stop(self) -> bool:
        stop = self._stop
        if stop is None or not stop():
            return False
        if self._tally.measurements and self._next_ns is not None:
            self._save()
        return True

    def _advance(self, stamp_ns: int) -> None:
        """After a measurement: the journal, a checkpoint where one is due, the progress."""
        self._taken_checksum = self._checksum
        interval_ns = round(self._ready.checkpoint_s * NS_PER_S)
        now_ns = self._now_ns = self._never_stepped(stamp_ns)
        if self._next_ns is None:
            self._next_ns = now_ns + interval_ns
        elif self._may_save and now_ns >= self._next_ns:
            self._next_ns += interval_ns * (1 + (now_ns - self._next_ns) // interval_ns)
            self._save()
        self._journal.tick(self._progressed)
        self._observers.advance(self._ready.mode.name, stamp_ns)

    def _never_stepped(self, stamp_ns: int) -> int:
        """A measurement's stamp, or where a clock stepped the newest that the estimator got, by one that never does."""
        span_ns = None if self._spanning is None else self._spanning.span_ns
        return stamp_ns if span_ns is None or abs(stamp_ns - span_ns[1]) <= NS_PER_S else span_ns[1]

    def _save(self) -> None:
        """Write a checkpoint of now."""
        if not self._may_save:
            return
        others = {
            "tally": self._tally,
            "recorder": self._recorder.state(),
            "resumed_ns": self._resumed_ns,
            "next_ns": self._next_ns,
        }
        try:
            self._checkpoints.save(Position(self._tally.measurements, self._now_ns, self._taken_checksum), others)
        except CheckpointPostponed as error:
            _log.info("%s: no checkpoint now, the one before stays (%s)", self._ready.mode.name, error)
        except CheckpointUnsupported as error:
            self._may_save = False
            _log.info("%s: no checkpoints, --resume begins this mode anew (%s)", self._ready.mode.name, error)

    def _keep(self, output: Output) -> None:
        if self._observers.keep(output):
            self._recorder.take(output)

    def _take(self, output: Output) -> None:
        self._observers.take(self._ready.mode.name, output)

    def _progressed(self) -> Progressed:
        summary = self._tally.summary_of(self._ready.estimator)
        records = self._recorder.records(summary, self._ready.sensors, is_running=True, resumed_ns=self._resumed_ns)
        return summary.recording_ns, records

# SPDX-License-Identifier: BSD-3-Clause
"""``run.json`` of a run that goes on: written at its start, about every second, and when it ends in whatever way."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path

from coclo_vio.runs import run_folder
from coclo_vio.runs.run_record import Interval, RunRecord, Status, TrajectoryRecord, union

_EVERY_S = 1.0
_PAUSES = 20.0  # times as long as a writing took until the next one: a record of many events takes 5 % of the time
Progressed = tuple[Interval | None, dict[str, TrajectoryRecord]]
"""The interval of what a mode has read so far, and the records of its trajectories."""


class RunJournal:
    """The record of a run, on the disk as it is here but for the last second.

    Attributes:
        folder: of the run.
        record: as written last.
    """

    def __init__(self, folder: Path, record: RunRecord, earlier: RunRecord | None = None) -> None:
        """Write the first record.

        Args:
            folder: of the run.
            record: without any mode.
            earlier: of the run that goes on; None for a new one.

        Raises:
            OSError: it cannot be written.
        """
        self.folder = folder
        self.record = record
        self._took_s = 0.0
        known = {} if earlier is None else {key: getattr(earlier, key) for key in ("estimators", "recording_ns")}
        self._write(record.model_copy(update={**known, "status": "running", "failure": None}))

    def has_ended(self, mode: str) -> bool:
        """Whether a mode has come to its end by itself, in this run or the one that goes on."""
        run = self.record.by_mode().get(mode)
        return run is not None and run.status in ("finished", "failed")

    def update(self, progressed: Progressed) -> None:
        """Write what a mode has come to.

        Raises:
            OSError: it cannot be written.
        """
        recording_ns, trajectories = progressed
        update = {
            "recording_ns": union(self.record.recording_ns, recording_ns),
            "estimators": {**self.record.estimators, **trajectories},
        }
        self._write(self.record.model_copy(update=update))

    def tick(self, progressed: Callable[[], Progressed]) -> None:
        """The same where the last writing was a second ago, or longer where it takes long.

        Raises:
            OSError: it cannot be written.
        """
        began_s = time.monotonic()
        if began_s - self._written_s >= _EVERY_S * max(1.0, _PAUSES * self._took_s):
            self.update(progressed())
            self._took_s = time.monotonic() - began_s

    def end(self, record: RunRecord, *, is_stopped: bool = False) -> RunRecord:
        """Write the last record: ``interrupted`` if it was, ``failed`` if all modes did, otherwise ``finished``.

        Raises:
            OSError: it cannot be written.
        """
        status = "interrupted" if is_stopped else _status(record.by_mode())
        self._write(record.model_copy(update={"status": status}))
        return self.record

    @contextmanager
    def kept_on_errors(self) -> Iterator[None]:
        """While the run goes on: an error or an interrupt is in the record before it is raised on."""
        try:
            yield
        except BaseException as error:
            self.abandon(error)
            raise

    def abandon(self, error: BaseException) -> None:
        """Write, if possible, that the run ended with an error or an interrupt."""
        is_failure = not isinstance(error, KeyboardInterrupt)
        status: Status = "failed" if is_failure else "interrupted"
        failure = f"{type(error).__name__}: {error}" if is_failure else None
        trajectories = {
            name: run if run.status != "running" else run.model_copy(update={"status": "interrupted"})
            for name, run in self.record.estimators.items()
        }
        update = {"status": status, "failure": failure, "estimators": trajectories}
        with suppress(OSError):  # the disk may be full; then the last record stays
            self._write(self.record.model_copy(update=update))

    def _write(self, record: RunRecord) -> None:
        now = datetime.now(UTC).isoformat(timespec="seconds")
        self.record = record.model_copy(update={"updated": now})
        run_folder.write_record(self.folder, self.record)
        self._written_s = time.monotonic()


def _status(by_mode: Mapping[str, TrajectoryRecord]) -> Status:
    statuses = {run.status for run in by_mode.values()}
    if "interrupted" in statuses:
        return "interrupted"
    return "failed" if statuses == {"failed"} else "finished"

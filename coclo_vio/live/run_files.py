# SPDX-License-Identifier: BSD-3-Clause
"""The run folder of a run on a wire: as that of ``coclo-vio run``, and ``live.json`` beside it.

While it runs, ``run.json`` says so; what a kill leaves can be read.
"""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

from coclo_vio import __version__
from coclo_vio.live.live_record import LIVE_JSON, LiveRecord
from coclo_vio.live.preparation import Prepared
from coclo_vio.runs import run_folder
from coclo_vio.runs.modes.mode import Mode
from coclo_vio.runs.pipeline import RunSummary, Tally
from coclo_vio.runs.recorder import OutputRecorder
from coclo_vio.runs.run_journal import Progressed, RunJournal
from coclo_vio.runs.run_record import RunRecord
from coclo_vio.values.config import write_yaml
from coclo_vio.values.outputs import Output


class RunFiles:
    """Writes the files of one run; they are complete after ``finish``.

    Attributes:
        tally: counts what goes into the estimator and comes out.
    """

    def __init__(self, folder: Path, mode: Mode, prepared: Prepared, source: str) -> None:
        """Begin the folder.

        Args:
            folder: made if needed; what an earlier run wrote into it is removed.
            mode: that runs.
            prepared: its configuration and sensors.
            source: name of the wire.

        Raises:
            DatasetError: the folder cannot be written.
        """
        run_folder.clear(run_folder.prepare(folder))
        self._folder, self._prepared, self.tally = folder, prepared, Tally()
        robot = prepared.config.robot
        record = RunRecord(
            version=__version__,
            dataset=source,
            robot=None if robot is None else robot.name,
            imu_calibration="recording",
            ground_truth=None,
            faults=None,
        )
        with run_folder.writing(folder):
            write_yaml(prepared.config, folder / "config.yaml")
            self._recorder = OutputRecorder(folder, mode, prepared.leg_names)
            self._journal = RunJournal(folder, record)
            self._journal.update(self._progressed())

    def take(self, output: Output) -> None:
        """Write one output.

        Raises:
            DatasetError: a file cannot be written.
        """
        with run_folder.writing(self._folder):
            self._recorder.take(output)

    def write_live(self, record: LiveRecord) -> None:
        """Write ``live.json`` as it is now.

        Raises:
            DatasetError: it cannot be written.
        """
        with run_folder.writing(self._folder):
            record.write(self._folder / LIVE_JSON)

    def advance(self) -> None:
        """Write ``run.json`` as it is now, where the last writing was a second ago.

        Raises:
            DatasetError: it cannot be written.
        """
        with run_folder.writing(self._folder):
            self._journal.tick(self._progressed)

    def finish(self, summary: RunSummary, *, is_stopped: bool) -> RunRecord:
        """Write ``run.json`` of a run that is over.

        Args:
            summary: how it went.
            is_stopped: whether a signal ended it.

        Raises:
            DatasetError: it cannot be written.
        """
        records = self._recorder.records(replace(summary, is_stopped=is_stopped), self._prepared.sensors)
        with run_folder.writing(self._folder):
            self._recorder.flush()
            self._journal.update((summary.recording_ns, records))
            record = self._journal.record.model_copy(update={"reader": self._prepared.tally.report()})
            return self._journal.end(record, is_stopped=is_stopped)

    def _progressed(self) -> Progressed:
        summary = self.tally.summary_of(self._prepared.estimator)
        return summary.recording_ns, self._recorder.records(summary, self._prepared.sensors, is_running=True)

    def __enter__(self) -> Self:
        self._recorder.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        try:
            self._recorder.__exit__(kind, error, traceback)
        finally:
            if error is not None:
                with suppress(OSError):  # the disk may be full
                    self._journal.update(self._progressed())
                self._journal.abandon(error)

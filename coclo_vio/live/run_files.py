# SPDX-License-Identifier: BSD-3-Clause
"""The run folder of a run on a wire: as that of ``coclo-vio run``, and ``live.json`` beside it."""

from pathlib import Path
from types import TracebackType
from typing import Self

from coclo_vio import __version__
from coclo_vio.live.live_record import LIVE_JSON, LiveRecord
from coclo_vio.live.preparation import Prepared
from coclo_vio.runs import run_folder
from coclo_vio.runs.modes.mode import Mode
from coclo_vio.runs.pipeline import RunSummary
from coclo_vio.runs.recorder import OutputRecorder
from coclo_vio.runs.run_record import RunRecord
from coclo_vio.values.config import write_yaml
from coclo_vio.values.outputs import Output


class RunFiles:
    """Writes the files of one run; they are complete after ``finish``."""

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
        self._folder, self._prepared = folder, prepared
        robot = prepared.config.robot
        self._record = RunRecord(
            version=__version__,
            dataset=source,
            robot=None if robot is None else robot.name,
            imu_calibration="recording",
            ground_truth=None,
            faults=None,
        )
        with run_folder.writing(folder):
            write_yaml(prepared.config, folder / "config.yaml")
            run_folder.write_record(folder, self._record)
            self._recorder = OutputRecorder(folder, mode, prepared.leg_names)

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

    def finish(self, summary: RunSummary) -> RunRecord:
        """Write ``run.json`` of a run that is over.

        Raises:
            DatasetError: it cannot be written.
        """
        estimators = self._recorder.records(summary, self._prepared.sensors)
        update = {
            "estimators": estimators,
            "recording_ns": summary.recording_ns,
            "reader": self._prepared.tally.report(),
        }
        record = self._record.model_copy(update=update)
        with run_folder.writing(self._folder):
            run_folder.write_record(self._folder, record)
        return record

    def __enter__(self) -> Self:
        self._recorder.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._recorder.__exit__(kind, error, traceback)

# SPDX-License-Identifier: BSD-3-Clause
"""Writes the outputs of one mode into a run folder, each as it comes."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

from coclo_vio.datasets.read_report import STREAM_NAMES
from coclo_vio.runs.modes.mode import Mode
from coclo_vio.runs.output_logs import CalibrationWriter, KeyframeLogState, KeyframeWriter, PictureWriter
from coclo_vio.runs.pipeline import RunSummary
from coclo_vio.runs.run_record import (
    CalibrationRecord,
    ClockStepRecord,
    EventRecord,
    SlipRecord,
    Status,
    TrajectoryRecord,
)
from coclo_vio.runs.state_writer import StateWriter
from coclo_vio.values.errors import ConfigError, listing
from coclo_vio.values.outputs import Calibration, Estimate, KeyframeHealth, Output, Picture


@dataclass(frozen=True, slots=True)
class RecorderState:
    """How far the files of a mode are written; by default not at all.

    Attributes:
        sizes: bytes of poses and states, by trajectory.
        keyframes: of their file.
        calibration_size: bytes of the calibrations.
        calibration: the last one.
        pictures: how many.
    """

    sizes: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    keyframes: KeyframeLogState | None = None
    calibration_size: int = 0
    calibration: Calibration | None = None
    pictures: int = 0


class OutputRecorder:
    """One file or two for each kind of output and trajectory; events go into the record of the run."""

    def __init__(
        self, folder: Path, mode: Mode, leg_names: tuple[str, ...], state: RecorderState | None = None
    ) -> None:
        """Open the files.

        Args:
            folder: of the run.
            mode: whose outputs they are.
            leg_names: of the robot; contact probabilities go with the first trajectory.
            state: to go on from; None to begin.
        """
        self._mode = mode
        state = state or RecorderState()
        first = mode.trajectory_names[0]
        self._states = {
            name: StateWriter(folder, name, leg_names if name == first else (), state.sizes.get(name, (0, 0)))
            for name in mode.trajectory_names
        }
        self._keyframes = KeyframeWriter(folder, mode.trajectory_names[-1], state.keyframes)
        self._calibrations = CalibrationWriter(folder, first, state.calibration_size, state.calibration)
        self._pictures = PictureWriter(folder, mode.name, state.pictures)

    def state(self) -> RecorderState:
        """Everything written to the files now, and how far they are.

        Raises:
            OSError: it cannot be written.
        """
        self.flush()
        sizes = {name: writer.sizes for name, writer in self._states.items()}
        calibrations = self._calibrations
        return RecorderState(sizes, self._keyframes.state, calibrations.size, calibrations.last, self._pictures.written)

    def flush(self) -> None:
        """Hand everything to the operating system.

        Raises:
            OSError: it cannot be written.
        """
        for writer in self._states.values():
            writer.flush()

    def take(self, output: Output) -> None:
        """Write one output.

        Raises:
            ConfigError: an estimate of a trajectory that the mode does not declare.
        """
        match output:
            case Estimate():
                self._writer(output.name).write(output.state)
            case KeyframeHealth():
                self._keyframes.write(output)
            case Calibration():
                self._calibrations.write(output)
            case Picture():
                self._pictures.write(output)

    def records(
        self,
        summary: RunSummary,
        sensors: frozenset[type],
        *,
        is_running: bool = False,
        resumed_ns: tuple[int, ...] = (),
    ) -> dict[str, TrajectoryRecord]:
        """What ``run.json`` holds of the mode's trajectories, by name.

        Args:
            summary: of the run.
            sensors: that the mode read.
            is_running: whether it is not at its end.
            resumed_ns: stamps of the checkpoints that it went on from.
        """
        ended: Status = "failed" if summary.failure else "interrupted" if summary.is_stopped else "finished"
        start_ns = 0 if summary.recording_ns is None else summary.recording_ns[0]
        calibration = self._calibrations.last
        return {
            name: TrajectoryRecord(
                mode=self._mode.name,
                sensors=tuple(sorted(STREAM_NAMES[sensor] for sensor in sensors)),
                measurements=summary.measurements,
                estimates=summary.estimates.get(name, 0),
                compute_s=summary.compute_s,
                realtime_factor=summary.realtime_factor,
                counts=dict(summary.counts),
                events=tuple(EventRecord.of(event, start_ns) for event in summary.events),
                slips=SlipRecord.by_foot(summary.events),
                keyframes=self._keyframes.summary(),
                calibration=None if calibration is None else CalibrationRecord.of(calibration),
                pictures=self._pictures.written,
                recording_ns=None,
                failure=summary.failure,
                status="running" if is_running else ended,
                last_ns=summary.estimated_until_ns,
                resumed_ns=resumed_ns,
                clock_steps=ClockStepRecord.of_events(summary.events),
            )
            for name in self._mode.trajectory_names
        }

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        failures = []
        for close in (
            *(writer.close for writer in self._states.values()),
            self._keyframes.close,
            self._calibrations.close,
        ):
            try:
                close()
            except OSError as failure:  # a full disk: the others are closed all the same
                failures.append(failure)
        if failures and error is None:
            raise failures[0]

    def _writer(self, name: str) -> StateWriter:
        writer = self._states.get(name)
        if writer is None:
            raise ConfigError(
                f"the mode {self._mode.name} gave an estimate of {name!r}, but it declares "
                f"{listing(self._states)}; name the trajectory in the mode's declaration"
            )
        return writer


def failed_records(mode: Mode, failure: str) -> dict[str, TrajectoryRecord]:
    """What ``run.json`` holds of a mode that could not start."""
    first = mode.trajectory_names[0]
    return {
        first: TrajectoryRecord(
            mode=mode.name,
            sensors=(),
            measurements=0,
            estimates=0,
            compute_s=0.0,
            realtime_factor=None,
            counts={},
            events=(),
            keyframes=None,
            calibration=None,
            pictures=0,
            recording_ns=None,
            failure=failure,
            status="failed",
        )
    }

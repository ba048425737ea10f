# SPDX-License-Identifier: BSD-3-Clause
"""What all readers have in common: order, missing velocities, counting, and one report."""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterator

import numpy as np

from coclo_vio.calibration import ImuCalibration, StereoCalibration
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.joint_velocity import fill_velocities
from coclo_vio.datasets.report import ReadReport, ReadTally
from coclo_vio.datasets.samples import SampleTable
from coclo_vio.datasets.sequencer import merge_streams, sort_measurements
from coclo_vio.errors import DatasetError
from coclo_vio.measurements import LEG_SENSORS, Measurement
from coclo_vio.trajectory import GroundTruth


class Recording(ABC):
    """A recording made of tables of samples; a format says which tables, and where its ground truth is.

    Invariant: ``measurements`` starts from the beginning each time it is called.

    Attributes:
        name: what the recording is called in reports.
    """

    format_name: str

    def __init__(self, name: str, config: DatasetConfig) -> None:
        self.name = name
        self._config = config
        self._read: ReadReport | None = None
        self._truth: tuple[GroundTruth | None, ReadReport] | None = None

    @abstractmethod
    def _tables(self, tally: ReadTally) -> list[SampleTable]:
        """The tables of samples; notes on them go to ``tally``."""

    @abstractmethod
    def _read_ground_truth(self, tally: ReadTally) -> GroundTruth | None:
        """The reference trajectory, or None."""

    def imu_calibration(self) -> ImuCalibration | None:
        """Mounting and noise of the IMU where the recording says them, otherwise None."""
        return None

    def camera_imu_calibration(self) -> ImuCalibration | None:
        """Mounting and noise of the camera's IMU where the recording says them, otherwise None."""
        return None

    def stereo_calibration(self) -> StereoCalibration | None:
        """Lenses and mounting of the cameras where the recording says them, otherwise None."""
        return None

    def measurements(self, sensors: frozenset[type] = LEG_SENSORS) -> Iterator[Measurement]:
        """All samples of ``sensors``, streamed; in time order as far as the files are, or sorted if so configured.

        Raises:
            DatasetError: a malformed file, or no sample in it at all.
        """
        tally = self._new_tally()
        yield from (sample for sample in tally.watch(self._stream(tally)) if type(sample) in sensors)
        self._read = self._checked(tally)

    def ground_truth(self) -> GroundTruth | None:
        """The reference trajectory, read once, or None where the recording has none.

        Raises:
            DatasetError: its file is malformed.
        """
        return self._truth_and_report()[0]

    def report(self) -> ReadReport:
        """What the recording holds; reads it through unless ``measurements`` has been exhausted before.

        Raises:
            DatasetError: a malformed file.
        """
        read = self._read
        if read is None:
            tally = self._new_tally()
            deque(tally.watch(self._stream(tally)), maxlen=0)
            read = self._read = self._checked(tally)
        truth = self._truth_and_report()[1]
        notes = tuple(dict.fromkeys((*read.notes, *truth.notes)))
        return ReadReport(read.format, read.streams, {**read.dropped, **truth.dropped}, notes)

    def _new_tally(self) -> ReadTally:
        return ReadTally(self.format_name, self._config.gap_s)

    def _checked(self, tally: ReadTally) -> ReadReport:
        report = tally.report()
        if not report.streams:
            raise DatasetError(f"{self.name} holds no sample; rows left out: {dict(report.dropped) or 'none'}")
        return report

    def _stream(self, tally: ReadTally) -> Iterator[Measurement]:
        tables = self._tables(tally)
        stream: Iterator[Measurement] = merge_streams([table.measurements(tally) for table in tables])
        if self._config.sort:
            stream = self._sorted(stream, tally)
        for table in tables:
            if table.joints is not None and not table.joints.velocity.is_present.all():
                is_absent = np.logical_not(table.joints.velocity.is_present)
                stream = fill_velocities(stream, is_absent, self._config.joint_velocity)
        return stream

    def _truth_and_report(self) -> tuple[GroundTruth | None, ReadReport]:
        if self._truth is None:
            tally = self._new_tally()
            self._truth = (self._read_ground_truth(tally), tally.report())
        return self._truth

    def _sorted(self, stream: Iterator[Measurement], tally: ReadTally) -> Iterator[Measurement]:
        before = self._new_tally()
        ordered = sort_measurements(before.watch(stream))
        moved = sum(report.backward_stamps for report in before.report().streams)
        if moved:
            tally.note(f"{moved} samples were older than the one before them: all have been put in time order")
        return ordered

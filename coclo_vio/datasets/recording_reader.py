# SPDX-License-Identifier: BSD-3-Clause
"""Base class of the readers of files and folders: time order, missing velocities, images, counts and the report."""

from collections import deque
from collections.abc import Iterable, Iterator

import numpy as np

from coclo_vio.datasets.burst_stamps import spread_bursts
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.image_pairs import ImagePair, ImagePairSource
from coclo_vio.datasets.joint_velocity import fill_velocities
from coclo_vio.datasets.read_report import ReadReport, ReadTally
from coclo_vio.datasets.sample_table import SampleTable
from coclo_vio.datasets.sequencer import merge_streams, sort_measurements
from coclo_vio.values.calibration import ImuCalibration, StereoCalibration
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.measurements import LEG_SENSORS, Measurement, StereoFrame
from coclo_vio.values.trajectory import GroundTruth

_UNDECODED = "stereo: image pair cannot be decoded"


class RecordingReader:
    """A recording of tables or other samples, and of images. Fulfils ``Dataset``.

    A format derives from it and overrides ``_tables`` (tables of samples) or ``_samples`` (any other source), and where
    it has them ``_cameras``, ``_read_ground_truth`` and the calibrations.

    Invariant: ``measurements`` starts from the beginning at each call.

    Attributes:
        format_name: name of the format in reports.
        name: name of the recording in reports.
    """

    format_name: str

    def __init__(self, name: str, config: DatasetConfig) -> None:
        """Set the name and the configuration; nothing is read."""
        self.name = name
        self._config = config
        self._read: ReadReport | None = None
        self._truth: tuple[GroundTruth | None, ReadReport] | None = None

    def _tables(self, tally: ReadTally) -> list[SampleTable]:
        """The tables of samples; notes on them go to ``tally``."""
        return []

    def _read_ground_truth(self, tally: ReadTally) -> GroundTruth | None:
        """The reference trajectory, or None; notes on it go to ``tally``."""
        return None

    def _cameras(self, tally: ReadTally) -> ImagePairSource | None:
        """The images of two cameras, or None; notes on them go to ``tally``."""
        return None

    def imu_calibration(self) -> ImuCalibration | None:
        """The recording's mounting and noise of the body's IMU, or None."""
        return None

    def camera_imu_calibration(self) -> ImuCalibration | None:
        """The recording's mounting and noise of the camera's IMU, or None."""
        return None

    def stereo_calibration(self) -> StereoCalibration | None:
        """The recording's intrinsics and mounting of the two cameras, or None."""
        return None

    def measurements(self, sensors: frozenset[type] = LEG_SENSORS) -> Iterator[Measurement]:
        """All samples of ``sensors``, streamed; in time order as far as the files are, or sorted if so configured.

        Images are decoded one pair at a time, and only if ``StereoFrame`` is in ``sensors``; with ``allow_partial`` a
        pair that cannot be decoded is left out and counted in the report.

        Raises:
            DatasetError: a malformed file, or no sample in it.
        """
        tally = self._new_tally()
        if sensors == {StereoFrame} and self._cameras(tally) is None:
            return  # the tables need not be read for images that there are none of
        stream = self._stream(tally, decodes=StereoFrame in sensors)
        yield from (sample for sample in stream if type(sample) in sensors)
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
            deque(self._stream(tally, decodes=False), maxlen=0)
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

    def _stream(self, tally: ReadTally, *, decodes: bool) -> Iterator[Measurement]:
        """All samples, counted; with ``decodes`` images are among them, otherwise they are counted by their stamps."""
        cameras = self._cameras(tally)
        pairs = [] if cameras is None else cameras.pairs(tally, self._config)
        if decodes:
            return tally.watch(merge_streams([self._samples(tally), self._decoded(pairs, tally)]))
        for pair in pairs:
            tally.count(StereoFrame, pair.stamp_ns)
        return tally.watch(self._samples(tally))

    def _decoded(self, pairs: Iterable[ImagePair], tally: ReadTally) -> Iterator[StereoFrame]:
        for pair in pairs:
            try:
                yield pair.decoded()
            except DatasetError as error:
                if not self._config.allow_partial:
                    raise
                tally.dropped[_UNDECODED] += 1
                if tally.dropped[_UNDECODED] == 1:
                    tally.note(f"the first image that cannot be decoded: {error}")

    def _samples(self, tally: ReadTally) -> Iterator[Measurement]:
        """The samples of all sensors but the cameras."""
        tables = self._tables(tally)
        stream: Iterator[Measurement] = merge_streams([table.measurements(tally) for table in tables])
        if self._config.sort:
            stream = self._sorted(stream, tally)
        if self._config.spreads_bursts and any(table.joints is not None for table in tables):
            stream = spread_bursts(stream, tally.note)
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
        unsorted = self._new_tally()
        ordered = sort_measurements(unsorted.watch(stream))
        moved = sum(report.backward_stamps for report in unsorted.report().streams)
        if moved:
            tally.note(f"{moved} samples were older than the one before them: all samples were sorted by time")
        return ordered

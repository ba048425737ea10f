# SPDX-License-Identifier: BSD-3-Clause
"""Measurements from the rows of a CSV table, and notes on the columns that it lacks."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from coclo_vio.datasets.columns import Header, JointColumns, OptionalColumns, StampColumn
from coclo_vio.datasets.csv_table import CsvRow, CsvTable
from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.values.arrays import has_nan
from coclo_vio.values.errors import listing
from coclo_vio.values.measurements import CameraImuSample, FootForceSample, ImuSample, JointSample, Measurement


@dataclass(frozen=True, slots=True, eq=False)
class SampleTable:
    """A table of measurements: its columns by sensor, and its label in reports.

    A sensor whose cells are all empty in a row has no sample there (a slower sensor); ``nan`` is a failed reading.
    ``imu_kind`` is the type of the inertial readings: of the body's IMU or of the camera's.
    """

    table: CsvTable
    label: str
    stamp: StampColumn
    imu: tuple[int, ...] | None = None
    joints: JointColumns | None = None
    force: OptionalColumns | None = None
    imu_kind: type[ImuSample] | type[CameraImuSample] = ImuSample

    def measurements(self, tally: ReadTally) -> Iterator[Measurement]:
        """The samples in file order; within a row foot force, IMU, joints.

        Raises:
            DatasetError: a malformed row or a cell that is not a number.
        """
        for row in self.table.rows():
            stamp_ns = self.stamp.read(row)
            if stamp_ns is None:
                tally.dropped[f"{self.label}: row without a stamp"] += 1
                continue
            if self.force is not None and not row.is_blank(self.force.indices):
                yield FootForceSample(stamp_ns, self.force.read(row))
            if self.imu is not None and not row.is_blank(self.imu):
                yield from self._imu_sample(row, stamp_ns, tally)
            if self.joints is not None and not row.is_blank(self.joints.all_indices):
                columns = self.joints
                position, velocity, effort = (
                    columns.position.read(row),
                    columns.velocity.read(row),
                    columns.effort.read(row),
                )
                yield JointSample(stamp_ns, position, velocity, effort)
        if self.table.has_cut_line:
            tally.dropped[f"{self.label}: last line cut off"] += 1
        if self.table.lacks_newline:
            tally.note(f"{self.label}: the last line has no newline, its last number may be cut short")

    def _imu_sample(self, row: CsvRow, stamp_ns: int, tally: ReadTally) -> Iterator[ImuSample | CameraImuSample]:
        values = np.array(row.numbers(self.imu or ()))
        if has_nan(values):
            tally.dropped[f"{self.label}: IMU reading empty or NaN"] += 1
        else:
            yield self.imu_kind(stamp_ns, values[:3], values[3:])

    def describe(self, header: Header, tally: ReadTally) -> None:
        """Note what the table lacks and which of its columns are not read."""
        used = {self.stamp.index, *(self.imu or ())}
        if self.force is not None:
            used.update(self.force.indices)
            if not self.force.is_present.all():
                tally.note(f"{self.label}: {int((~self.force.is_present).sum())} legs have no foot force")
        if self.joints is not None:
            used.update(self.joints.all_indices)
            self._describe_joints(self.joints, tally)
        unused = header.unused(used)
        if unused:
            tally.note(f"{self.label}: columns not read: {listing(unused)}")

    def _describe_joints(self, joints: JointColumns, tally: ReadTally) -> None:
        for reading, columns, handling in (
            ("velocity", joints.velocity, "estimated causally from the angles"),
            ("torque", joints.effort, "passed on as NaN"),
        ):
            absent = [name for name, has in zip(joints.names, columns.is_present, strict=True) if not has]
            if len(absent) == len(joints.names):
                tally.note(f"{self.label}: no joint {reading} in the log: {handling}")
            elif absent:
                tally.note(f"{self.label}: no joint {reading} of {listing(absent)}: {handling}")

# SPDX-License-Identifier: BSD-3-Clause
"""A dataset whose samples, stamps and ground truth are corrected as configured (``corrections``)."""

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from coclo_vio.datasets.corrections import (
    LENGTH_UNITS,
    STAMP_UNITS_NS,
    Corrections,
    upright,
)
from coclo_vio.datasets.joint_velocity import JointVelocityConfig, fill_velocities
from coclo_vio.datasets.read_report import STREAM_NAMES, ReadReport, StreamReport
from coclo_vio.datasets.sample_corrections import SampleCorrections
from coclo_vio.datasets.sequencer import merge_streams
from coclo_vio.datasets.truth_defects import jumping_poses
from coclo_vio.geometry import se3, so3
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.measurements import (
    LEG_SENSORS,
    Measurement,
)
from coclo_vio.values.trajectory import GroundTruth, Trajectory

if TYPE_CHECKING:
    from coclo_vio.datasets.dataset import Dataset

_JUMPS = "ground truth: pose that jumps"


class CorrectedDataset:
    """A dataset with corrections; everything that is not corrected is the dataset's own.

    Streams of different delays are read one by one and merged by their corrected stamps.
    """

    def __init__(
        self,
        dataset: "Dataset",
        corrections: Corrections,
        robot: RobotDescription | None = None,
        joint_velocity: JointVelocityConfig | None = None,
    ) -> None:
        """Set what is changed.

        Args:
            dataset: as recorded.
            corrections: what is changed.
            robot: whose joints and legs they are.
            joint_velocity: how velocities are estimated from angles; by default as for logs without velocities.

        Raises:
            DatasetError: a correction of a joint or leg that the robot does not have.
        """
        self._dataset = dataset
        self._corrections = corrections
        self._joint_names = () if robot is None else robot.joint_names
        self._joint_velocity = joint_velocity or JointVelocityConfig()
        self._jumps = 0
        self._unit_ns = STAMP_UNITS_NS[corrections.stamp_unit]
        self._of_samples = SampleCorrections(corrections, robot)

    def __getattr__(self, name: str) -> Any:
        """What the format has beyond the protocol, such as topics."""
        return getattr(self._dataset, name)

    def measurements(self, sensors: frozenset[type] = LEG_SENSORS) -> Iterator[Measurement]:
        """All samples of ``sensors`` in order of their corrected stamps, from the beginning at each call.

        Raises:
            DatasetError: the recording is malformed.
            TimestampError: a corrected stamp is beyond the year 2116.
        """
        stream = self._merged(sensors)
        if self._corrections.joints.velocity == "from_position":
            is_absent = np.ones(len(self._joint_names), dtype=np.bool_)
            stream = fill_velocities(stream, is_absent, self._joint_velocity)
        yield from stream

    def _merged(self, sensors: frozenset[type]) -> Iterator[Measurement]:
        delays = {self._of_samples.delay_ns(kind) for kind in sensors}
        if len(delays) <= 1:
            return map(self._of_samples.corrected, self._dataset.measurements(sensors))
        streams = [self._dataset.measurements(frozenset({kind})) for kind in sensors]
        return merge_streams([map(self._of_samples.corrected, stream) for stream in streams])

    def ground_truth(self) -> GroundTruth | None:
        """The corrected reference trajectory, or None.

        Raises:
            DatasetError: it is malformed.
        """
        given, how = self._dataset.ground_truth(), self._corrections.ground_truth
        if given is None or not how.is_read:
            return None
        T_world_body = given.trajectory.T_world_body
        rotations, positions = T_world_body[:, :3, :3], T_world_body[:, :3, 3] * LENGTH_UNITS[how.length_unit]
        if how.quaternion == "wxyz":
            rotations = so3.from_quat_xyzw(np.roll(so3.to_quat_xyzw(rotations), -1, axis=1))
        velocity = given.trajectory.velocity_world
        if how.up != "z":
            turn = upright(how.up)
            rotations, positions = turn @ rotations, positions @ turn.T
            velocity = None if velocity is None else velocity @ turn.T
        stamps = given.trajectory.stamps_ns.tolist()
        if given.has_stamps:
            stamps = [round(stamp * how.stamp_factor) for stamp in stamps]
        corrected = Trajectory(
            np.array(stamps),
            se3.transform(rotations, positions),
            None if velocity is None else velocity * LENGTH_UNITS[how.length_unit],
        )
        if how.drops_jumps and given.has_stamps:
            is_jumping = jumping_poses(corrected.stamps_ns, corrected.positions)
            self._jumps = int(is_jumping.sum())
            corrected = corrected.select(~is_jumping)
        return replace(given, trajectory=corrected)

    def report(self) -> ReadReport:
        """What the recording holds, on the corrected clock.

        Raises:
            DatasetError: the recording is malformed.
        """
        report = self._dataset.report()
        note = f"corrected as configured: {_described(self._corrections)}"
        streams = tuple(map(self._stream, report.streams))
        dropped = dict(report.dropped)
        if self._corrections.ground_truth.drops_jumps and self.ground_truth() is not None and self._jumps:
            dropped[_JUMPS] = self._jumps
        return ReadReport(report.format, streams, dropped, (*report.notes, note))

    def _stream(self, stream: StreamReport) -> StreamReport:
        kind = next(kind for kind, name in STREAM_NAMES.items() if name == stream.name)
        return replace(
            stream,
            rate_hz=stream.rate_hz / self._unit_ns,
            longest_gap_s=stream.longest_gap_s * self._unit_ns,
            start_ns=self._of_samples.stamp_ns(kind, stream.start_ns),
            end_ns=self._of_samples.stamp_ns(kind, stream.end_ns),
            longest_gap_start_ns=self._of_samples.stamp_ns(kind, stream.longest_gap_start_ns),
        )


def _described(corrections: Corrections) -> str:
    changed = corrections.model_dump(exclude_defaults=True)
    found = []
    for key, value in changed.items():
        inner = value.items() if isinstance(value, dict) else [("", value)]
        found += [f"{key}{'.' if name else ''}{name} = {each}" for name, each in inner]
    return ", ".join(found)

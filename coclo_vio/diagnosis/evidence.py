# SPDX-License-Identifier: BSD-3-Clause
"""What the checks look at: the samples of a recording's first minutes as arrays, its calibrations and its robot."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from itertools import islice
from typing import Any, TypeVar

import numpy as np

from coclo_vio.datasets.corrections import Corrections
from coclo_vio.datasets.dataset import Dataset
from coclo_vio.datasets.read_report import STREAM_NAMES, ReadReport
from coclo_vio.diagnosis.feet import FeetRecord, feet_of
from coclo_vio.diagnosis.rates import by_cameras, by_gyroscope
from coclo_vio.diagnosis.records import ForceRecord, InertialRecord, JointRecord
from coclo_vio.robot.description import RobotDescription
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import IntArray
from coclo_vio.values.calibration import ImuCalibration, SensorCalibrations
from coclo_vio.values.errors import CocloError, DatasetError
from coclo_vio.values.measurements import (
    ALL_SENSORS,
    CameraImuSample,
    FootForceSample,
    ImuSample,
    JointSample,
    Measurement,
    StereoFrame,
)
from coclo_vio.values.trajectory import GroundTruth, Trajectory
from coclo_vio.values.units import NS_PER_S

_MOST_S = 180.0
_TRACKED_FRAMES, _FEWEST_FRAMES = 250, 10
_FEWEST_READINGS = 100
_SAMPLED = ALL_SENSORS - {StereoFrame}
_T = TypeVar("_T")


class Evidence:
    """A recording as the checks see it; nothing is read before it is asked for.

    Attributes:
        dataset: the recording.
        description: of the robot; None where it is not known.
        robot_imu: the mounting and noise of the body's IMU that a run would use; None where nothing is known.
        seconds: how much of the recording is looked at, s.
        corrections: what is corrected in the recording already.
        unused_imu: the mounting and noise of the body's IMU by another source, which a run does not use; None: none.
    """

    def __init__(
        self,
        dataset: Dataset,
        description: RobotDescription | None,
        robot_imu: ImuCalibration | None,
        seconds: float = _MOST_S,
        corrections: Corrections | None = None,
        unused_imu: ImuCalibration | None = None,
    ) -> None:
        self.dataset = dataset
        self.description = description
        self.robot_imu = robot_imu
        self.seconds = seconds
        self.corrections = corrections or Corrections()
        self.unused_imu = unused_imu

    @cached_property
    def robot(self) -> RobotModel | None:
        """The robot's kinematics; None where there is no robot, or its description does not fit its URDF."""
        description = self.description
        return None if description is None else _tried(lambda: RobotModel(description))

    @cached_property
    def report(self) -> ReadReport | None:
        """Streams, rates, gaps, notes; None where the recording cannot be read."""
        _ = self._samples  # a reader counts what it passes on
        return _tried(self.dataset.report)

    @cached_property
    def first_stamps_ns(self) -> dict[str, int]:
        """By stream, the stamp of its first sample; streams without any are left out."""
        samples, are_all = self._samples_and_end
        found = {kind: rows[0].stamp_ns for kind, rows in samples.items()}
        for kind in {StereoFrame} if are_all else ALL_SENSORS - found.keys():
            try:
                first = next(iter(self.dataset.measurements(frozenset({kind}))), None)
            except CocloError:  # inspection and run report it
                continue
            if first is not None:
                found[kind] = first.stamp_ns
        return {name: found[kind] for kind, name in STREAM_NAMES.items() if kind in found}

    @cached_property
    def calibrations(self) -> SensorCalibrations:
        """Of cameras and IMUs; None where a calibration is missing or malformed."""
        own = _tried(self.dataset.imu_calibration)
        return SensorCalibrations(
            stereo=_tried(self.dataset.stereo_calibration),
            imu=self.robot_imu or own,
            camera_imu=_tried(self.dataset.camera_imu_calibration),
        )

    @cached_property
    def truth(self) -> GroundTruth | None:
        """The reference trajectory, None where there is none or it is malformed."""
        return _tried(self.dataset.ground_truth)

    @cached_property
    def imu(self) -> InertialRecord | None:
        """The body's IMU."""
        return self._inertial(ImuSample)

    @cached_property
    def camera_imu(self) -> InertialRecord | None:
        """The IMU of the camera."""
        return self._inertial(CameraImuSample)

    @cached_property
    def joints(self) -> JointRecord | None:
        """The joints."""
        rows = self._samples.get(JointSample)
        if not rows or self.robot is None:
            return None
        return JointRecord(
            _stamps(rows),
            np.array([row.position for row in rows]),
            np.array([row.velocity for row in rows]),
            np.array([row.effort for row in rows]),
        )

    @cached_property
    def foot_force(self) -> ForceRecord | None:
        """The foot sensors."""
        rows = self._samples.get(FootForceSample)
        return ForceRecord(_stamps(rows), np.array([row.force for row in rows])) if rows else None

    @cached_property
    def feet(self) -> FeetRecord | None:
        """Where the feet are and which of them stand; None without joints or without a robot."""
        if self.robot is None or self.joints is None:
            return None
        return feet_of(self.robot, self.joints, self.foot_force)

    @cached_property
    def attitudes_by_imu(self) -> Trajectory | None:
        """Attitudes by the body's gyroscope, without its median; None without it."""
        return _integrated(self.imu, self.robot_imu)

    @cached_property
    def attitudes_by_camera_imu(self) -> Trajectory | None:
        """Attitudes by the gyroscope of the camera's IMU, without its median; None without it."""
        return _integrated(self.camera_imu, self.calibrations.camera_imu)

    @cached_property
    def attitudes_by_cameras(self) -> Trajectory | None:
        """Attitudes by rotations from frame to frame over the first frames; None where cameras are missing or blind."""
        stereo = self.calibrations.stereo
        frames = [] if stereo is None else self.frames(_TRACKED_FRAMES)
        return None if stereo is None or len(frames) < _FEWEST_FRAMES else by_cameras(frames, stereo)

    @property
    def _samples(self) -> dict[type, list[Any]]:
        """All samples but the images of the first minutes; those before a defect where there is one."""
        return self._samples_and_end[0]

    @cached_property
    def _samples_and_end(self) -> tuple[dict[type, list[Any]], bool]:
        """The samples, and whether they are all there are."""
        found: dict[type, list[Any]] = defaultdict(list)
        last_ns: int | None = None
        try:
            for sample in self.dataset.measurements(_SAMPLED):
                if last_ns is None:
                    last_ns = sample.stamp_ns + round(self.seconds * NS_PER_S)
                if sample.stamp_ns > last_ns:
                    return found, False
                found[type(sample)].append(sample)
        except DatasetError:  # inspection and run report it
            return found, False
        return found, True

    def _inertial(self, kind: type) -> InertialRecord | None:
        rows = self._samples.get(kind)
        if not rows:
            return None
        rates, forces = (
            np.array([getattr(row, name) for row in rows]) for name in ("angular_velocity", "specific_force")
        )
        return InertialRecord(_stamps(rows), rates, forces)

    def frames(self, most: int, every: int = 1) -> Sequence[StereoFrame]:
        """Every n-th of the first stereo frames, decoded; fewer where one cannot be read."""
        found: list[StereoFrame] = []
        try:
            stream: Iterator[Measurement] = self.dataset.measurements(frozenset({StereoFrame}))
            for frame in islice(stream, 0, most * every, every):
                if isinstance(frame, StereoFrame):
                    found.append(frame)
        except CocloError:  # inspection and run report it
            pass
        return found


def _integrated(record: InertialRecord | None, mounting: ImuCalibration | None) -> Trajectory | None:
    if record is None or mounting is None or len(record.stamps_ns) < _FEWEST_READINGS:
        return None
    return by_gyroscope(record, mounting.T_body_imu[:3, :3])


def _stamps(rows: Sequence[Any]) -> IntArray:
    return np.array([row.stamp_ns for row in rows], dtype=np.int64)


def _tried(read: Callable[[], _T | None]) -> _T | None:
    try:
        return read()
    except CocloError:  # inspection and run report it
        return None

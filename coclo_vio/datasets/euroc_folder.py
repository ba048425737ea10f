# SPDX-License-Identifier: BSD-3-Clause
"""The EuRoC (ASL) folder, extended by three sensors: joints, foot forces and the camera's IMU.

======================================= =============================================================================
``mav0/imu0/data.csv``                  ``#timestamp [ns]``, ``w_RS_S_x`` ... rad/s, ``a_RS_S_x`` ... m/s^2
``mav0/imu1/data.csv``                  extension: the same, of the IMU inside the camera
``mav0/joints0/data.csv``               extension: ``#timestamp [ns]``, ``<joint>.position``, ``.velocity``, ``.effort``
``mav0/foot_force0/data.csv``           extension: ``#timestamp [ns]``, ``<leg>.force``
``mav0/cam0``, ``mav0/cam1``            left, right camera: ``data.csv`` (``#timestamp [ns]``, ``filename``), ``data/``
``mav0/<sensor>/sensor.yaml``           mounting ``T_BS`` = ``T_body_sensor``; an IMU's noise, a camera's intrinsics
``mav0/state_groundtruth_estimate0``    ground truth; otherwise ``mav0/vicon0``, ``mav0/mocap0`` (their ``T_BS`` is
                                        taken into account), or TUM lines in a text file beside ``mav0``
======================================= =============================================================================

The path may be that of ``mav0`` itself or of the folder that holds it. The body is the frame that ``T_BS`` refers to;
in the published sequences it is the IMU, whose x axis points up. Source of the layout: Burri et al., "The EuRoC micro
aerial vehicle datasets", IJRR 2016.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from coclo_vio.datasets import euroc_sensor
from coclo_vio.datasets.columns import ColumnNames, Header
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.csv_table import CsvTable
from coclo_vio.datasets.euroc_sensor import SENSOR_YAML
from coclo_vio.datasets.ground_truth import read_ground_truth, tum_files
from coclo_vio.datasets.image_pairs import CAMERAS, EurocImagePairs
from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.datasets.recording_reader import RecordingReader
from coclo_vio.datasets.sample_table import SampleTable
from coclo_vio.geometry import se3
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.calibration import ImuCalibration, StereoCalibration
from coclo_vio.values.errors import DatasetError, listing
from coclo_vio.values.measurements import CameraImuSample
from coclo_vio.values.trajectory import GroundTruth, Trajectory

LAYOUT = "mav0/imu0/data.csv, mav0/joints0/data.csv or mav0/cam0/data.csv"
_SENSORS = ("imu0", "imu1", "joints0", "foot_force0")
_USUAL = ("imu0", "joints0")
_ROBOT_SENSORS = ("joints0", "foot_force0")
_HALF_IMU = re.compile(r"acc(el)?|gyro?")
_POSITIONS_ONLY = "leica0"
_GROUND_TRUTH_SENSORS = ("state_groundtruth_estimate0", "vicon0", "mocap0")


class EurocFolder(RecordingReader):
    """A recording in the EuRoC layout."""

    format_name = "EuRoC folder"

    def __init__(self, path: Path, robot: RobotDescription | None, config: DatasetConfig) -> None:
        """Find the sensors' files and their columns; without a robot IMUs and cameras are read.

        Raises:
            TopicNotFound: a column is missing; lists those that exist.
            DatasetError: a file cannot be read.
        """
        self._mav0 = _mav0(path)
        super().__init__(self._mav0.resolve().parent.name, config)
        self._robot = robot
        tally = ReadTally(self.format_name, config.gap_s)
        tables, cameras = self._tables(tally), self._cameras(tally)
        if not tables and cameras is None:
            raise DatasetError(
                f"{self._mav0} has nothing that can be read: imu0 and imu1 are absent, and so is cam0 or cam1"
                f"{_half_imus(self._mav0)}"
                f"{'; joints need a robot: name one' if robot is None else ''}"
            )

    def imu_calibration(self) -> ImuCalibration | None:
        """Mounting and noise from ``imu0/sensor.yaml``, or None where there is no such file.

        Raises:
            DatasetError: the file is malformed.
        """
        return self._imu("imu0")

    def camera_imu_calibration(self) -> ImuCalibration | None:
        """Mounting and noise from ``imu1/sensor.yaml``, or None where there is no such file.

        Raises:
            DatasetError: the file is malformed.
        """
        return self._imu("imu1")

    def stereo_calibration(self) -> StereoCalibration | None:
        """Intrinsics and mountings from ``sensor.yaml`` of both cameras, or None where one of them is absent.

        Raises:
            CalibrationMissing: a file lacks a key.
            DatasetError: a file is malformed.
        """
        left, right = (self._mav0 / camera / SENSOR_YAML for camera in CAMERAS)
        return euroc_sensor.read_stereo(left, right) if left.is_file() and right.is_file() else None

    def _imu(self, sensor: str) -> ImuCalibration | None:
        path = self._mav0 / sensor / SENSOR_YAML
        return euroc_sensor.read_imu(path) if path.is_file() else None

    def _tables(self, tally: ReadTally) -> list[SampleTable]:
        return [table for name in _SENSORS for table in self._table(name, tally)]

    def _cameras(self, tally: ReadTally) -> EurocImagePairs | None:
        absent = [camera for camera in CAMERAS if not (self._mav0 / camera / "data.csv").is_file()]
        if not absent:
            if not (self._mav0 / "joints0" / "data.csv").is_file():
                tally.note("the body frame is the one that T_BS of each sensor.yaml refers to, whatever its axes")
            return EurocImagePairs(self._mav0, self._config.columns)
        if len(absent) == 1:
            tally.note(f"{absent[0]}/data.csv is absent: the images of the other camera are not read")
        return None

    def _table(self, sensor: str, tally: ReadTally) -> Iterator[SampleTable]:
        path = self._mav0 / sensor / "data.csv"
        label = f"{sensor}/data.csv"
        if not path.is_file():
            if sensor in _USUAL:
                tally.note(f"{label} is absent{_half_imus(self._mav0) if sensor == 'imu0' else ''}")
            return
        if sensor in _ROBOT_SENSORS and self._robot is None:
            tally.note(f"{label} is not read: no robot was named")
            return
        table = CsvTable.open(path)
        header = Header(path, table.header, self._config.columns)
        stamp = header.stamp()
        match sensor, self._robot:
            case "joints0", RobotDescription() as robot:
                samples = SampleTable(table, label, stamp, joints=header.joints(robot))
            case "foot_force0", RobotDescription() as robot:
                samples = SampleTable(table, label, stamp, force=header.forces(robot))
            case "imu1", _:
                imu = header.required_imu()
                samples = SampleTable(table, label, stamp, imu=imu, imu_kind=CameraImuSample)
            case _:
                samples = SampleTable(table, label, stamp, imu=header.required_imu())
        samples.describe(header, tally)
        yield samples

    def _read_ground_truth(self, tally: ReadTally) -> GroundTruth | None:
        for sensor in _GROUND_TRUTH_SENSORS:
            path = self._mav0 / sensor / "data.csv"
            if path.is_file():
                truth = read_ground_truth(path, self._config.columns, tally)
                return _of_body(truth, path.with_name(SENSOR_YAML), f"{sensor}/data.csv")
        folder = self._mav0.resolve().parent
        texts = [folder / "groundtruth.tum"] if (folder / "groundtruth.tum").is_file() else tum_files(folder)
        if texts:
            return read_ground_truth(texts[0], self._config.columns, tally)
        if (self._mav0 / _POSITIONS_ONLY / "data.csv").is_file():
            tally.note(f"{_POSITIONS_ONLY}/data.csv is not read: it holds positions of a prism, not poses of the body")
        return None


def is_euroc_folder(path: Path) -> bool:
    """Whether ``path`` holds, or is, a ``mav0`` with an IMU, joints or a camera."""
    mav0 = _mav0(path)
    sensors = (*_SENSORS, *CAMERAS)
    return mav0.resolve().name == "mav0" and any((mav0 / sensor / "data.csv").is_file() for sensor in sensors)


def joint_names(path: Path, columns: ColumnNames) -> tuple[Path, tuple[str, ...]]:
    """The file that holds the joints, and their names; no names where it is absent."""
    joints = _mav0(path) / "joints0" / "data.csv"
    return joints, Header(joints, CsvTable.open(joints).header, columns).joint_names() if joints.is_file() else ()


def _half_imus(mav0: Path) -> str:
    """What to do with folders that hold half of an IMU each, to follow a sentence; empty where there are none."""
    halves = [file.parent.name for file in sorted(mav0.glob("*/data.csv")) if _HALF_IMU.match(file.parent.name.lower())]
    if not halves:
        return ""
    return f", and {listing(halves)} are halves of one: write both with one stamp a row into imu0/data.csv"


def _mav0(path: Path) -> Path:
    return path / "mav0" if (path / "mav0").is_dir() else path


def _of_body(truth: GroundTruth, sensor_yaml: Path, source: str) -> GroundTruth:
    """The body's poses from those of a marker mounted at ``T_BS``."""
    sensor = euroc_sensor.read_sensor_yaml(sensor_yaml) if sensor_yaml.is_file() else {}
    T_body_sensor = euroc_sensor.mounting(sensor_yaml, sensor)
    trajectory = truth.trajectory
    if T_body_sensor is None or np.array_equal(T_body_sensor, np.eye(4)):
        return GroundTruth(trajectory, truth.has_stamps, source)
    # The marker's velocity is not the body's.
    moved = Trajectory(trajectory.stamps_ns, trajectory.T_world_body @ se3.inverse(T_body_sensor))
    return GroundTruth(moved, truth.has_stamps, source)

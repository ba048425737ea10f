# SPDX-License-Identifier: BSD-3-Clause
"""The EuRoC (ASL) folder, with two sensors of our own for the legs.

======================================= =============================================================================
``mav0/imu0/data.csv``                  ``#timestamp [ns]``, ``w_RS_S_x`` ... rad/s, ``a_RS_S_x`` ... m/s^2
``mav0/imu0/sensor.yaml``               noise densities, random walks, ``T_BS`` = ``T_body_imu``
``mav0/joints0/data.csv``               ours: ``#timestamp [ns]``, ``<joint>.position``, ``.velocity``, ``.effort``
``mav0/foot_force0/data.csv``           ours: ``#timestamp [ns]``, ``<leg>.force``
``mav0/state_groundtruth_estimate0``    ground truth; otherwise ``mav0/vicon0``, ``mav0/mocap0`` (their ``T_BS`` is
                                        taken into account), or ``groundtruth.tum`` beside ``mav0``
======================================= =============================================================================

The folder given may be ``mav0`` itself or the one that holds it. Source of the layout: Burri et al., "The EuRoC micro
aerial vehicle datasets", IJRR 2016.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from coclo_vio.arrays import Array
from coclo_vio.calibration import ImuCalibration
from coclo_vio.datasets.columns import ColumnNames, Header
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.csv_table import CsvTable
from coclo_vio.datasets.ground_truth import read_ground_truth
from coclo_vio.datasets.recording import Recording
from coclo_vio.datasets.report import ReadTally
from coclo_vio.datasets.samples import SampleTable
from coclo_vio.errors import DatasetError, listing
from coclo_vio.geometry import se3
from coclo_vio.robot.description import RobotDescription
from coclo_vio.trajectory import GroundTruth, Trajectory

LOOKS_FOR = "an EuRoC folder: mav0/imu0/data.csv or mav0/joints0/data.csv"
_SENSORS = ("imu0", "joints0", "foot_force0")
_GROUND_TRUTH_SENSORS = ("state_groundtruth_estimate0", "vicon0", "mocap0")
_NOISE_KEYS = {
    "gyroscope_noise_density": "gyroscope_noise_density",
    "gyroscope_random_walk": "gyroscope_bias_walk",
    "accelerometer_noise_density": "accelerometer_noise_density",
    "accelerometer_random_walk": "accelerometer_bias_walk",
}


class EurocFolder(Recording):
    """A recording in the EuRoC layout."""

    format_name = "EuRoC folder"

    def __init__(self, path: Path, robot: RobotDescription | None, config: DatasetConfig) -> None:
        """Find the sensors' files and their columns; without a robot only the IMU is read.

        Raises:
            TopicNotFound: a column is missing; lists those that exist.
            DatasetError: a file cannot be read.
        """
        self._mav0 = _mav0(path)
        super().__init__(self._mav0.resolve().parent.name, config)
        self._robot = robot
        self._tables(ReadTally(self.format_name, config.gap_s))

    def imu_calibration(self) -> ImuCalibration | None:
        """Mounting and noise from ``imu0/sensor.yaml``, or None where there is no such file.

        Raises:
            DatasetError: the file is malformed.
        """
        path = self._mav0 / "imu0" / "sensor.yaml"
        if not path.is_file():
            return None
        sensor = read_sensor_yaml(path)
        values: dict[str, Any] = {ours: sensor[theirs] for theirs, ours in _NOISE_KEYS.items() if theirs in sensor}
        T_body_imu = _transform(path, sensor)
        if T_body_imu is not None:
            values["position_body_m"] = tuple(T_body_imu[:3, 3].tolist())
            values["rotation_body_imu_rpy_rad"] = tuple(
                Rotation.from_matrix(T_body_imu[:3, :3]).as_euler("xyz").tolist()
            )
        return ImuCalibration.parse(values, str(path))

    def _tables(self, tally: ReadTally) -> list[SampleTable]:
        found = [table for name in _SENSORS for table in self._table(name, tally)]
        if not found:
            raise DatasetError(
                f"{self._mav0} has nothing to read without a robot but imu0, and imu0 is absent; name one"
            )
        return found

    def _table(self, sensor: str, tally: ReadTally) -> Iterator[SampleTable]:
        path = self._mav0 / sensor / "data.csv"
        label = f"{sensor}/data.csv"
        if not path.is_file():
            if sensor != "foot_force0":
                tally.note(f"{label} is absent")
            return
        if sensor != "imu0" and self._robot is None:
            tally.note(f"{label} is left unread: no robot was named")
            return
        table = CsvTable.open(path)
        header = Header(path, table.header, self._config.columns)
        stamp = header.stamp()
        match sensor, self._robot:
            case "joints0", RobotDescription() as robot:
                samples = SampleTable(table, label, stamp, joints=header.joints(robot))
            case "foot_force0", RobotDescription() as robot:
                samples = SampleTable(table, label, stamp, force=header.forces(robot))
            case _:
                samples = SampleTable(table, label, stamp, imu=header.imu() or header.no_imu())
        samples.describe(header, tally)
        yield samples

    def _read_ground_truth(self, tally: ReadTally) -> GroundTruth | None:
        for sensor in _GROUND_TRUTH_SENSORS:
            path = self._mav0 / sensor / "data.csv"
            if path.is_file():
                truth = read_ground_truth(path, self._config.columns, tally)
                return _at_body(truth, path.with_name("sensor.yaml"), f"{sensor}/data.csv")
        path = self._mav0.resolve().parent / "groundtruth.tum"
        return read_ground_truth(path, self._config.columns, tally) if path.is_file() else None


def is_euroc_folder(path: Path) -> bool:
    """Whether ``path`` holds, or is, a ``mav0`` with an IMU or joints."""
    mav0 = _mav0(path)
    return mav0.resolve().name == "mav0" and any((mav0 / sensor / "data.csv").is_file() for sensor in _SENSORS)


def joint_header(path: Path, columns: ColumnNames) -> tuple[Path, tuple[str, ...]]:
    """The file that holds the joints, and its column names; no names where it is absent."""
    joints = _mav0(path) / "joints0" / "data.csv"
    return joints, CsvTable.open(joints).header if joints.is_file() else ()


def read_sensor_yaml(path: Path) -> dict[str, Any]:
    """The mapping in a ``sensor.yaml``, whose ``%YAML:1.0`` line and OpenCV tags are no YAML.

    Raises:
        DatasetError: it cannot be read.
    """
    try:
        text = path.read_text(encoding="utf-8").replace("!!opencv-matrix", "")
        values = yaml.safe_load("\n".join(line for line in text.splitlines() if not line.startswith("%")))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise DatasetError(f"cannot read {path}: {error}") from error
    if not isinstance(values, dict):
        raise DatasetError(f"{path} must hold a mapping of keys to values, it holds a {type(values).__name__}")
    return values


def _mav0(path: Path) -> Path:
    return path / "mav0" if (path / "mav0").is_dir() else path


def _transform(path: Path, sensor: dict[str, Any]) -> Array | None:
    """``T_body_sensor`` (4, 4) from the key ``T_BS``, given as OpenCV matrix or as nested lists."""
    given = sensor.get("T_BS")
    if given is None:
        return None
    try:
        matrix = np.array(given["data"] if isinstance(given, dict) else given, dtype=np.float64).reshape(4, 4)
    except (KeyError, TypeError, ValueError) as error:
        raise DatasetError(f"{path}: T_BS must be a matrix of 4 x 4 numbers ({error})") from error
    rotation = matrix[:3, :3]
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3) or np.linalg.det(rotation) < 0:
        raise DatasetError(f"{path}: T_BS holds no rotation; keys there are {listing(sensor)}")
    return matrix


def _at_body(truth: GroundTruth, sensor_yaml: Path, source: str) -> GroundTruth:
    """The body's poses from those of a marker mounted at ``T_BS``."""
    T_body_sensor = _transform(sensor_yaml, read_sensor_yaml(sensor_yaml)) if sensor_yaml.is_file() else None
    trajectory = truth.trajectory
    if T_body_sensor is None or np.array_equal(T_body_sensor, np.eye(4)):
        return GroundTruth(trajectory, truth.has_stamps, source)
    # The marker's velocity is not the body's.
    moved = Trajectory(trajectory.stamps_ns, trajectory.T_world_body @ se3.inverse(T_body_sensor))
    return GroundTruth(moved, truth.has_stamps, source)

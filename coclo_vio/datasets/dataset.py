# SPDX-License-Identifier: BSD-3-Clause
"""The door to recordings: the protocol every reader fulfils, the registry of formats, which robot it can be of.

A further format is one file, and one row in ``FORMATS``.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from coclo_vio.datasets import euroc_folder, kitti_odometry, leg_log, stereo_tracks
from coclo_vio.datasets.columns import ColumnNames
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.read_report import ReadReport, StreamReport
from coclo_vio.datasets.robot_fit import RobotFit, fit_of
from coclo_vio.datasets.rosbag import reader as rosbag
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.calibration import ImuCalibration, StereoCalibration
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.measurements import LEG_SENSORS, Measurement
from coclo_vio.values.trajectory import GroundTruth

__all__ = [
    "FORMATS",
    "Dataset",
    "DatasetConfig",
    "Format",
    "ReadReport",
    "RobotFit",
    "StreamReport",
    "guess_robot",
    "open_dataset",
    "robot_fit",
]


class Dataset(Protocol):
    """A recording, whatever its format."""

    name: str

    def measurements(self, sensors: frozenset[type] = LEG_SENSORS) -> Iterator[Measurement]:
        """All samples of ``sensors`` in time order, from the beginning each time; no image is decoded unasked.

        Raises:
            DatasetError: the recording is malformed.
        """

    def ground_truth(self) -> GroundTruth | None:
        """The reference trajectory, or None where there is none.

        Raises:
            DatasetError: it is malformed.
        """

    def imu_calibration(self) -> ImuCalibration | None:
        """Mounting and noise of the IMU where the recording says them, otherwise None.

        Raises:
            DatasetError: it is malformed.
        """

    def camera_imu_calibration(self) -> ImuCalibration | None:
        """Mounting (``T_body_camera_imu``) and noise of the camera's IMU where the recording says them, otherwise None.

        Raises:
            DatasetError: it is malformed.
        """

    def stereo_calibration(self) -> StereoCalibration | None:
        """Lenses and mounting of the two cameras where the recording says them, otherwise None.

        Raises:
            DatasetError: it is malformed.
        """

    def report(self) -> ReadReport:
        """What the recording holds and what was left out; reads it through if that has not been done.

        Covers every sensor; stereo frames are counted by their stamps, without decoding an image.

        Raises:
            DatasetError: the recording is malformed.
        """


@dataclass(frozen=True, slots=True)
class Format:
    """One kind of recording.

    Attributes:
        name: what it is called.
        looks_for: what makes a path a recording of this kind, for the error message.
        matches: whether a path is one.
        open: makes the reader.
        joint_names: the file that holds the joints, and their names.
    """

    name: str
    looks_for: str
    matches: Callable[[Path], bool]
    open: Callable[[Path, RobotDescription | None, DatasetConfig], Dataset]
    joint_names: Callable[[Path, ColumnNames], tuple[Path, tuple[str, ...]]]


FORMATS: tuple[Format, ...] = (
    Format(
        euroc_folder.EurocFolder.format_name,
        euroc_folder.LOOKS_FOR,
        euroc_folder.is_euroc_folder,
        euroc_folder.EurocFolder,
        euroc_folder.joint_names,
    ),
    Format(rosbag.RosBag.format_name, rosbag.LOOKS_FOR, rosbag.is_rosbag, rosbag.RosBag, rosbag.joint_names),
    Format(
        kitti_odometry.KittiOdometry.format_name,
        kitti_odometry.LOOKS_FOR,
        kitti_odometry.is_kitti_odometry,
        kitti_odometry.KittiOdometry,
        kitti_odometry.joint_names,
    ),
    Format(
        stereo_tracks.StereoTrackFile.format_name,
        stereo_tracks.LOOKS_FOR,
        stereo_tracks.is_stereo_tracks,
        stereo_tracks.StereoTrackFile,
        stereo_tracks.joint_names,
    ),
    Format(leg_log.LegLog.format_name, leg_log.LOOKS_FOR, leg_log.is_leg_log, leg_log.LegLog, leg_log.joint_names),
)


def open_dataset(path: Path, robot: RobotDescription | None, config: DatasetConfig | None = None) -> Dataset:
    """The recording at ``path``, of whatever format it is.

    Args:
        path: a file or a folder.
        robot: whose joints and legs to look for; None reads all but the legs.
        config: how to read; the defaults if None.

    Raises:
        DatasetError: no such path, no known format (says what was looked for), or a malformed recording.
    """
    return _format_of(path).open(path, robot, config or DatasetConfig())


def guess_robot(path: Path, config: DatasetConfig | None = None) -> str | None:
    """The name of the known robot whose joints all have a column in the recording at ``path``.

    Among several, those with the most joints are kept, then the one whose name occurs in the name of the folder or
    file; None where none fits, or where several do and no name decides. Where partial reading is allowed a robot fits
    that lacks some joints.

    Raises:
        DatasetError: no such path, or no known format.
    """
    config = config or DatasetConfig()
    file, fit = _joints_of(path, config)
    return fit.guess(f"{path.resolve().name} {file.name}", takes_nearest=config.allow_partial)


def robot_fit(path: Path, config: DatasetConfig | None = None) -> RobotFit:
    """How far the joints in the recording at ``path`` are those of the known robots.

    Raises:
        DatasetError: no such path, or no known format.
    """
    return _joints_of(path, config or DatasetConfig())[1]


def _joints_of(path: Path, config: DatasetConfig) -> tuple[Path, RobotFit]:
    file, names = _format_of(path).joint_names(path, config.columns)
    return file, fit_of(names)


def _format_of(path: Path) -> Format:
    if not path.exists():
        raise DatasetError(f"there is no {path}; give the path of a recording, a file or a folder")
    for candidate in FORMATS:
        if candidate.matches(path):
            return candidate
    wanted = "; ".join(candidate.looks_for for candidate in FORMATS)
    raise DatasetError(f"{path} is no recording of a known format; looked for {wanted}")

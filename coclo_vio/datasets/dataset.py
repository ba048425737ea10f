# SPDX-License-Identifier: BSD-3-Clause
"""Opening recordings: the protocol of every reader, the registry of formats, the robots that a recording fits.

A further format is one file: a reader class, and ``register_format`` with its name and a function that recognises it.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from coclo_vio.datasets import euroc_folder, kitti_odometry, leg_log, stereo_track_file
from coclo_vio.datasets.columns import ColumnNames
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.corrected_dataset import CorrectedDataset
from coclo_vio.datasets.read_report import ReadReport, StreamReport
from coclo_vio.datasets.robot_fit import RobotFit, fit_of
from coclo_vio.datasets.rosbag import reader as rosbag
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.calibration import ImuCalibration, StereoCalibration
from coclo_vio.values.errors import DatasetError, listing, shortened
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
    "register_format",
    "robot_fit",
]


class Dataset(Protocol):
    """A recording of any format."""

    name: str

    def measurements(self, sensors: frozenset[type] = LEG_SENSORS) -> Iterator[Measurement]:
        """All samples of ``sensors`` in time order, from the beginning at each call; other images are not decoded.

        Raises:
            DatasetError: the recording is malformed.
        """

    def ground_truth(self) -> GroundTruth | None:
        """The reference trajectory, or None.

        Raises:
            DatasetError: it is malformed.
        """

    def imu_calibration(self) -> ImuCalibration | None:
        """The recording's mounting and noise of the body's IMU, or None.

        Raises:
            DatasetError: it is malformed.
        """

    def camera_imu_calibration(self) -> ImuCalibration | None:
        """The recording's mounting (``T_body_camera_imu``) and noise of the camera's IMU, or None.

        Raises:
            DatasetError: it is malformed.
        """

    def stereo_calibration(self) -> StereoCalibration | None:
        """The recording's intrinsics and mounting of the two cameras, or None.

        Raises:
            DatasetError: it is malformed.
        """

    def report(self) -> ReadReport:
        """What the recording holds and what was left out; reads the recording through if that has not been done.

        Covers every sensor; stereo frames are counted by their stamps, without decoding an image.

        Raises:
            DatasetError: the recording is malformed.
        """


JointNames = Callable[[Path, ColumnNames], tuple[Path, tuple[str, ...]]]


def no_joints(path: Path, columns: ColumnNames) -> tuple[Path, tuple[str, ...]]:
    """The joint names of a format without joints: none."""
    return path, ()


@dataclass(frozen=True, slots=True)
class Format:
    """A format of recordings.

    Attributes:
        name: its name.
        layout: the files that make up a recording, for the error message on an unknown path.
        matches: whether a path is a recording of this format.
        open: the reader class, called with path, robot (or None) and configuration.
        joint_names: the file that holds the joints of a recording, and their names.
    """

    name: str
    layout: str
    matches: Callable[[Path], bool]
    open: Callable[[Path, RobotDescription | None, DatasetConfig], Dataset]
    joint_names: JointNames = no_joints


FORMATS: list[Format] = [
    Format(
        euroc_folder.EurocFolder.format_name,
        euroc_folder.LAYOUT,
        euroc_folder.is_euroc_folder,
        euroc_folder.EurocFolder,
        euroc_folder.joint_names,
    ),
    Format(rosbag.RosBag.format_name, rosbag.LAYOUT, rosbag.is_rosbag, rosbag.RosBag, rosbag.joint_names),
    Format(
        kitti_odometry.KittiOdometry.format_name,
        kitti_odometry.LAYOUT,
        kitti_odometry.is_kitti_odometry,
        kitti_odometry.KittiOdometry,
    ),
    Format(
        stereo_track_file.StereoTrackFile.format_name,
        stereo_track_file.LAYOUT,
        stereo_track_file.is_stereo_track_file,
        stereo_track_file.StereoTrackFile,
    ),
    Format(leg_log.LegLog.format_name, leg_log.LAYOUT, leg_log.is_leg_log, leg_log.LegLog, leg_log.joint_names),
]
"""The known formats; the first that matches a path opens it."""


def register_format(
    name: str,
    matches: Callable[[Path], bool],
    reader: Callable[[Path, RobotDescription | None, DatasetConfig], Dataset],
    *,
    layout: str = "",
    joint_names: JointNames = no_joints,
) -> None:
    """Add a format, which is tried before those already known.

    Args:
        name: its name, in reports and error messages.
        matches: whether a path is a recording of this format; called with paths that exist.
        reader: the class that fulfils ``Dataset``, called with path, robot (or None) and configuration.
        layout: the files that make up a recording, for the error message on an unknown path.
        joint_names: the file that holds the joints of a recording, and their names, from which the robot is inferred.

    Raises:
        DatasetError: the name is taken.
    """
    if name in {known.name for known in FORMATS}:
        raise DatasetError(
            f"the format {name} is registered already; choose a name other than {listing(f.name for f in FORMATS)}"
        )
    FORMATS.insert(0, Format(name, layout, matches, reader, joint_names))


def open_dataset(path: Path, robot: RobotDescription | None, config: DatasetConfig | None = None) -> Dataset:
    """The recording at ``path``, of any known format, corrected as configured.

    Args:
        path: a file or a folder.
        robot: its joints and legs are read; with None only the sensors that need no robot.
        config: how to read; the defaults if None.

    Raises:
        DatasetError: no such path, no known format (lists the formats), or a malformed recording.
    """
    config = config or DatasetConfig()
    dataset = _format_of(path).open(path, robot, config)
    if config.corrections.is_none:
        return dataset
    return CorrectedDataset(dataset, config.corrections, robot, config.joint_velocity)


def guess_robot(path: Path, config: DatasetConfig | None = None) -> str | None:
    """The name of the known robot whose joints are all in the recording at ``path``.

    Of several, those with the most joints are kept, then the one whose name occurs in the name of the folder or file;
    None where none fits, or where several do and no name decides. Where partial reading is allowed a robot fits that
    lacks some joints.

    Raises:
        DatasetError: no such path, or no known format.
    """
    config = config or DatasetConfig()
    file, fit = _joints_of(path, config)
    return fit.guess(f"{path.resolve().name} {file.name}", takes_nearest=config.allow_partial)


def robot_fit(path: Path, config: DatasetConfig | None = None) -> RobotFit:
    """How well the joints in the recording at ``path`` fit the known robots.

    Raises:
        DatasetError: no such path, or no known format.
    """
    return _joints_of(path, config or DatasetConfig())[1]


def _joints_of(path: Path, config: DatasetConfig) -> tuple[Path, RobotFit]:
    file, names = _format_of(path).joint_names(path, config.columns)
    return file, fit_of(names)


def _format_of(path: Path) -> Format:
    try:
        exists = path.exists()
        found = next((candidate for candidate in FORMATS if exists and candidate.matches(path)), None)
    except OSError as error:  # a name that is too long, a folder that may not be read
        raise DatasetError(f"cannot read {shortened(path)}: {error.strerror}; pass the path of a recording") from error
    if not exists:
        raise DatasetError(f"{shortened(path)} does not exist; pass the path of a recording, a file or a folder")
    if found is not None:
        return found
    known = "; ".join(f"{known.name} ({known.layout})" if known.layout else known.name for known in FORMATS)
    raise DatasetError(
        f"{path} is not a recording of a known format; the formats are: {known}; "
        "add another with coclo_vio.datasets.dataset.register_format"
    )

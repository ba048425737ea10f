# SPDX-License-Identifier: BSD-3-Clause
"""The door to recordings: the protocol every reader fulfils, the registry of formats, and which robot a log fits.

A further format is one file, and one row in ``FORMATS``.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from coclo_vio.calibration import ImuCalibration, StereoCalibration
from coclo_vio.datasets import euroc_folder, leg_log
from coclo_vio.datasets.columns import ColumnNames, Header
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.report import ReadReport, StreamReport
from coclo_vio.datasets.rosbag import reader as rosbag
from coclo_vio.errors import DatasetError
from coclo_vio.measurements import LEG_SENSORS, Measurement
from coclo_vio.robot.description import RobotDescription, load_robot, robot_names
from coclo_vio.trajectory import GroundTruth

__all__ = [
    "FORMATS",
    "Dataset",
    "DatasetConfig",
    "Format",
    "ReadReport",
    "StreamReport",
    "guess_robot",
    "open_dataset",
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
        joint_header: the file that holds the joints, and its column names.
    """

    name: str
    looks_for: str
    matches: Callable[[Path], bool]
    open: Callable[[Path, RobotDescription | None, DatasetConfig], Dataset]
    joint_header: Callable[[Path, ColumnNames], tuple[Path, tuple[str, ...]]]


FORMATS: tuple[Format, ...] = (
    Format(
        euroc_folder.EurocFolder.format_name,
        euroc_folder.LOOKS_FOR,
        euroc_folder.is_euroc_folder,
        euroc_folder.EurocFolder,
        euroc_folder.joint_header,
    ),
    Format(rosbag.RosBag.format_name, rosbag.LOOKS_FOR, rosbag.is_rosbag, rosbag.RosBag, rosbag.joint_header),
    Format(leg_log.LegLog.format_name, leg_log.LOOKS_FOR, leg_log.is_leg_log, leg_log.LegLog, leg_log.joint_header),
)


def open_dataset(path: Path, robot: RobotDescription | None, config: DatasetConfig | None = None) -> Dataset:
    """The recording at ``path``, of whatever format it is.

    Args:
        path: a file or a folder.
        robot: whose joints and legs to look for; None reads the IMU alone.
        config: how to read; the defaults if None.

    Raises:
        DatasetError: no such path, no known format (says what was looked for), or a malformed recording.
    """
    return _format_of(path).open(path, robot, config or DatasetConfig())


def guess_robot(path: Path, config: DatasetConfig | None = None) -> str | None:
    """The name of the known robot whose joints all have a column in the recording at ``path``.

    Among several, those with the most joints are kept, then the one whose name occurs in the name of the folder or
    file; None where none fits, or where several do and no name decides.

    Raises:
        DatasetError: no such path, or no known format.
    """
    columns = (config or DatasetConfig()).columns
    file, names = _format_of(path).joint_header(path, columns)
    header = Header(file, names, columns)
    fitting: dict[str, int] = {}
    for name in robot_names():
        found = header.find_joints(load_robot(name))
        if all(index is not None for index in found):
            fitting[name] = len(found)
    best = [name for name, joints in fitting.items() if joints == max(fitting.values())]
    if len(best) <= 1:
        return best[0] if best else None
    spoken = f"{path.resolve().name} {file.name}".lower()
    named = [name for name in best if re.search(rf"(?<![a-z0-9]){re.escape(name.lower())}(?![a-z0-9])", spoken)]
    return named[0] if len(named) == 1 else None


def _format_of(path: Path) -> Format:
    if not path.exists():
        raise DatasetError(f"there is no {path}; give the path of a recording, a file or a folder")
    for candidate in FORMATS:
        if candidate.matches(path):
            return candidate
    wanted = "; ".join(candidate.looks_for for candidate in FORMATS)
    raise DatasetError(f"{path} is no recording of a known format; looked for {wanted}")

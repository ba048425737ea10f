# SPDX-License-Identifier: BSD-3-Clause
"""The leg log: one CSV file with a row for each time, read by its header.

Canonical columns, as ``writer.write_leg_log`` writes them; only the stamp and the joints' angles are required::

    stamp_ns  (or time_s)                                 integer nanoseconds (or decimal seconds)
    gyro_x_radps  gyro_y_radps  gyro_z_radps              rad/s, imu frame
    accel_x_mps2  accel_y_mps2  accel_z_mps2              specific force, m/s^2, imu frame
    <joint>.position  <joint>.velocity  <joint>.effort    rad, rad/s, Nm
    <leg>.force                                           in the unit of the robot's contact thresholds

``nan`` is a failed reading; where all cells of a sensor are empty it has no sample in that row. Other column names
are patterns in ``DatasetConfig.columns``; those of the Unitree Go1 motion-capture log (``Time(s)``, ``FR_Force``,
``BaseAx``, ``BaseWx``, ``JointPosFR_hip``) are among the defaults.

A folder holds the log under any name, and at most one of ``groundtruth.tum``, ``groundtruth.csv``, ``mocap.csv``, or
TUM lines in a text file of any other name.
"""

from pathlib import Path

from coclo_vio.datasets.columns import ColumnNames, Header
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.csv_table import CsvTable
from coclo_vio.datasets.ground_truth import read_ground_truth, tum_files
from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.datasets.recording_reader import RecordingReader
from coclo_vio.datasets.sample_table import SampleTable
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.errors import DatasetError, listing
from coclo_vio.values.trajectory import GroundTruth

GROUND_TRUTH_NAMES = ("groundtruth.tum", "groundtruth.csv", "mocap.csv")
LAYOUT = "a .csv file, or a folder with one (columns stamp_ns or time_s, gyro_x_radps, <joint>.position)"


class LegLog(RecordingReader):
    """A leg log, alone or in its folder."""

    format_name = "leg log"

    def __init__(self, path: Path, robot: RobotDescription | None, config: DatasetConfig) -> None:
        """Find the columns of ``robot``; without a robot only the IMU is read.

        Raises:
            TopicNotFound: a column is missing; lists those that exist.
            DatasetError: several logs in the folder, or a file that cannot be read.
        """
        self._log = find_log(path, config.columns)
        super().__init__(path.resolve().name if path.is_dir() else path.stem, config)
        self._header = CsvTable.open(self._log).header
        self._robot = robot
        self._tables(ReadTally(self.format_name, config.gap_s))

    def _tables(self, tally: ReadTally) -> list[SampleTable]:
        return [sample_table(CsvTable(self._log, self._header), self._robot, self._config, tally)]

    def _read_ground_truth(self, tally: ReadTally) -> GroundTruth | None:
        folder = self._log.parent
        if len(_logs_in(folder, self._config.columns)) > 1:
            tally.note(
                f"{folder.resolve().name} holds several logs: the ground truth beside them cannot be assigned to one "
                "and is not read"
            )
            return None
        found = [folder / name for name in GROUND_TRUTH_NAMES if (folder / name).is_file()] or tum_files(folder)
        if not found:
            return None
        if len(found) > 1:
            tally.note(
                f"several ground truth files: {found[0].name} is read, not {listing(path.name for path in found[1:])}"
            )
        return read_ground_truth(found[0], self._config.columns, tally)


def sample_table(
    table: CsvTable, robot: RobotDescription | None, config: DatasetConfig, tally: ReadTally
) -> SampleTable:
    """The sensors in the columns of a log; notes on them go to ``tally``.

    Raises:
        TopicNotFound: a column is missing; lists those that exist.
    """
    header = Header(table.path, table.header, config.columns)
    samples = SampleTable(
        table,
        table.path.name,
        header.stamp(),
        imu=header.required_imu() if robot is None else header.imu(),
        joints=None if robot is None else header.joints(robot),
        force=None if robot is None else header.forces(robot),
    )
    if samples.imu is None:
        tally.note(f"{samples.label}: no IMU in the log")
    samples.describe(header, tally)
    return samples


def is_leg_log(path: Path) -> bool:
    """Whether ``path`` is a CSV file, or a folder with a CSV file that is not ground truth."""
    return path.suffix.lower() == ".csv" if path.is_file() else bool(_csv_files(path))


def find_log(path: Path, columns: ColumnNames) -> Path:
    """The log at ``path``, or the only one in the folder ``path``.

    Raises:
        DatasetError: none, or several.
    """
    if path.is_file():
        return path
    logs = _logs_in(path, columns)
    files = [file.name for file in _csv_files(path)]
    if not logs and files:
        accepted = listing(columns.stamp_ns + columns.stamp_s)
        raise DatasetError(
            f"none of the {len(files)} CSV files in {path} ({listing(files)}) has a time column ({accepted}): a leg "
            "log is one file with time, IMU and joints; name its time column in dataset.columns.stamp_ns or stamp_s"
        )
    if len(logs) != 1:
        listed = listing(log.name for log in logs)
        raise DatasetError(f"{path} holds {len(logs)} leg logs ({listed}); pass the path of one of them")
    return logs[0]


def joint_names(path: Path, columns: ColumnNames) -> tuple[Path, tuple[str, ...]]:
    """The file that holds the joints, and their names."""
    log = find_log(path, columns)
    return log, Header(log, CsvTable.open(log).header, columns).joint_names()


def _csv_files(folder: Path) -> list[Path]:
    return [path for path in sorted(folder.glob("*.csv")) if path.name not in GROUND_TRUTH_NAMES]


def _logs_in(folder: Path, columns: ColumnNames) -> list[Path]:
    """The CSV files that can be logs: the only one, or those with a time column."""
    files = _csv_files(folder)
    if len(files) <= 1:
        return files
    return [path for path in files if Header(path, CsvTable.open(path).header, columns).find_stamp() is not None]

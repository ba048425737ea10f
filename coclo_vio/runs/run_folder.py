# SPDX-License-Identifier: BSD-3-Clause
"""The folder of a run: trajectories, states, ground truth, configuration and ``run.json``.

Estimates are written as they come, sixteen at a time, and ``run.json`` every second, so a run that is killed leaves
what it had; here that is read back.
"""

import csv
import errno
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np

from coclo_vio.runs.run_record import Interval, RunRecord, union
from coclo_vio.runs.state_writer import STATE_COLUMNS, UPPER, VECTORS
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import DatasetError, TimestampError, listing
from coclo_vio.values.trajectory import GroundTruth, Trajectory, parse_tum, read_lines, read_tum, write_tum
from coclo_vio.values.whole_files import WholeLines

RUN_JSON = "run.json"
_TRAJECTORY_SUFFIXES = (".tum", "_state.csv", "_keyframes.csv", "_calibration.csv")
_RESULTS = (RUN_JSON, "compare.json", "ranking.json", "report.html")
_OF_TIMES = ("latency.json", "live.json")  # of play and live
_FULL = (errno.ENOSPC, errno.EDQUOT)
_FIXED_NAMES = ("groundtruth.tum", "config.yaml", *_OF_TIMES, *_RESULTS)


class Existing(StrEnum):
    """What becomes of results that are in a folder already."""

    REFUSE = "refuse"
    """They stay, and nothing is run."""
    OVERWRITE = "overwrite"
    """They are removed."""
    RESUME = "resume"
    """Their run goes on where it stopped."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedTrajectory:
    """One trajectory of a run folder.

    Attributes:
        name: of the trajectory.
        trajectory: with velocity and covariance where the state file is there.
        contact_probability: (N, legs); no column where unknown.
        leg_names: the columns of ``contact_probability``.
        angular_velocity_body: without bias, rad/s, body frame, (N, 3); None without a state file.
        gyroscope_bias: rad/s, body frame, (N, 3); None without a state file.
        accelerometer_bias: m/s^2, body frame, (N, 3); None without a state file.
        notes: sentences on lines that are left out because the run was stopped as it wrote them.
    """

    name: str
    trajectory: Trajectory
    contact_probability: Array
    leg_names: tuple[str, ...]
    angular_velocity_body: Array | None = None
    gyroscope_bias: Array | None = None
    accelerometer_bias: Array | None = None
    notes: tuple[str, ...] = ()


def prepare(folder: Path) -> Path:
    """Make the folder.

    Raises:
        DatasetError: it cannot be made, or is a file.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DatasetError(f"cannot make the folder {folder}: {error.strerror}; choose another folder") from error
    return folder


WITHOUT_RESUME = "give --overwrite to replace them, or another folder with -o"
"""The choices of a command that cannot go on with an earlier run."""
_CHOICES = "give --overwrite to replace them, --resume to go on with that run, or another folder with -o"


def check_free(folder: Path, choices: str = _CHOICES) -> None:
    """See that a folder holds no results of an earlier run.

    Args:
        folder: for results.
        choices: what can be done about them.

    Raises:
        DatasetError: it does; names the folder and the choices.
    """
    found = next((name for name in _RESULTS if (folder / name).exists()), None)
    if found is not None:
        raise DatasetError(
            f"{folder} holds the results of an earlier run ({found}), which would be overwritten; {choices}"
        )


def clear(folder: Path) -> None:
    """Remove what an earlier run wrote into a folder, so that none of it is taken for this run's.

    Only files of the trajectories and modes that the earlier ``run.json`` names go, and those of fixed names; without a
    readable ``run.json`` everything stays.

    Raises:
        DatasetError: a file cannot be removed.
    """
    try:
        earlier = RunRecord.read(folder / RUN_JSON)
    except DatasetError:
        return
    names = [f"{name}{suffix}" for name in earlier.estimators for suffix in _TRAJECTORY_SUFFIXES]
    with writing(folder):
        for name in (*names, *_FIXED_NAMES):
            (folder / name).unlink(missing_ok=True)
        for mode in earlier.by_mode():
            for picture in (folder / "debug_images" / mode).glob("*.jpg"):
                picture.unlink()


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Turns an error of the file system inside the folder into one that names the file.

    Raises:
        DatasetError: a file cannot be written.
    """
    try:
        yield
    except OSError as error:
        what = f"cannot write {error.filename or folder}: {error.strerror or error}"
        if error.errno in _FULL:
            raise DatasetError(
                f"{what}; what was written before stays: make room and go on with --resume, or choose another folder"
            ) from error
        raise DatasetError(f"{what}; choose another folder") from error


def write_ground_truth(folder: Path, truth: GroundTruth) -> None:
    """Write ``groundtruth.tum``; whether its stamps are real goes to ``run.json``."""
    write_tum(truth.trajectory, folder / "groundtruth.tum")


def write_record(folder: Path, record: RunRecord) -> None:
    """Write ``run.json``."""
    record.write(folder / RUN_JSON)


def read_record(folder: Path) -> RunRecord:
    """``run.json`` of a run folder. Of modes that were killed as they ran it has what their files hold.

    Raises:
        DatasetError: there is none, it is malformed, or of another version of its schema.
    """
    path = folder / RUN_JSON
    if not path.is_file():
        raise DatasetError(
            f"{folder} is no run folder: it has no {RUN_JSON}; give the folder that `coclo-vio run -o` wrote"
        )
    record = RunRecord.read(path)
    estimators, recording_ns = dict(record.estimators), record.recording_ns
    for name, run in record.estimators.items():
        if run.status == "finished":
            continue
        found: Interval | None = None
        estimates = 0
        with suppress(DatasetError):  # it has no pose
            stamps_ns = _read_poses(folder, name)[0].stamps_ns
            estimates, found = len(stamps_ns), (int(stamps_ns[0]), int(stamps_ns[-1]))
        last_ns = None if found is None else found[1]
        estimators[name] = run.model_copy(update={"estimates": estimates, "last_ns": last_ns})
        recording_ns = union(recording_ns, found)
    return record.model_copy(update={"estimators": estimators, "recording_ns": recording_ns})


def read_ground_truth(folder: Path, record: RunRecord) -> GroundTruth | None:
    """The ground truth of a run folder, None where there is none.

    Raises:
        DatasetError: it is malformed.
    """
    described = record.ground_truth
    path = folder / "groundtruth.tum"
    if described is None or not path.exists():
        return None
    return GroundTruth(read_tum(path), described.has_stamps, described.source)


def read_estimates(folder: Path, name: str) -> RecordedTrajectory:
    """One estimator's trajectory and states.

    What a run that was stopped left half written is left out: a last line that was cut short, and poses whose state
    was not written any more.

    Raises:
        DatasetError: a file is missing or malformed.
    """
    poses, columns, notes = _read_poses(folder, name)
    if not columns:
        return RecordedTrajectory(name, poses, np.zeros((len(poses), 0)), (), notes=notes)
    covariance = np.zeros((len(poses), 6, 6))
    for row, column in UPPER:
        covariance[:, row, column] = covariance[:, column, row] = columns[f"pose_covariance_{row}{column}"]
    velocity, rate, gyroscope_bias, accelerometer_bias = (
        np.stack([columns[f"{vector}_{axis}"] for axis in "xyz"], axis=1) for vector in VECTORS
    )
    trajectory = Trajectory(poses.stamps_ns, poses.T_world_body, velocity, covariance)
    legs = tuple(column.rpartition(".")[0] for column in columns if column.endswith(".contact_probability"))
    probability = np.array([columns[f"{leg}.contact_probability"] for leg in legs]).reshape(len(legs), len(poses)).T
    return RecordedTrajectory(name, trajectory, probability, legs, rate, gyroscope_bias, accelerometer_bias, notes)


def _read_poses(folder: Path, name: str) -> tuple[Trajectory, dict[str, Array], tuple[str, ...]]:
    """The poses (N,), the columns (N,) of their state file, if there is one, and notes on lines left out."""
    path, state_path = folder / f"{name}.tum", folder / f"{name}_state.csv"
    read = read_lines(path)
    notes = list(filter(None, [read.cut_note(path)]))
    poses = parse_tum(read.lines, path)
    if not state_path.exists():
        return poses, {}, tuple(notes)
    header, rows, cut_note = _read_states(state_path)
    notes += filter(None, [cut_note])
    if len(rows) != len(poses):
        if not notes and not _is_unfinished(folder, name):
            raise DatasetError(f"{state_path} has {len(rows)} rows for the {len(poses)} poses beside it; run again")
        count = min(len(rows), len(poses))
        if not count:
            raise TimestampError(f"{state_path} holds no state: the run was stopped before it wrote one; run again")
        left_out = abs(len(rows) - len(poses))
        notes.append(f"{left_out} of the last estimates are left out: the run was stopped before they were whole")
        poses, rows = poses.select(np.arange(count)), rows[:count]
    return poses, _columns(state_path, header, rows, poses), tuple(notes)


def _is_unfinished(folder: Path, name: str) -> bool:
    """Whether the run of a trajectory was stopped, as far as the folder's record says."""
    try:
        run = RunRecord.read(folder / RUN_JSON).estimators.get(name)
    except DatasetError:
        return False
    return run is not None and run.status != "finished"


def _read_states(path: Path) -> tuple[list[str], list[list[float]], str | None]:
    """Header and rows of a state file, and a note where its last line is left out."""
    try:
        read = WholeLines.read(path)
        header = next(csv.reader(read.lines[:1]), [])
        rows = [[float(cell) for cell in row] for row in csv.reader(read.lines[1:])]
    except (OSError, ValueError, csv.Error) as error:
        raise DatasetError(f"{path}: {error}; run again, or delete it to do without velocities") from error
    return header, rows, read.cut_note(path)


def _columns(path: Path, header: list[str], rows: list[list[float]], poses: Trajectory) -> dict[str, Array]:
    """The columns (N,) of a state file that stands beside N poses, by name."""
    missing = [name for name in STATE_COLUMNS if name not in header]
    if missing:
        raise DatasetError(f"{path} lacks the columns {listing(missing)}; run again")
    ragged = next((number for number, row in enumerate(rows) if len(row) != len(header)), None)
    if ragged is not None:
        raise DatasetError(
            f"{path}, line {ragged + 2}: {len(rows[ragged])} cells under a header of {len(header)} columns; run again"
        )
    table = np.array(rows)
    if not np.isfinite(table).all():
        row, column = (int(index) for index in np.argwhere(~np.isfinite(table))[0])
        raise DatasetError(f"{path}, line {row + 2}: {header[column]} is {table[row, column]}, not finite; run again")
    if (table[:, header.index("stamp_ns")] != poses.stamps_ns).any():
        raise DatasetError(f"{path} has other stamps than the poses beside it; run again")
    return dict(zip(header, table.T, strict=True))

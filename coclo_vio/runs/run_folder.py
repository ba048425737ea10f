# SPDX-License-Identifier: BSD-3-Clause
"""The folder of a run: trajectories, states, ground truth, configuration and ``run.json``.

Estimates are written as they come, sixteen at a time, so a run that stops early leaves what it had.
"""

import csv
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import TextIOWrapper
from pathlib import Path

import numpy as np

from coclo_vio.runs.run_record import RunRecord
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import DatasetError, listing
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.trajectory import GroundTruth, Trajectory, read_tum, tum_lines, write_tum

RUN_JSON = "run.json"
_TRAJECTORY_SUFFIXES = (".tum", "_state.csv", "_keyframes.csv", "_calibration.csv")
_FIXED_NAMES = ("groundtruth.tum", "config.yaml", RUN_JSON, "compare.json", "ranking.json", "report.html")
_UPPER = [(row, column) for row in range(6) for column in range(row, 6)]
_UPPER_ROWS, _UPPER_COLUMNS = np.triu_indices(6)
_ROWS_AT_ONCE = 16  # a run that is killed loses fewer than these
_VECTORS = ("velocity_world", "angular_velocity_body", "gyroscope_bias", "accelerometer_bias")
_STATE_COLUMNS = (
    "stamp_ns",
    *(f"{name}_{axis}" for name in _VECTORS for axis in "xyz"),
    *(f"pose_covariance_{row}{column}" for row, column in _UPPER),
)


class StateWriter:
    """Writes ``<estimator>.tum`` and ``<estimator>_state.csv``, a line for each estimate, 16 lines at once.

    The state file has, per stamp (ns): velocity (m/s, world), angular velocity (rad/s, body), gyroscope and
    accelerometer bias (body), the upper triangle of the 6x6 pose covariance (right/local, rotation first), and, where
    the first estimate has feet, each leg's contact probability and stance.
    """

    def __init__(self, folder: Path, estimator: str, leg_names: tuple[str, ...]) -> None:
        self._tum: TextIOWrapper = (folder / f"{estimator}.tum").open("w", encoding="ascii", newline="\n")
        self._state: TextIOWrapper = (folder / f"{estimator}_state.csv").open("w", encoding="utf-8", newline="\n")
        self._leg_names = leg_names
        self._has_header = False
        self._held: list[StateEstimate] = []

    def write(self, estimate: StateEstimate) -> None:
        """Append one estimate to both files."""
        self._held.append(estimate)
        if len(self._held) == _ROWS_AT_ONCE:
            self._write_held()

    def close(self) -> None:
        """Close both files."""
        self._write_held()
        if not self._has_header:
            self._write_header(has_feet=False)
        self._tum.close()
        self._state.close()

    def _write_held(self) -> None:
        """Write the estimates that are held, and hand them to the operating system."""
        held, self._held = self._held, []
        if not held:
            return
        if not self._has_header:
            self._write_header(has_feet=held[0].feet is not None)
        stamps_ns = [estimate.stamp_ns for estimate in held]
        self._tum.writelines(tum_lines(stamps_ns, np.array([estimate.nav.T_world_body for estimate in held])))
        for estimate, row in zip(held, _state_rows(held).tolist(), strict=True):
            feet = estimate.feet
            if feet is not None:
                contacts = zip(feet.contact_probability.tolist(), feet.is_stance.tolist(), strict=True)
                row += [value for contact in contacts for value in contact]
            self._state.write(f"{estimate.stamp_ns},{','.join(['%.9g'] * len(row)) % tuple(row)}\n")
        self._tum.flush()
        self._state.flush()

    def _write_header(self, *, has_feet: bool) -> None:
        legs = self._leg_names if has_feet else ()
        feet = (f"{leg}.{what}" for leg in legs for what in ("contact_probability", "is_stance"))
        self._state.write(",".join([*_STATE_COLUMNS, *feet]) + "\n")
        self._has_header = True


def _state_rows(estimates: Sequence[StateEstimate]) -> Array:
    """What the state file has of each estimate but the feet, (n, 33)."""
    vectors = [np.array([getattr(estimate.nav, name) for estimate in estimates]) for name in _VECTORS]
    covariance = np.array([estimate.covariance for estimate in estimates])
    return np.concatenate((*vectors, covariance[:, _UPPER_ROWS, _UPPER_COLUMNS]), axis=1)


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
    """

    name: str
    trajectory: Trajectory
    contact_probability: Array
    leg_names: tuple[str, ...]
    angular_velocity_body: Array | None = None
    gyroscope_bias: Array | None = None
    accelerometer_bias: Array | None = None


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


def clear(folder: Path) -> None:
    """Remove what an earlier run wrote into a folder, so that none of it is taken for this run's.

    Only files of the trajectories and modes that the earlier ``run.json`` names go, and those of fixed names; without a
    readable ``run.json`` everything stays.

    Raises:
        DatasetError: a file cannot be removed.
    """
    try:
        earlier = read_record(folder)
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
        raise DatasetError(
            f"cannot write {error.filename or folder}: {error.strerror or error}; choose another folder"
        ) from error


def write_ground_truth(folder: Path, truth: GroundTruth) -> None:
    """Write ``groundtruth.tum``; whether its stamps are real goes to ``run.json``."""
    write_tum(truth.trajectory, folder / "groundtruth.tum")


def write_record(folder: Path, record: RunRecord) -> None:
    """Write ``run.json``."""
    record.write(folder / RUN_JSON)


def read_record(folder: Path) -> RunRecord:
    """``run.json`` of a run folder.

    Raises:
        DatasetError: there is none, it is malformed, or of another version of its schema.
    """
    path = folder / RUN_JSON
    if not path.is_file():
        raise DatasetError(
            f"{folder} is no run folder: it has no {RUN_JSON}; give the folder that `coclo-vio run -o` wrote"
        )
    return RunRecord.read(path)


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

    Raises:
        DatasetError: a file is missing or malformed.
    """
    poses = read_tum(folder / f"{name}.tum")
    path = folder / f"{name}_state.csv"
    if not path.exists():
        return RecordedTrajectory(name, poses, np.zeros((len(poses), 0)), ())
    columns = _read_states(path, poses)
    covariance = np.zeros((len(poses), 6, 6))
    for row, column in _UPPER:
        covariance[:, row, column] = covariance[:, column, row] = columns[f"pose_covariance_{row}{column}"]
    velocity, *others = (np.stack([columns[f"{vector}_{axis}"] for axis in "xyz"], axis=1) for vector in _VECTORS)
    trajectory = Trajectory(poses.stamps_ns, poses.T_world_body, velocity, covariance)
    legs = tuple(column.rpartition(".")[0] for column in columns if column.endswith(".contact_probability"))
    probability = np.array([columns[f"{leg}.contact_probability"] for leg in legs]).reshape(len(legs), len(poses)).T
    return RecordedTrajectory(name, trajectory, probability, legs, *others)


def _read_states(path: Path, poses: Trajectory) -> dict[str, Array]:
    """The columns (N,) of a state file that stands beside N poses, by name."""
    try:
        with path.open(encoding="utf-8", newline="") as lines:
            header = next(csv.reader(lines), [])
            rows = [[float(cell) for cell in row] for row in csv.reader(lines)]
    except (OSError, ValueError, csv.Error) as error:
        raise DatasetError(f"{path}: {error}; run again, or delete it to do without velocities") from error
    missing = [name for name in _STATE_COLUMNS if name not in header]
    if missing:
        raise DatasetError(f"{path} lacks the columns {listing(missing)}; run again")
    if len(rows) != len(poses):
        raise DatasetError(f"{path} has {len(rows)} rows for the {len(poses)} poses beside it; run again")
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

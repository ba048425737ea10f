# SPDX-License-Identifier: BSD-3-Clause
"""Ground truth from text files: TUM, EuRoC's CSV, motion-capture CSV with and without stamps."""

import math
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from coclo_vio.datasets.columns import ColumnNames, Header, StampColumn
from coclo_vio.datasets.csv_table import CsvTable
from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.datasets.truth_defects import lost_poses
from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.errors import DatasetError, TimestampError, listing
from coclo_vio.values.trajectory import GroundTruth, Trajectory, read_tum

UNSTAMPED_PERIOD_NS = 10_000_000
"""Step of the stamps assigned to poses without stamps; only their order is meaningful."""

_POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
_SPELLINGS: Mapping[str, tuple[str, ...]] = {
    **{axis: (axis, f"t{axis}", f"p{axis}", f"p_{axis}", f"p_RS_R_{axis}") for axis in "xyz"},
    **{f"q{axis}": (f"q{axis}", f"q_{axis}", f"q_RS_{axis}") for axis in "xyzw"},
    **{f"v{axis}": (f"v{axis}", f"v_{axis}", f"v_RS_R_{axis}") for axis in "xyz"},
}
_QUATERNION_TOLERANCE = 0.05
_TUM_FIELDS = 8
_MOST_COMMENTS = 100  # lines before the first pose
_TRUTH_NAME = re.compile(r"ground_?truth|(?<![a-z])gt(?![a-z])|mocap|vicon|optitrack|leica|reference")
_LATEST_S = 1e10  # the year 2286
_FINER_UNITS = {"milliseconds": 1_000, "microseconds": 1_000_000, "nanoseconds": 1_000_000_000}
LOST = "ground truth: pose at the origin, where the tracker lost the body"


@dataclass(frozen=True, slots=True)
class _PoseColumns:
    """Column indices of x y z qx qy qz qw, of the velocity if any, and of time."""

    pose: tuple[int, ...]
    velocity: tuple[int, ...]
    stamp: StampColumn | None


def read_ground_truth(path: Path, columns: ColumnNames, tally: ReadTally) -> GroundTruth:
    """The reference trajectory in a file of TUM lines or a CSV file; assumptions and rows left out go to ``tally``.

    The columns of a CSV file are taken by name (x y z qx qy qz qw, or EuRoC's ``p_RS_R_x`` ... ``q_RS_w``, with
    ``v_RS_R_x`` ... where present). Where the names repeat or are unknown and there are seven columns beside time, they
    are taken in the order x y z qx qy qz qw.

    Raises:
        DatasetError: the file cannot be read, or its columns cannot be identified, or hold no unit quaternion.
        TimestampError: no pose, or a TUM file whose stamps do not increase.
    """
    if path.suffix == ".tum" or is_tum(path):
        trajectory = read_tum(path, per_second=_stamps_per_second(path, tally))
        return GroundTruth(without_lost(trajectory, tally), has_stamps=True, source=path.name)
    table = CsvTable.open(path)
    found = _pose_columns(table, columns, tally)
    stamps_ns, poses = _poses(table, found, tally)
    _check_quaternions(path, poses[:, 3:7])
    transforms = se3.transform(so3.from_quat_xyzw(poses[:, 3:7]), poses[:, :3])
    velocity = poses[:, 7:] if found.velocity else None
    if found.stamp is None:
        tally.note(f"{path.name}: ground truth has no stamps, offset and rate of its clock must be estimated")
    trajectory = without_lost(Trajectory(stamps_ns, transforms, velocity), tally)
    return GroundTruth(trajectory, has_stamps=found.stamp is not None, source=path.name)


def is_tum(path: Path) -> bool:
    """Whether a text file has TUM lines, whatever its name: its first line that is no comment is eight numbers."""
    try:
        with path.open(encoding="utf-8") as file:
            for line in islice(file, _MOST_COMMENTS):
                fields = line.partition("#")[0].split()
                if fields:
                    return len(fields) == _TUM_FIELDS and all(math.isfinite(float(field)) for field in fields)
    except (OSError, ValueError):
        return False
    return False


def tum_files(folder: Path) -> list[Path]:
    """The files of TUM lines in a folder, those named as ground truth first, then by name.

    Files named ``.tum`` or ``.txt`` are looked into; of those without the name of a ground truth none is taken where a
    folder has several.
    """
    texts = [path for path in sorted(folder.iterdir()) if path.suffix.lower() in (".tum", ".txt") and path.is_file()]
    found = [path for path in texts if is_tum(path)]
    named = [path for path in found if _TRUTH_NAME.search(path.stem.lower())]
    return named or (found if len(found) == 1 else [])


def stamped_truth(stamps_ns: IntArray, T_world_body: Array, source: str, tally: ReadTally) -> GroundTruth:
    """Ground truth from poses in file order; poses that are not finite or not later than all before are left out.

    Args:
        stamps_ns: nanoseconds, (N,).
        T_world_body: (N, 4, 4).
        source: the file it came from.
        tally: counts what is left out.

    Raises:
        TimestampError: no pose remains.
    """
    is_finite = np.isfinite(T_world_body).all(axis=(1, 2))
    tally.dropped["ground truth: pose empty or NaN"] += int((~is_finite).sum())
    stamps_ns, poses = stamps_ns[is_finite], T_world_body[is_finite]
    is_later = np.append([True], stamps_ns[1:] > np.maximum.accumulate(stamps_ns)[:-1])[: len(stamps_ns)]
    tally.dropped["ground truth: stamp repeated or out of order"] += int((~is_later).sum())
    tally.dropped = +tally.dropped
    if not is_later.any():
        raise TimestampError(f"{source} holds no complete pose; delete its poses to run without ground truth")
    trajectory = without_lost(Trajectory(stamps_ns[is_later], poses[is_later]), tally)
    return GroundTruth(trajectory, has_stamps=True, source=source)


def without_lost(trajectory: Trajectory, tally: ReadTally) -> Trajectory:
    """The poses but those at the origin that a tracker writes while it does not see the body; counted."""
    is_lost = lost_poses(trajectory.positions)
    if not is_lost.any() or is_lost.all():
        return trajectory
    tally.dropped[LOST] += int(is_lost.sum())
    return trajectory.select(~is_lost)


def _stamps_per_second(path: Path, tally: ReadTally) -> int:
    """How many units of a TUM file's stamps make a second: 1, unless they would be later than the year 2286."""
    first = 0.0
    with suppress(OSError, UnicodeDecodeError, ValueError), path.open(encoding="utf-8") as lines:
        fields = next((line.split() for line in lines if line.partition("#")[0].strip()), ["0"])
        first = float(fields[0])
    for name, per_second in _FINER_UNITS.items():
        if _LATEST_S < first <= _LATEST_S * per_second:
            tally.note(f"{path.name}: the stamps are read as {name}: {first:.0f} is no time in seconds")
            return per_second
    return 1


def _pose_columns(table: CsvTable, columns: ColumnNames, tally: ReadTally) -> _PoseColumns:
    names = table.header
    stamp = Header(table.path, names, columns).find_stamp()
    by_name = {key: [i for i, name in enumerate(names) if name in _SPELLINGS[key]] for key in _SPELLINGS}
    if all(len(by_name[key]) == 1 for key in _POSE):
        velocity = [i for axis in "xyz" for i in by_name[f"v{axis}"]]
        return _PoseColumns(
            tuple(by_name[key][0] for key in _POSE), tuple(velocity) if len(velocity) == 3 else (), stamp
        )
    unnamed = tuple(i for i in range(len(names)) if stamp is None or i != stamp.index)
    if len(unnamed) != len(_POSE):
        raise DatasetError(
            f"{table.path}: ground truth cannot be read from the columns {listing(names)}; name them "
            f"{', '.join(_POSE)} (metres, unit quaternion), with stamp_ns or time_s beside them"
        )
    tally.note(f"{table.path.name}: the header does not name x y z qx qy qz qw, the columns are taken in that order")
    return _PoseColumns(unnamed, (), stamp)


def _poses(table: CsvTable, found: _PoseColumns, tally: ReadTally) -> tuple[IntArray, Array]:
    """Stamps (N,) and [x y z qx qy qz qw, velocity] (N, 7 or 10) of the complete rows in increasing time."""
    stamps: list[int] = []
    rows: list[list[float]] = []
    for number, row in enumerate(table.rows()):
        stamp_ns = number * UNSTAMPED_PERIOD_NS if found.stamp is None else found.stamp.read(row)
        values = row.numbers(found.pose + found.velocity)
        if stamp_ns is None or np.isnan(values).any():
            tally.dropped["ground truth: pose empty or NaN"] += 1
        elif stamps and stamp_ns <= stamps[-1]:
            tally.dropped["ground truth: stamp repeated or out of order"] += 1
        else:
            stamps.append(stamp_ns)
            rows.append(values)
    if table.has_cut_line:
        tally.dropped["ground truth: last line cut off"] += 1
    if not rows:
        raise TimestampError(f"{table.path} holds no complete pose; delete it to run without ground truth")
    return np.array(stamps, dtype=np.int64), np.array(rows)


def _check_quaternions(path: Path, quat_xyzw: Array) -> None:
    norms = np.linalg.norm(quat_xyzw, axis=1)
    worst = int(np.argmax(np.abs(norms - 1.0)))
    if abs(norms[worst] - 1.0) > _QUATERNION_TOLERANCE:
        raise DatasetError(
            f"{path}, pose {worst + 1}: the quaternion has norm {norms[worst]:.3f}, not 1; "
            "check the order of the columns"
        )

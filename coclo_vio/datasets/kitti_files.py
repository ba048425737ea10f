# SPDX-License-Identifier: BSD-3-Clause
"""The three text files of the KITTI odometry benchmark: ``calib.txt``, ``times.txt`` and poses.

=============== ======================================================================================================
``calib.txt``   ``P0:`` ... ``P3:`` with 12 numbers, rows of the 3 x 4 projection of a rectified camera, px; other
                labels are ignored. Without labels: the left camera's 12 numbers, then the right one's
``times.txt``   seconds since the first frame, one line for each frame
``poses.txt``   12 numbers a line, rows of the 3 x 4 pose ``T_world_camera`` of the first camera (``P0``)
=============== ======================================================================================================

Source: Geiger, Lenz, Urtasun, "Are we ready for autonomous driving? The KITTI vision benchmark suite", CVPR 2012.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.errors import CalibrationMissing, DatasetError, TimestampError, listing
from coclo_vio.values.trajectory import seconds_to_ns

_ROTATION_TOLERANCE = 1e-3
_MAX_OFFSET = 0.02  # across the x axis, of the baseline; KITTI's colour cameras are off by 0.5 %
_STAMP_LIMIT_NS = 2**63


@dataclass(frozen=True, slots=True, eq=False)
class RectifiedCameras:
    """Two rectified cameras, from their projections.

    Attributes:
        camera_matrix: K of both, (3, 3), px.
        left_in_first: position of the left camera in the frame of the first one (``P0``), (3,), m.
        baseline_m: distance of the right camera along the left one's x axis, m.
    """

    camera_matrix: Array
    left_in_first: Array
    baseline_m: float


def read_pair(path: Path, left: str, right: str) -> RectifiedCameras:
    """The pair of cameras named ``left`` and ``right``, or the two of a file without names.

    Raises:
        CalibrationMissing: one of them is missing; lists those in the file.
        DatasetError: the file is malformed, or the two are not a rectified pair.
    """
    projections = _projections(path, left, right)
    P_left, P_right = projections[left], projections[right]
    K: Array = P_left[:, :3]
    is_pinhole = np.array_equal(K[2], [0.0, 0.0, 1.0]) and K[1, 0] == 0.0 and K[0, 0] > 0.0 and K[1, 1] > 0.0
    if not is_pinhole or K[0, 1] != 0.0:
        raise DatasetError(
            f"{path}: {left} must begin with a camera matrix [fx 0 cx; 0 fy cy; 0 0 1], it has {K.tolist()}"
        )
    if not np.allclose(K, P_right[:, :3], rtol=1e-6, atol=1e-6):
        raise DatasetError(
            f"{path}: {left} and {right} have different camera matrices, so the images are not rectified"
        )
    first_in_left, first_in_right = (
        np.asarray(np.linalg.solve(K, P[:, 3]), dtype=np.float64) for P in (P_left, P_right)
    )
    right_in_left = first_in_left - first_in_right
    baseline_m = float(right_in_left[0])
    if baseline_m <= 0.0:
        raise DatasetError(f"{path}: {right} is {-baseline_m:.3f} m left of {left}; check the order of the two")
    if np.linalg.norm(right_in_left[1:]) > _MAX_OFFSET * baseline_m:
        raise DatasetError(
            f"{path}: {right} is at {right_in_left.round(4).tolist()} m from {left}, and not beside it along x "
            f"(within {_MAX_OFFSET:.0%}): the images are not rectified"
        )
    return RectifiedCameras(K, -first_in_left, baseline_m)


def read_times(path: Path) -> IntArray:
    """Stamps of the frames in nanoseconds, (frames,).

    Raises:
        DatasetError: a line that is not a number of seconds, or no line.
        TimestampError: a stamp beyond 64-bit nanoseconds.
    """
    stamps: list[int] = []
    for number, text in _lines(path):
        try:
            stamp_ns = seconds_to_ns(text)
        except ValueError as error:
            raise DatasetError(
                f"{path}, line {number}: a line holds one time in seconds ({error}); correct it"
            ) from error
        if abs(stamp_ns) >= _STAMP_LIMIT_NS:
            raise TimestampError(f"{path}, line {number}: {text} s is beyond 64-bit nanoseconds; is it in nanoseconds?")
        stamps.append(stamp_ns)
    if not stamps:
        raise DatasetError(f"{path} is empty: it must hold the seconds of each frame; delete it to use a constant rate")
    return np.array(stamps, dtype=np.int64)


def read_poses(path: Path, tally: ReadTally) -> Array:
    """Poses ``T_world_camera`` (frames, 4, 4), rotations orthonormalised; a last line that was cut off is left out.

    Raises:
        DatasetError: another line has not 12 numbers, they are not a pose, or there is no pose.
    """
    rows: list[list[float]] = []
    cut: DatasetError | None = None
    for number, text in _lines(path):
        if cut is not None:
            raise cut
        values = _numbers(path, number, text)
        if len(values) == 12:
            rows.append(values)
        else:
            cut = DatasetError(
                f"{path}, line {number}: {len(values)} numbers; a pose has 12, the rows of T_world_camera (3 x 4); "
                "correct the line"
            )
    ends_within_a_line = not _text(path).endswith("\n")
    if cut is not None:
        if not ends_within_a_line:
            raise cut
        tally.dropped["ground truth: last line cut off"] += 1
    elif ends_within_a_line:
        tally.note(f"{path.name}: the last line has no newline, its last number may be cut short")
    if not rows:
        raise DatasetError(f"{path} holds no pose; delete it to run without ground truth")
    matrices = np.array(rows).reshape(-1, 3, 4)
    rotations = matrices[:, :, :3]
    off = np.abs(rotations @ rotations.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2))
    wrong = np.flatnonzero((off > _ROTATION_TOLERANCE) | (np.linalg.det(rotations) < 0.0))
    if len(wrong):
        raise DatasetError(
            f"{path}, pose {wrong[0] + 1}: its first three columns are not a rotation; check their order"
        )
    return se3.transform(Rotation.from_matrix(rotations).as_matrix(), matrices[:, :, 3])


def _projections(path: Path, left: str, right: str) -> dict[str, Array]:
    """The 3 x 4 projections by name; ``left`` and ``right`` for the two of a file without names."""
    named: dict[str, Array] = {}
    unnamed: list[float] = []
    others: list[str] = []
    for number, text in _lines(path):
        name, colon, rest = text.partition(":")
        if not colon:
            unnamed += _numbers(path, number, text)
        elif name not in (left, right):
            others.append(name)
        else:
            values = _numbers(path, number, rest)
            if len(values) != 12:
                raise DatasetError(f"{path}, line {number}: {name} has {len(values)} numbers, a projection has 12")
            named[name] = np.array(values).reshape(3, 4)
    if not unnamed:
        missing = [name for name in (left, right) if name not in named]
        if missing:
            raise CalibrationMissing(f"{path} has no {listing(missing)}; its lines are: {listing([*named, *others])}")
        return named
    if named or others or len(unnamed) != 24:
        raise DatasetError(
            f"{path} must hold lines `{left}: 12 numbers` and `{right}: 12 numbers`, or 24 numbers without names "
            f"(left, right); it holds {len(unnamed)} numbers without a name, {len(named) + len(others)} lines with one"
        )
    return dict(zip((left, right), np.array(unnamed).reshape(2, 3, 4), strict=True))


def _numbers(path: Path, number: int, text: str) -> list[float]:
    try:
        values = [float(field) for field in text.split()]
    except ValueError as error:
        raise DatasetError(f"{path}, line {number}: {error}; the line may hold only numbers") from error
    if not np.isfinite(values).all():
        raise DatasetError(f"{path}, line {number}: a number is not finite; correct or delete the line")
    return values


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """The lines that are not blank, with their numbers."""
    for number, line in enumerate(_text(path).splitlines(), start=1):
        if line.strip():
            yield number, line.strip()


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DatasetError(f"cannot read {path}: {error}") from error

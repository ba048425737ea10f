# SPDX-License-Identifier: BSD-3-Clause
"""Trajectory: stamped poses, optionally with velocity and covariance; reading and writing of TUM files."""

import logging
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array, BoolArray, IntArray, checked, frozen
from coclo_vio.values.errors import DatasetError, EvaluationError, TimestampError, shortened
from coclo_vio.values.units import NS_PER_S
from coclo_vio.values.whole_files import WholeLines, write_whole

_log = logging.getLogger(__name__)
_TUM_VALUES = " ".join(["%.12g"] * 7) + "\n"
_DECIMALS = 9  # of a number of seconds in nanoseconds
_MAX_WHOLE = 12  # digits before the point up to which integers replace decimals
_MAX_DIGITS = 30  # of a number of seconds; 1e999999999 would exhaust the memory
_STAMP_LIMIT_NS = 2**63
_MIN_QUATERNION_NORM = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Poses of the body over time; stamps increase strictly.

    Attributes:
        stamps_ns: nanoseconds, (N,), int64.
        T_world_body: (N, 4, 4).
        velocity_world: m/s, world frame, (N, 3), or None.
        covariance: of the right/local pose error [rotation rad, position m], (N, 6, 6), or None.

    Raises:
        ValueError: a wrong shape or a value that is not finite.
        TimestampError: no pose, stamps that are not integers, or stamps that do not increase strictly.
    """

    stamps_ns: IntArray
    T_world_body: Array
    velocity_world: Array | None = None
    covariance: Array | None = None

    def __post_init__(self) -> None:
        stamps = np.asarray(self.stamps_ns)
        if stamps.size and stamps.dtype.kind not in "iu":
            raise TimestampError(f"stamps must be integer nanoseconds, got {stamps.dtype}; round seconds * 1e9 first")
        stamps_ns = np.array(stamps, dtype=np.int64)
        if stamps_ns.ndim != 1 or len(stamps_ns) == 0:
            raise TimestampError(f"a trajectory needs at least one stamp, got shape {stamps_ns.shape}")
        backwards = np.flatnonzero(np.diff(stamps_ns) <= 0)
        if len(backwards):
            row = int(backwards[0])
            raise TimestampError(
                f"stamps must strictly increase: pose {row + 1} at {stamps_ns[row + 1]} ns follows "
                f"{stamps_ns[row]} ns; sort the poses and drop repeats first"
            )
        stamps_ns.flags.writeable = False
        count = len(stamps_ns)
        frozen(self, "stamps_ns", stamps_ns)
        frozen(self, "T_world_body", checked("Trajectory.T_world_body", self.T_world_body, (count, 4, 4)))
        if self.velocity_world is not None:
            velocity = checked("Trajectory.velocity_world", self.velocity_world, (count, 3))
            frozen(self, "velocity_world", velocity)
        if self.covariance is not None:
            frozen(self, "covariance", checked("Trajectory.covariance", self.covariance, (count, 6, 6)))

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @property
    def positions(self) -> Array:
        """Body origins in the world, m, (N, 3)."""
        return self.T_world_body[:, :3, 3]

    @property
    def rotations(self) -> Array:
        """``R_world_body``, (N, 3, 3)."""
        return self.T_world_body[:, :3, :3]

    @property
    def times_s(self) -> Array:
        """Seconds since the first pose, (N,)."""
        return np.asarray((self.stamps_ns - self.stamps_ns[0]) / NS_PER_S)

    @property
    def duration_s(self) -> float:
        """Seconds from the first pose to the last."""
        return float(self.times_s[-1])

    def path_length_m(self) -> float:
        """Sum of the distances between successive poses, m; noise increases it, so resample noisy data first."""
        return float(np.linalg.norm(np.diff(self.positions, axis=0), axis=1).sum())

    def select(self, keep: BoolArray | IntArray) -> "Trajectory":
        """The poses at a mask or at increasing indices."""
        return Trajectory(
            self.stamps_ns[keep],
            self.T_world_body[keep],
            None if self.velocity_world is None else self.velocity_world[keep],
            None if self.covariance is None else self.covariance[keep],
        )

    def between(self, start_ns: int, end_ns: int) -> "Trajectory":
        """The poses with ``start_ns <= stamp <= end_ns``.

        Raises:
            EvaluationError: there is none.
        """
        keep = (self.stamps_ns >= start_ns) & (self.stamps_ns <= end_ns)
        if not keep.any():
            raise EvaluationError(
                f"no pose between {start_ns} and {end_ns} ns: the trajectory spans "
                f"{self.stamps_ns[0]} to {self.stamps_ns[-1]} ns"
            )
        return self.select(keep)

    def restamped(self, stamps_ns: IntArray) -> "Trajectory":
        """The same poses at other times, (N,) ns."""
        return replace(self, stamps_ns=stamps_ns)

    def moved(self, T_new_world: Array) -> "Trajectory":
        """The same motion in another world frame: ``T_new_body = T_new_world @ T_world_body``.

        The covariance is local to the body and does not change.
        """
        velocity = self.velocity_world
        if velocity is not None:
            velocity = velocity @ T_new_world[:3, :3].T
        return replace(self, T_world_body=T_new_world @ self.T_world_body, velocity_world=velocity)

    def interpolated(self, stamps_ns: IntArray) -> "Trajectory":
        """Poses at ``stamps_ns`` (M,), linear in position and great-circle in rotation; no extrapolation.

        Velocity is interpolated too; covariance is taken from the nearest pose.

        Raises:
            EvaluationError: a stamp lies outside the trajectory.
        """
        first, last = int(self.stamps_ns[0]), int(self.stamps_ns[-1])
        if len(stamps_ns) and (stamps_ns.min() < first or stamps_ns.max() > last):
            raise EvaluationError(
                f"cannot interpolate at {int(stamps_ns.min())}..{int(stamps_ns.max())} ns: the trajectory "
                f"spans {first}..{last} ns; cut the stamps to it first"
            )
        own_s = self.times_s
        at_s = (stamps_ns - first) / NS_PER_S
        if len(self) == 1:
            return self.select(np.zeros(len(stamps_ns), dtype=np.int64)).restamped(stamps_ns)
        rotation = Slerp(own_s, Rotation.from_matrix(self.rotations))(at_s).as_matrix()
        position = _interpolate_columns(at_s, own_s, self.positions)
        velocity = self.velocity_world
        if velocity is not None:
            velocity = _interpolate_columns(at_s, own_s, velocity)
        covariance = self.covariance
        if covariance is not None:
            right = np.clip(np.searchsorted(own_s, at_s), 1, len(self) - 1)
            is_left_nearer = at_s - own_s[right - 1] < own_s[right] - at_s
            covariance = covariance[right - is_left_nearer]
        return Trajectory(stamps_ns, se3.transform(rotation, position), velocity, covariance)


@dataclass(frozen=True, slots=True, eq=False)
class GroundTruth:
    """A reference trajectory and whether it has time stamps.

    Attributes:
        trajectory: poses of the tracked body, in the world frame of the motion capture.
        has_stamps: False if the recording holds no stamps: then only the order of the poses is known, their stamps are
            evenly spaced placeholders, and offset and rate of their clock must be estimated.
        source: file or topic, for reports.
    """

    trajectory: Trajectory
    has_stamps: bool
    source: str


def _interpolate_columns(at_s: Array, own_s: Array, columns: Array) -> Array:
    return np.stack([np.interp(at_s, own_s, column) for column in columns.T], axis=1)


def tum_lines(stamps_ns: Iterable[int], T_world_body: Array) -> Iterator[str]:
    """Lines ``t x y z qx qy qz qw`` of poses (N, 4, 4): seconds with all nine decimals, from integer nanoseconds."""
    quat_xyzw = so3.to_quat_xyzw(T_world_body[:, :3, :3])
    values = np.concatenate((T_world_body[:, :3, 3], quat_xyzw), axis=1).tolist()
    for stamp_ns, row in zip(stamps_ns, values, strict=True):
        sign = "-" if stamp_ns < 0 else ""
        seconds, nanoseconds = divmod(abs(int(stamp_ns)), NS_PER_S)
        yield f"{sign}{seconds}.{nanoseconds:09d} " + _TUM_VALUES % tuple(row)


def write_tum(trajectory: Trajectory, path: Path) -> None:
    """Write the poses as ``tum_lines`` does."""
    write_whole(path, "".join(tum_lines(trajectory.stamps_ns.tolist(), trajectory.T_world_body)))


def seconds_to_ns(text: str) -> int:
    """Integer nanoseconds of a decimal number of seconds, exact where a float would round.

    Raises:
        ValueError: not a finite number of seconds.
    """
    whole, _, fraction = text.partition(".")
    if whole.isdecimal() and fraction.isdecimal() and len(whole) <= _MAX_WHOLE and len(fraction) <= _DECIMALS:
        return int(whole) * NS_PER_S + int(fraction.ljust(_DECIMALS, "0"))  # the same in a fraction of the time
    try:
        seconds = Decimal(text)
    except InvalidOperation as error:
        raise ValueError(f"{text.strip()!r} is not a number of seconds") from error
    if not seconds.is_finite() or seconds.adjusted() > _MAX_DIGITS:
        raise ValueError(f"{text.strip()!r} is not a time in seconds")
    return int((seconds * NS_PER_S).to_integral_value())


def _stamp_field(text: str, per_second: int) -> int:
    stamp_ns = seconds_to_ns(text) // per_second
    if abs(stamp_ns) >= _STAMP_LIMIT_NS:
        raise ValueError(f"the stamp {text} is beyond 64-bit nanoseconds: is it in nanoseconds, not seconds?")
    return stamp_ns


def _pose_fields(fields: list[str]) -> list[float]:
    values = [float(field) for field in fields]
    if not np.isfinite(values).all():
        raise ValueError("a value is not finite")
    if np.linalg.norm(values[3:]) < _MIN_QUATERNION_NORM:
        raise ValueError("the quaternion is zero")
    return values


def read_tum(path: Path, *, per_second: int = 1) -> Trajectory:
    """Read ``t x y z qx qy qz qw`` lines; ``#`` starts a comment; stamps to the nanosecond.

    A last line without newline that is only the beginning of a pose was cut short as it was written: it is left out,
    and logged.

    Args:
        path: the file.
        per_second: how many units of its stamps make a second: 1000 where they are milliseconds.

    Raises:
        DatasetError: no such file, or a line that is not eight finite numbers with a quaternion.
        TimestampError: no pose, or stamps that do not increase strictly.
    """
    read = read_lines(path)
    if read.cut and not (read.lines and _is_cut_pose(read.cut)):
        return parse_tum([*read.lines, read.cut], path, per_second=per_second)
    if read.cut:
        _log.warning("%s: %s", path, read.cut_note(path))
    return parse_tum(read.lines, path, per_second=per_second)


def read_lines(path: Path) -> WholeLines:
    """The lines of a file of poses.

    Raises:
        DatasetError: it cannot be read, or is no text.
    """
    try:
        return WholeLines.read(path)
    except (OSError, ValueError) as error:  # no such file; a path with a zero byte; bytes that are no UTF-8
        raise DatasetError(f"cannot read the trajectory {shortened(path)}: {shortened(error)}") from error


def parse_tum(lines: Iterable[str], path: Path, *, per_second: int = 1) -> Trajectory:
    """The poses in the lines of a file, as ``read_tum`` reads them; ``path`` is for messages.

    Raises:
        DatasetError: a line that is not eight finite numbers with a quaternion.
        TimestampError: no pose, or stamps that do not increase strictly.
    """
    rows = [row for number, line in enumerate(lines, 1) if (row := _tum_row(path, number, line, per_second))]
    if not rows:
        raise TimestampError(f"{path} holds no pose; a TUM file has lines of t x y z qx qy qz qw")
    stamps, poses = zip(*rows, strict=True)
    values = np.array(poses)
    transforms = se3.transform(so3.from_quat_xyzw(values[:, 3:]), values[:, :3])
    return Trajectory(np.array(stamps, dtype=np.int64), transforms)


def _tum_row(path: Path, number: int, line: str, per_second: int) -> tuple[int, list[float]] | None:
    """Stamp (ns), position and quaternion of a line; None of an empty one or a comment."""
    fields = line.partition("#")[0].split()
    if not fields:
        return None
    try:
        if len(fields) != 8:
            raise ValueError(f"{len(fields)} fields")
        return _stamp_field(fields[0], per_second), _pose_fields(fields[1:])
    except ValueError as error:
        raise DatasetError(
            f"{path}, line {number}: a TUM line has 8 numbers, t x y z qx qy qz qw ({shortened(error)}); "
            "correct or remove it"
        ) from error


def _is_cut_pose(line: str) -> bool:
    """Whether a line is the beginning of a pose: too few fields, or a last one that is no number yet."""
    fields = line.partition("#")[0].split()
    if len(fields) != 8:
        return 0 < len(fields) < 8
    try:
        float(fields[-1])
    except ValueError:
        return True
    return False

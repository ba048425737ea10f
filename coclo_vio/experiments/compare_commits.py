# SPDX-License-Identifier: BSD-3-Clause
"""Compares the trajectories of two commits: every mode over the same recordings, by the command line of each checkout.

``python -m coclo_vio.experiments.compare_commits commits A B -o OUT --shared DATA`` makes two temporary worktrees and
does all of it; in steps::

    record OLD -o OUT/a --shared DATA
    record NEW -o OUT/b --shared DATA --sample OLD/coclo_vio/sample_data/daisy_stairs.mcap --recordings OUT/a/recordings
    compare OUT/a OUT/b --allow-extra --json OUT/compare.json

``record`` leaves one folder per case; a case that is there already, of the same source, arguments and recording, is
not run again. ``compare`` ends with status 1 where anything differs by more than the tolerance, or by more than the
last digit that the files hold: 12 significant ones in a trajectory, 9 in a state file.
"""

import argparse
import json
import math
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from decimal import Decimal
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Self

import numpy as np
from numpy.typing import NDArray

from coclo_vio.experiments.commit_cases import (
    SAMPLE_IN_CHECKOUT,
    Recordings,
    chosen_cases,
    read_record,
    record,
    sample_of,
    trajectories,
)

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

_TUM_DIGIT, _STATE_DIGIT = 1e-11, 1e-8  # relative: the last of 12 and of 9 significant digits
_TRUTH = "groundtruth"
_VELOCITY = tuple(f"velocity_world_{axis}" for axis in "xyz")
_COVARIANCE = {f"pose_covariance_{row}{column}": (row, column) for row in range(6) for column in range(row, 6)}


@dataclass(frozen=True, slots=True)
class Tolerance:
    """What still counts as equal.

    Attributes:
        largest: difference of a position (m), a rotation (rad), a velocity (m/s), another column of the state file.
        allows_extra: poses that only the second folder has are no fault.
    """

    largest: float = 1e-9
    allows_extra: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Estimates:
    """A trajectory file and the state file beside it.

    Attributes:
        stamps_ns: (N,), distinct.
        position: m, (N, 3).
        quat_xyzw: (N, 4).
        state: columns (N,) by name; None where there is no state file.
    """

    stamps_ns: Stamps
    position: Array
    quat_xyzw: Array
    state: dict[str, Array] | None

    def select(self, rows: Stamps) -> Self:
        """The estimates of these rows."""
        state = None if self.state is None else {name: column[rows] for name, column in self.state.items()}
        return type(self)(self.stamps_ns[rows], self.position[rows], self.quat_xyzw[rows], state)


@dataclass(frozen=True, slots=True)
class Comparison:
    """One trajectory of a case in two folders, or the case as a whole.

    Attributes:
        case: it belongs to.
        trajectory: the estimator; empty for the case as a whole.
        poses: in the first and in the second folder.
        only_in: stamps that only the first has, and only the second.
        largest: largest difference at stamps that both have, by quantity; entries of the covariance relative to
            ``sqrt(P_ii P_jj)``.
        faults: why the two do not agree; empty where they do.
        notes: what differs and is no fault.
    """

    case: str
    trajectory: str = ""
    poses: tuple[int, int] = (0, 0)
    only_in: tuple[int, int] = (0, 0)
    largest: dict[str, float] = field(default_factory=dict)
    faults: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def compare(first: Path, second: Path, tolerance: Tolerance, only: Sequence[str] = ()) -> list[Comparison]:
    """What two folders of ``record`` hold, side by side.

    Raises:
        SystemExit: there is nothing to compare.
    """
    there = {path.parent.name for folder in (first, second) for path in folder.glob("*/case.json")}
    names = [case.name for case in chosen_cases(only) if case.name in there]
    if not only:
        names += sorted(there - set(names))  # of another version of this script
    if not names:
        raise SystemExit(f"no case is in {first} or {second}: give two folders that `record -o` wrote")
    return [one for name in names for one in _compare_case(name, first / name, second / name, tolerance)]


def _compare_case(case: str, first: Path, second: Path, tolerance: Tolerance) -> list[Comparison]:
    one, other = read_record(first), read_record(second)
    if one is None or other is None:
        return [Comparison(case, faults=(f"the case is not in {(first if one is None else second).parent}",))]
    if one.recording_sha256 != other.recording_sha256:
        return [Comparison(case, faults=("the recordings differ: give `record` the same --sample and --recordings",))]
    found, others = trajectories(first), trajectories(second)
    faults: list[str] = []
    notes = () if one.exit_status == 0 else (f"the command ended with status {one.exit_status}: see log.txt",)
    if one.exit_status != other.exit_status:
        faults.append(f"the command ended with status {one.exit_status} and with {other.exit_status}")
    if not ({*found, *others} - {_TRUTH} or one.written_sha256 or other.written_sha256):
        faults.append("no estimate is in either folder: nothing was compared")
    unlike = {name for name, _ in one.written_sha256.items() ^ other.written_sha256.items()}
    faults += [f"{name} has other bytes or is in one folder only" for name in sorted(unlike)]
    faults += [
        f"{name} is only in {first if name in found else second}" for name in sorted(found.keys() ^ others.keys())
    ]
    both = sorted(found.keys() & others.keys())
    return [
        *([Comparison(case, faults=tuple(faults), notes=notes)] if faults or notes or not both else []),
        *(compare_trajectories(case, found[name], others[name], tolerance) for name in both),
    ]


def compare_trajectories(case: str, first: Path, second: Path, tolerance: Tolerance) -> Comparison:
    """Two trajectory files, and the state files beside them."""
    try:
        one, other = read_estimates(first), read_estimates(second)
    except ValueError as error:
        return Comparison(case, first.stem, faults=(str(error),))
    poses = len(one.stamps_ns), len(other.stamps_ns)
    _, rows, other_rows = np.intersect1d(one.stamps_ns, other.stamps_ns, return_indices=True)
    only_in = poses[0] - len(rows), poses[1] - len(rows)
    faults: list[str] = []
    notes: list[str] = []
    if any(only_in):
        excused = tolerance.allows_extra and not only_in[0]
        sentence = f"{only_in[0]} stamps only in the first, {only_in[1]} only in the second"
        (notes if excused else faults).append(sentence)
    if not len(rows):
        faults.append("no stamp is in both: nothing was compared")
    largest: dict[str, float] = {}
    for quantity, gaps, allowed in _gaps(one.select(rows), other.select(other_rows), tolerance.largest):
        largest[quantity] = float(gaps.max())
        exceeds = ((gaps > allowed) | np.isinf(gaps)).reshape(len(rows), -1).any(axis=1)
        if exceeds.any():
            row = int(np.argmax(exceeds))
            faults.append(
                f"{quantity} differs by up to {largest[quantity]:.3g}, first at {one.stamps_ns[rows[row]]} ns"
            )
    if (one.state is None) != (other.state is None):
        faults.append(f"only the {'second' if one.state is None else 'first'} has a state file")
    elif one.state is not None and other.state is not None:
        lacking = sorted({*_VELOCITY, *_COVARIANCE} - (one.state.keys() & other.state.keys()))
        unlike = sorted((one.state.keys() ^ other.state.keys()) - {*lacking})
        faults += [f"not in both state files: {', '.join(lacking)}"] if lacking else []
        notes += [f"columns that only one state file has: {', '.join(unlike)}"] if unlike else []
    return Comparison(case, first.stem, poses, only_in, largest, tuple(faults), tuple(notes))


def _gaps(one: Estimates, other: Estimates, tolerance: float) -> Iterator[tuple[str, Array, Array]]:
    """By quantity: how far two trajectories of the same stamps are apart, and how far they may be."""
    if not len(one.stamps_ns):
        return
    apart = np.linalg.norm(_gap(one.position, other.position), axis=1)
    from_origin = np.fmax(np.linalg.norm(one.position, axis=1), np.linalg.norm(other.position, axis=1))
    yield "position_m", apart, np.fmax(tolerance, _TUM_DIGIT * from_origin)
    angles = rotation_between(one.quat_xyzw, other.quat_xyzw)
    yield "rotation_rad", angles, np.full(len(angles), tolerance)
    if one.state is None or other.state is None:
        return
    shared = one.state.keys() & other.state.keys()
    relative = max(tolerance, _STATE_DIGIT)
    for quantity, names in (
        ("velocity_mps", sorted(shared & {*_VELOCITY})),
        ("other_columns", sorted(shared - {*_VELOCITY, *_COVARIANCE})),
    ):
        if names:
            values, others = (np.stack([state[name] for name in names], axis=1) for state in (one.state, other.state))
            size = np.fmax(np.abs(values), np.abs(others))
            yield quantity, _gap(values, others), np.fmax(tolerance, relative * size)
    if shared >= _COVARIANCE.keys():
        gaps = _covariance_gap(one.state, other.state)
        yield "covariance", gaps, np.full(gaps.shape, relative)


def _gap(one: Array, other: Array) -> Array:
    """Absolute difference: 0 where both are the same or both not a number, infinite where only one is finite."""
    with np.errstate(invalid="ignore"):
        gaps = np.abs(one - other)
    gaps[np.isnan(gaps)] = np.inf
    gaps[(one == other) | (np.isnan(one) & np.isnan(other))] = 0.0
    return gaps


def rotation_between(quat_xyzw: Array, other: Array) -> Array:
    """Angles, rad, (N,), from the chord between unit quaternions: exact where they are small."""
    one, two = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in (quat_xyzw, other))
    chords = np.minimum(np.linalg.norm(_gap(one, two), axis=1), np.linalg.norm(_gap(one, -two), axis=1))
    return np.asarray(4.0 * np.arcsin(np.minimum(chords / 2.0, 1.0)))


def _covariance_gap(state: dict[str, Array], other: dict[str, Array]) -> Array:
    """Differences of the entries (N, 21) as shares of ``sqrt(P_ii P_jj)``, the larger of the two."""
    gaps = []
    for name, (row, column) in _COVARIANCE.items():
        diagonal = (f"pose_covariance_{row}{row}", f"pose_covariance_{column}{column}")
        scales = [np.sqrt(np.abs(each[diagonal[0]] * each[diagonal[1]])) for each in (state, other)]
        gap = _gap(state[name], other[name])
        scale = np.fmax(*scales)
        gaps.append(np.divide(gap, scale, out=np.where(gap > 0.0, np.inf, 0.0), where=(gap > 0.0) & (scale > 0.0)))
    return np.stack(gaps, axis=1)


def read_estimates(path: Path) -> Estimates:
    """A TUM file and the state file beside it.

    Raises:
        ValueError: a file is malformed, a stamp occurs twice, or the stamps of the two files differ.
    """
    lines = [line.split() for line in path.read_text(encoding="ascii").splitlines() if not line.startswith("#")]
    stamps = np.array([int(Decimal(cells[0]).scaleb(9)) for cells in lines], dtype=np.int64)
    values = np.array([[float(cell) for cell in cells[1:]] for cells in lines]).reshape(len(lines), 7)
    if len(np.unique(stamps)) != len(stamps):
        raise ValueError(f"{path} has a stamp twice")
    states = path.with_name(f"{path.stem}_state.csv")
    if not states.is_file():
        return Estimates(stamps, values[:, :3], values[:, 3:], None)
    header, *rows = [line.split(",") for line in states.read_text(encoding="utf-8").splitlines()]
    if [int(row[0]) for row in rows] != stamps.tolist():
        raise ValueError(f"{states} has other stamps than {path.name}")
    table = np.array([[float(cell) for cell in row[1:]] for row in rows]).reshape(len(rows), len(header) - 1)
    return Estimates(stamps, values[:, :3], values[:, 3:], dict(zip(header[1:], table.T, strict=True)))


def _report(compared: Sequence[Comparison], json_file: Path | None) -> int:
    """Print a line for each trajectory and write the JSON file; the status to end with."""
    for one in compared:
        poses = f"{one.poses[0]}" if one.poses[0] == one.poses[1] else f"{one.poses[0]} / {one.poses[1]}"
        figures = "  ".join(f"{quantity} {value:.2g}" for quantity, value in one.largest.items())
        counted = f"{poses} poses  {figures}  " if one.trajectory else ""
        print(f"{one.case + '/' + one.trajectory:<64} {counted}{'DIFFERS' if one.faults else 'equal'}")
        for sentence in (*one.faults, *one.notes):
            print(f"    {sentence}")
    unlike = sum(bool(one.faults) for one in compared)
    print(f"{len(compared)} compared, {unlike} differ")
    if json_file is not None:
        rows = [
            asdict(one) | {"largest": {key: _finite(value) for key, value in one.largest.items()}} for one in compared
        ]
        json_file.write_text(
            json.dumps({"agree": not unlike, "compared": rows}, indent=2, allow_nan=False) + "\n", encoding="utf-8"
        )
    return int(unlike > 0)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _record_commits(
    commits: Sequence[str], output: Path, shared: Path | None, only: Sequence[str], jobs: int
) -> list[Path]:
    """Record two commits of the repository in the working directory, each in a worktree that is removed again."""
    output.mkdir(parents=True, exist_ok=True)
    sample, folders = output / SAMPLE_IN_CHECKOUT.name, []
    with TemporaryDirectory() as scratch:
        for number, commit in enumerate(commits):
            checkout = Path(scratch) / f"commit_{number}"
            name = _git("rev-parse", "--short=12", f"{commit}^{{commit}}")
            _git("worktree", "add", "--detach", str(checkout), name)
            try:
                if number == 0:  # both commits run over the sample of the first
                    shutil.copyfile(sample_of(checkout), sample)
                folders.append(output / name)
                record(checkout, folders[-1], Recordings(sample, output / "recordings", shared), only, jobs)
            finally:
                _git("worktree", "remove", "--force", str(checkout))
    return folders


def _git(*arguments: str) -> str:
    done = subprocess.run(["git", *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"git {' '.join(arguments)}: {done.stderr.strip()}")
    return done.stdout.strip()


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; its status."""
    asked = _parser().parse_args(arguments)
    if asked.command == "record":
        checkout, output = asked.checkout.resolve(), asked.output.resolve()
        sample = (asked.sample or sample_of(checkout)).resolve()
        recordings = Recordings(sample, (asked.recordings or output / "recordings").resolve(), asked.shared)
        return 0 if record(checkout, output, recordings, asked.only, asked.jobs) else 1
    if asked.command == "compare":
        folders = asked.folders
    else:
        folders = _record_commits(asked.commits, asked.output.resolve(), asked.shared, asked.only, asked.jobs)
    tolerance = Tolerance(asked.tolerance, asked.allow_extra)
    return _report(compare(folders[0], folders[1], tolerance, asked.only), asked.json)


def _parser() -> argparse.ArgumentParser:
    every, running, comparing = (argparse.ArgumentParser(add_help=False) for _ in range(3))
    every.add_argument(
        "--only", nargs="+", default=[], metavar="NAME", help="cases by name or pattern, such as 'go1_*'"
    )
    running.add_argument(
        "-o", "--output", type=Path, required=True, help="folder for the results; goes on where it was"
    )
    running.add_argument("--shared", type=_folder, help="folder of the recordings that are not bundled")
    running.add_argument("--jobs", type=int, default=1, help="cases at a time (default: 1)")
    comparing.add_argument("--tolerance", type=float, default=1e-9, help="m, rad, m/s (default: 1e-9)")
    comparing.add_argument("--allow-extra", action="store_true", help="the second may have poses that the first lacks")
    comparing.add_argument("--json", type=Path, help="file for the comparison")
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("record", parents=[every, running], help="run the cases with one checkout")
    one.add_argument("checkout", type=_folder)
    one.add_argument("--sample", type=Path, help="the bundled recording to use (default: the checkout's)")
    one.add_argument("--recordings", type=Path, help="folder of simulated recordings (default: OUTPUT/recordings)")
    two = commands.add_parser("compare", parents=[every, comparing], help="compare what two checkouts left")
    two.add_argument("folders", nargs=2, type=_folder, metavar="FOLDER")
    both = commands.add_parser("commits", parents=[every, running, comparing], help="record and compare two commits")
    both.add_argument("commits", nargs=2, metavar="COMMIT")
    return parser


def _folder(text: str) -> Path:
    path = Path(text).resolve()
    if not path.is_dir():
        raise argparse.ArgumentTypeError(f"{text} is no folder")
    return path


if __name__ == "__main__":
    sys.exit(main())

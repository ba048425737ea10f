# SPDX-License-Identifier: BSD-3-Clause
"""The cases over which two commits are compared, and running them by the command line of a checkout.

Nothing of the checkout's package is imported here: between two commits its modules may move.
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from fnmatch import fnmatch
from functools import cache
from pathlib import Path

LEG_MODES = ("coclo", "coclo_leg_scale", "coclo_paper", "inekf", "naive", "naive_rolling", "naive_weighted")
FEEDBACK_KEYS = ("bridge.feedback", "fusion.feedback", "fusion.bridge.feedback")  # by the commit
SAMPLE, SIMULATED, EARLY, LATE = "sample", "simulated", "euroc_clock_early", "euroc_clock_late"
_EUROC, _TRACKS = "euroc_v1_01_start", "stereo_tracks"
_CLOCK_SHIFTS_S = {EARLY: 0.2, LATE: -0.2}  # stamp of a frame plus this is the IMU's clock
SAMPLE_IN_CHECKOUT = Path("coclo_vio/datasets/sample_data/daisy_stairs.mcap")
_SAMPLE_BEFORE = Path("coclo_vio/sample_data/daisy_stairs.mcap")  # before the readers had it
_SIMULATE = ("simulate", "stairs", "--seed", "4", "--workers", "1")
_COMMAND_LINE = "from coclo_vio.cli import main; main()"
_CONFIG_ERROR = 2  # status of the command line where it does not know a setting


def sample_of(checkout: Path) -> Path:
    """The bundled recording of a checkout, where it was at its time."""
    before = checkout / _SAMPLE_BEFORE
    return before if before.is_file() else checkout / SAMPLE_IN_CHECKOUT


@dataclass(frozen=True, slots=True)
class Case:
    """One command over one recording.

    Attributes:
        name: of its folder.
        recording: the sample, the simulated trial, or a path in the folder of shared recordings; empty for a command
            that makes its own.
        spellings: arguments, without paths; the first ones that the checkout accepts are used.
    """

    name: str
    recording: str
    spellings: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class CaseRecord:
    """What is known of a case that was run: ``case.json``.

    Attributes:
        case: its name.
        arguments: those that the checkout accepted, without paths.
        source_sha256: of the checkout's package without its sample.
        recording_sha256: of the recording's files; empty where there is none.
        exit_status: of the command.
        wall_s: it took.
        written_sha256: by file, of a recording that the command made.
    """

    case: str
    arguments: tuple[str, ...]
    source_sha256: str
    recording_sha256: str
    exit_status: int
    wall_s: float
    written_sha256: dict[str, str]


@dataclass(frozen=True, slots=True)
class Recordings:
    """Where recordings are.

    Attributes:
        sample: the bundled one.
        made: folder of those that are made once and used for both commits.
        shared: folder of the others; None where there is none.
    """

    sample: Path
    made: Path
    shared: Path | None

    def find(self, name: str) -> Path | None:
        """The recording's path; None where it is not on this machine."""
        if name == SAMPLE:
            return self.sample
        if name == SIMULATED:
            return self.made / "stairs.mcap"
        if self.shared is None:
            return None
        path = self.shared / (_EUROC if name in _CLOCK_SHIFTS_S else name)
        if not path.exists():
            return None
        return self.made / name if name in _CLOCK_SHIFTS_S else path

    def make(self, name: str, checkout: Path) -> None:
        """Make a recording that is not there yet: simulated by the checkout, or with a shifted camera clock."""
        path = self.find(name)
        if path is None or path.exists():
            return
        self.made.mkdir(parents=True, exist_ok=True)
        part = self.made / f"part_{path.name}"
        if name == SIMULATED:
            part.unlink(missing_ok=True)
            arguments = [*_SIMULATE, "--duration", "20", "--image-encoding", "jpeg", "-o", str(part)]
            if _call(checkout, arguments, self.made / "simulate.log") != 0:
                raise SystemExit(f"the trial could not be simulated: see {self.made / 'simulate.log'}")
        elif name in _CLOCK_SHIFTS_S and self.shared is not None:
            shutil.rmtree(part, ignore_errors=True)
            _shift_clock(self.shared / _EUROC, part, _CLOCK_SHIFTS_S[name])
        else:
            raise SystemExit(f"there is no {path}; give the bundled recording with --sample")
        part.rename(path)


def cases() -> list[Case]:
    """All cases, in the order in which they are run."""
    found = [_run(SAMPLE, mode) for mode in (*LEG_MODES, "combined", "vins", "stereo")]
    found += [_run(SAMPLE, "combined", feedback=policy) for policy in ("off", "paper", "ci")]
    found += [_run("go1_mocap", mode, robot="go1") for mode in LEG_MODES]
    found += [_run(_EUROC, mode) for mode in ("vins", "stereo")]
    found += [_run(name, "vins") for name in _CLOCK_SHIFTS_S]
    found += [_run("kitti_stereo", "stereo")]
    tracks = ("starry_night", "2011_09_26_drive_0039_sync_KLT", "2011_09_30_drive_0020_sync_KLT")
    found += [_run(f"{_TRACKS}/{name}.mat", mode) for name in tracks for mode in ("stereo", "stereo_twist")]
    found += [_run(SIMULATED, mode) for mode in ("coclo", "inekf", "vins", "combined")]
    return [*found, Case("simulate", "", ((*_SIMULATE, "--no-images", "--duration", "5"),))]


def _run(recording: str, mode: str, *, robot: str | None = None, feedback: str | None = None) -> Case:
    arguments = ("run", "--mode", mode, *(("--robot", robot) if robot else ()))
    name = f"{Path(recording).stem}_{mode}"
    if feedback is None:
        return Case(name, recording, (arguments,))
    spellings = tuple((*arguments, "--set", f"{key}={feedback}") for key in FEEDBACK_KEYS)
    return Case(f"{name}_{feedback}", recording, spellings)


def record(checkout: Path, output: Path, recordings: Recordings, only: Sequence[str] = (), jobs: int = 1) -> bool:
    """Run the cases and leave a folder of each.

    Returns:
        Whether every command ended well.

    Raises:
        SystemExit: another package would be run, a recording cannot be made, or the checkout was edited meanwhile.
    """
    _check_package(checkout)
    chosen, source = chosen_cases(only), _source_sha256(checkout)
    output.mkdir(parents=True, exist_ok=True)
    for name in dict.fromkeys(case.recording for case in chosen if case.recording):
        recordings.make(name, checkout)
    with ThreadPoolExecutor(jobs) as pool:
        statuses = list(pool.map(lambda case: _record(case, checkout, output, recordings, source), chosen))
    if _source_sha256(checkout) != source:
        raise SystemExit(f"{checkout} was edited while the cases ran: run again, on a checkout that nobody edits")
    return not any(statuses)


def chosen_cases(only: Sequence[str]) -> list[Case]:
    """The cases that one of the patterns matches; all where there is no pattern."""
    names = [case.name for case in cases()]
    for pattern in only:
        if not any(fnmatch(name, pattern) for name in names):
            raise SystemExit(f"no case is called {pattern}; the cases are: {', '.join(names)}")
    return [case for case in cases() if not only or any(fnmatch(case.name, pattern) for pattern in only)]


def _record(case: Case, checkout: Path, output: Path, recordings: Recordings, source: str) -> int:
    """Run one case unless it is there already, print a line, return the status of the command."""
    path = recordings.find(case.recording) if case.recording else None
    if case.recording and path is None:
        print(f"{case.name:<48} skipped: {case.recording} is not in the folder given with --shared", flush=True)
        return 0
    recording = "" if path is None else _recording_sha256(path)
    folder, part = output / case.name, output / f"part_{case.name}"
    known = read_record(folder)
    if (
        known is not None
        and known.exit_status == 0
        and (known.source_sha256, known.recording_sha256) == (source, recording)
        and known.arguments in case.spellings
    ):
        _print_record(known, folder, "kept")
        return 0
    for one in (folder, part):
        shutil.rmtree(one, ignore_errors=True)
    part.mkdir()
    status, arguments, began = _CONFIG_ERROR, case.spellings[0], time.perf_counter()
    for arguments in case.spellings:
        began = time.perf_counter()
        status = _call(checkout, _with_paths(arguments, path, part), part / "log.txt")
        if status != _CONFIG_ERROR:
            break
    wall_s = time.perf_counter() - began
    made = [file for file in part.rglob("*") if file.suffix in {".mcap", ".tum", ".csv"}] if path is None else []
    written = {str(file.relative_to(part)): _sha256([file], file) for file in sorted(made)}
    done = CaseRecord(case.name, arguments, source, recording, status, wall_s, written)
    (part / "case.json").write_text(json.dumps(asdict(done), indent=2) + "\n", encoding="utf-8")
    part.rename(folder)
    _print_record(done, folder, "ran")
    return status


def _with_paths(arguments: Sequence[str], recording: Path | None, folder: Path) -> list[str]:
    command, *rest = arguments
    if recording is None:
        return [command, *rest, "-o", str(folder / "recording.mcap")]
    return [command, str(recording), *rest, "-o", str(folder)]


def _print_record(done: CaseRecord, folder: Path, what: str) -> None:
    counts = [f"{path.stem} {_line_count(path)}" for path in trajectories(folder).values()]
    state = what if done.exit_status == 0 else f"{what}, status {done.exit_status}: see {folder / 'log.txt'}"
    print(f"{done.case:<48} {done.wall_s:7.1f} s  {state}  {', '.join(counts)}", flush=True)


def _call(checkout: Path, arguments: Sequence[str], log: Path) -> int:
    """Status of one command of the checkout's own package: the working directory is first among Python's paths."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    environment |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    with log.open("a", encoding="utf-8") as out:
        out.write(f"$ coclo-vio {' '.join(arguments)}\n")
        out.flush()
        command = [sys.executable, "-c", _COMMAND_LINE, *arguments]
        return subprocess.run(
            command, cwd=checkout, env=environment, stdout=out, stderr=subprocess.STDOUT, check=False
        ).returncode


def _check_package(checkout: Path) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    command = [sys.executable, "-c", "import coclo_vio; print(coclo_vio.__file__)"]
    found = subprocess.run(command, cwd=checkout, env=environment, capture_output=True, text=True, check=False)
    if not Path(found.stdout.strip() or "/").resolve().is_relative_to(checkout.resolve()):
        raise SystemExit(f"{checkout} is no checkout: there Python imports {found.stdout or found.stderr}")


def _source_sha256(checkout: Path) -> str:
    """Of the package, without what Python compiles and without the bundled recordings."""
    files = (path for path in (checkout / "coclo_vio").rglob("*") if path.is_file())
    return _sha256(
        [path for path in files if "__pycache__" not in path.parts and path.suffix not in {".mcap", ".bag"}], checkout
    )


@cache
def _recording_sha256(path: Path) -> str:
    if path.is_dir():
        return _sha256([file for file in path.rglob("*") if file.is_file()], path)
    return _sha256([path], path)


def _sha256(files: Sequence[Path], root: Path) -> str:
    """Of contents, and of paths from the root."""
    whole = hashlib.sha256()
    for file in sorted(files):
        whole.update(f"{file.relative_to(root)}\n{hashlib.sha256(file.read_bytes()).hexdigest()}\n".encode())
    return whole.hexdigest()


def _shift_clock(original: Path, copy: Path, shift_s: float) -> None:
    """An EuRoC folder of links whose cameras are stamped early (positive) or late, and whose IMU ends with them.

    So the last frames wait for readings that never come, or the last readings for frames.
    """
    for file in sorted(path for path in original.rglob("*") if path.is_file()):
        path = copy / file.relative_to(original)
        path.parent.mkdir(parents=True, exist_ok=True)
        match path.parts[-2:]:
            case ("cam0", "sensor.yaml"):
                text = file.read_text(encoding="utf-8").rstrip("\n")
                path.write_text(f"{text}\ntimeshift_cam_imu: {shift_s}\n", encoding="utf-8")
            case ("imu0", "data.csv"):
                end_ns = max(_stamps(original / "mav0" / "cam0" / "data.csv"))
                header, *rows = file.read_text(encoding="utf-8").splitlines(keepends=True)
                kept = [row for row, stamp_ns in zip(rows, _stamps(file), strict=True) if stamp_ns <= end_ns]
                path.write_text(header + "".join(kept), encoding="utf-8")
            case _:
                path.symlink_to(file.resolve())


def _stamps(table: Path) -> list[int]:
    """First cells, ns, below the header of an EuRoC table."""
    return [int(line.split(",")[0]) for line in table.read_text(encoding="utf-8").splitlines()[1:]]


def read_record(folder: Path) -> CaseRecord | None:
    """What a case's folder says of it; None where the case was not run to its end."""
    path = folder / "case.json"
    if not path.is_file():
        return None
    values = json.loads(path.read_text(encoding="utf-8"))
    return CaseRecord(**values | {"arguments": tuple(values["arguments"])})


def trajectories(folder: Path) -> dict[str, Path]:
    """The trajectory files of a case's folder, by estimator; the ground truth is one of them."""
    return {path.stem: path for path in sorted(folder.glob("*.tum"))}


def _line_count(path: Path) -> int:
    return len(path.read_text(encoding="ascii").splitlines())

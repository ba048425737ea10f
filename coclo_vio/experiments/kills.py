# SPDX-License-Identifier: BSD-3-Clause
"""Ends runs at random moments by KILL, TERM and INT, evaluates what they left, and resumes them.

``python -m coclo_vio.experiments.kills -o OUT --kills 100`` writes ``kills.json``: for each kill how the process
ended, how much of what it had read is missing in its files, whether ``evaluate`` reads them, and by how much the
resumed run differs from one that was not ended.
"""

import argparse
import json
import mmap
import os
import random
import shutil
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from coclo_vio.datasets.sample import sample_path
from coclo_vio.runs import run_folder
from coclo_vio.runs.evaluating import evaluate_run, evaluation_config
from coclo_vio.runs.mode_run import ModeRun
from coclo_vio.values.errors import CocloError
from coclo_vio.values.units import NS_PER_S
from coclo_vio.values.whole_files import write_whole

_SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
_EXPECTED = {signal.SIGKILL: -signal.SIGKILL, signal.SIGTERM: 143, signal.SIGINT: 130}
_START_S, _END_S = 300.0, 3600.0
_STAMP = struct.Struct("<q")
_CHILD = (
    "from coclo_vio.experiments.kills import show_position; show_position(); from coclo_vio.cli import main; main()"
)
_STAMP_FILE = "COCLO_VIO_STAMP_FILE"


@dataclass(frozen=True, slots=True)
class Kill:
    """What became of one run.

    Attributes:
        command: ``run`` or ``compare``.
        modes: that it ran.
        signal: that ended it.
        at_share: of the recording when it was sent.
        status: of the process.
        is_status_right: whether that is the expected one.
        lost_s: seconds of recording that were read and are not in the files of the mode that ran.
        is_evaluated: whether every trajectory that began was evaluated, or had too few poses for it.
        reason: why not.
        resumed_status: of the process that resumed it.
        resumed_from_s: seconds of recording that were not computed again, by mode.
        worst: largest difference between the resumed and the uninterrupted files; None where they differ in length.
        has_same_events: whether events, counts and keyframes are the same.
    """

    command: str
    modes: str
    signal: str
    at_share: float
    status: int
    is_status_right: bool
    lost_s: float | None
    is_evaluated: bool
    reason: str
    resumed_status: int
    resumed_from_s: dict[str, list[float]]
    worst: float | None
    has_same_events: bool


@dataclass(frozen=True, slots=True)
class Case:
    """A command and its modes; with the recording's path and further arguments."""

    command: str
    modes: str
    recording: Path
    more: tuple[str, ...]

    def arguments(self, folder: Path) -> list[str]:
        """The command line."""
        flag = "--mode" if self.command == "run" else "--modes"
        return [self.command, str(self.recording), flag, self.modes, "-o", str(folder), *self.more]


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns its status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder for runs and kills.json")
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--interval", type=float, default=3.0, help="seconds between checkpoints")
    parser.add_argument("--recording", type=Path, default=None, help="the bundled sample if not given")
    parser.add_argument("--robot", default="daisy")
    parser.add_argument("--modes", default="coclo,naive", help="for run, one after the other; compare takes them all")
    given = parser.parse_args(arguments)
    more = ("--robot", given.robot, "--set", f"checkpoints.interval_s={given.interval}")
    recording = given.recording or sample_path()
    cases = [Case("run", mode, recording, more) for mode in given.modes.split(",")]
    if "," in given.modes:
        cases.append(Case("compare", given.modes, recording, more))
    given.output.mkdir(parents=True, exist_ok=True)
    rng = random.Random(given.seed)
    kills: list[Kill] = []
    for number in range(given.kills):
        case, sent = cases[number % len(cases)], _SIGNALS[number // len(cases) % len(_SIGNALS)]
        kills.append(kill_one(case, sent, rng.random(), given.output))
        print(kills[-1], flush=True)
        summary = summarised(kills)
        write_whole(
            given.output / "kills.json",
            json.dumps({"summary": summary, "kills": [asdict(kill) for kill in kills]}, indent=1) + "\n",
        )
    print(json.dumps(summarised(kills), indent=1))
    return 0 if all(is_passed(kill) for kill in kills) else 1


def is_passed(kill: Kill) -> bool:
    """Whether nothing was lost but the last second, and the resumed run equals the uninterrupted one."""
    is_whole = kill.lost_s is None or kill.lost_s <= 1.0
    is_equal = kill.worst is not None and kill.worst <= 1e-9 and kill.has_same_events
    return kill.is_status_right and is_whole and kill.is_evaluated and kill.resumed_status == 0 and is_equal


def summarised(kills: Sequence[Kill]) -> dict[str, object]:
    """Counts of what went as it should, and the worst figures."""
    return {
        "kills": len(kills),
        "passed": sum(map(is_passed, kills)),
        "right_status": sum(kill.is_status_right for kill in kills),
        "evaluated": sum(kill.is_evaluated for kill in kills),
        "resumed": sum(kill.resumed_status == 0 for kill in kills),
        "equal": sum(kill.worst is not None and kill.worst <= 1e-9 for kill in kills),
        "worst_lost_s": max((kill.lost_s for kill in kills if kill.lost_s is not None), default=None),
        "worst_difference": max((kill.worst for kill in kills if kill.worst is not None), default=None),
        "by_signal": {each.name: sum(kill.signal == each.name for kill in kills) for each in _SIGNALS},
    }


def kill_one(case: Case, sent: signal.Signals, share: float, output: Path) -> Kill:
    """End a run when it has read ``share`` of the recording, and look at what is left."""
    whole = output / f"whole_{case.command}_{case.modes.replace(',', '_')}"
    if not (whole / run_folder.RUN_JSON).is_file():
        _finished(case.arguments(whole), output / "whole.stamp")
    folder = output / "killed"
    shutil.rmtree(folder, ignore_errors=True)
    record = run_folder.read_record(whole)
    assert record.recording_ns is not None
    start_ns, end_ns = record.recording_ns
    modes = list(record.by_mode())
    target = share * len(modes)
    stamp_file = output / "killed.stamp"
    process = _started(case.arguments(folder), stamp_file)
    read = _wait_for(process, stamp_file, int(target), start_ns + round((target % 1.0) * (end_ns - start_ns)))
    process.send_signal(sent)
    status = process.wait(_END_S)
    lost_s, is_evaluated, reason = _left(folder, modes[min(int(target), len(modes) - 1)], read)
    resumed = _finished([*case.arguments(folder), "--resume"], output / "resumed.stamp")
    worst, has_same_events, from_s = _compared(whole, folder, start_ns)
    return Kill(
        case.command,
        case.modes,
        sent.name,
        round(share, 4),
        status,
        status == _EXPECTED[sent],
        lost_s,
        is_evaluated,
        reason,
        resumed,
        from_s,
        worst,
        has_same_events,
    )


def _left(folder: Path, mode: str, read_ns: int) -> tuple[float | None, bool, str]:
    """What a killed run left: seconds that are missing, whether it can be evaluated, and why not."""
    try:
        found = run_folder.read_record(folder)
        evaluations, failures = evaluate_run(folder, evaluation_config(folder / "config.yaml"))
    except CocloError as error:
        return None, False, str(error)
    run = found.by_mode().get(mode)
    lost_s = None if run is None or run.last_ns is None else max(0, read_ns - run.last_ns) / NS_PER_S
    too_short = {name: why for name, why in failures.items() if found.estimators[name].estimates < 200}
    others = {name: why for name, why in failures.items() if name not in too_short}
    return lost_s, bool(evaluations or too_short) and not others, "; ".join(failures.values())


def _compared(whole: Path, resumed: Path, start_ns: int) -> tuple[float | None, bool, dict[str, list[float]]]:
    """Largest difference of all numbers in the files, whether the records agree, and where modes were resumed."""
    worst = 0.0
    one, other = run_folder.read_record(whole), run_folder.read_record(resumed)
    from_s = {
        mode: [(stamp_ns - start_ns) / NS_PER_S for stamp_ns in run.resumed_ns] for mode, run in other.by_mode().items()
    }
    for path in sorted((*whole.glob("*.tum"), *whole.glob("*.csv"))):
        ours = (resumed / path.name).read_bytes()
        if ours == path.read_bytes():
            continue
        delimiter, skip = (None, 0) if path.suffix == ".tum" else (",", 1)
        before, after = (np.loadtxt(each, delimiter=delimiter, skiprows=skip) for each in (path, resumed / path.name))
        if path.name.endswith("_keyframes.csv"):  # computing time is another one
            before, after = np.delete(before, 7, axis=1), np.delete(after, 7, axis=1)
        if before.shape != after.shape:
            return None, False, from_s
        worst = max(worst, float(np.nanmax(np.abs(before - after), initial=0.0)))
    same = all(
        run.events == other.estimators[name].events and run.counts == other.estimators[name].counts
        for name, run in one.estimators.items()
    )
    return worst, same and one.estimators.keys() == other.estimators.keys(), from_s


def _started(arguments: Sequence[str], stamp_file: Path) -> "subprocess.Popen[bytes]":
    stamp_file.write_bytes(_STAMP.pack(0) * 2)
    log = (stamp_file.with_suffix(".log")).open("wb")
    environment = {**os.environ, _STAMP_FILE: str(stamp_file)}
    command = [sys.executable, "-c", _CHILD, *arguments]
    return subprocess.Popen(command, env=environment, stdout=log, stderr=subprocess.STDOUT)


def _finished(arguments: Sequence[str], stamp_file: Path) -> int:
    return _started(arguments, stamp_file).wait(_END_S)


def _wait_for(process: "subprocess.Popen[bytes]", stamp_file: Path, modes: int, stamp_ns: int) -> int:
    """Wait until the process has finished so many modes and read up to a stamp; what it has read then."""
    until_s = time.monotonic() + _START_S
    while process.poll() is None and time.monotonic() < until_s:
        finished, read_ns = (value for (value,) in _STAMP.iter_unpack(stamp_file.read_bytes()))
        if finished > modes or (finished == modes and read_ns >= stamp_ns):
            return int(read_ns)
        time.sleep(0.002)
    return 0


def show_position() -> None:
    """From now on runs in this process write how many modes they have finished, and which stamp they have read."""
    path = Path(os.environ[_STAMP_FILE])
    with path.open("r+b") as file:
        shared = mmap.mmap(file.fileno(), 2 * _STAMP.size)
    advance, run = ModeRun._advance, ModeRun.run

    def advanced(self: ModeRun, stamp_ns: int) -> None:
        shared[_STAMP.size :] = _STAMP.pack(stamp_ns)
        advance(self, stamp_ns)

    def ran(self: ModeRun, *given: object) -> None:
        run(self, *given)  # type: ignore[arg-type]
        shared[:] = _STAMP.pack(_STAMP.unpack(shared[: _STAMP.size])[0] + 1) + _STAMP.pack(0)

    ModeRun._advance, ModeRun.run = advanced, ran  # type: ignore[assignment,method-assign]


if __name__ == "__main__":
    sys.exit(main())

# SPDX-License-Identifier: BSD-3-Clause
"""How many times as fast as another commit: the same commands by both checkouts, in turns, on one core.

The processor time of whole commands is compared, reading, estimating and writing included; each runs once before it
counts, so that kernels are compiled. Of a second core, the wall time counts.
"""

import json
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import ClassVar, Literal

from pydantic import BaseModel, ConfigDict

from coclo_vio.datasets.sample import sample_path
from coclo_vio.experiments.results.provenance import Provenance
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.record import Record

_COMMAND_LINE = "from coclo_vio.cli import main; main()"
_BENCHMARK_FIGURES = ("frontend_ms_median", "smoother_ms_median", "vision_ms_per_frame")
_ONE_CORE = {0}
_FRAME_THREADS = ("--set", "bridge.frame_threads=1", "--set", "dataset.reading_threads=1")
_THREADS = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}


class SpeedRatio(BaseModel):
    """One comparison.

    Attributes:
        what: was run, in words.
        before: processor time by the earlier commit, s, or a figure of its benchmark, ms: the least of all rounds.
        after: the same by the later one.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    what: str
    before: float
    after: float

    @property
    def ratio(self) -> float:
        """How many times as fast."""
        return self.before / self.after


class CommitSpeed(Record):
    """``commit_speed.json``.

    Attributes:
        origin: of the later commit.
        before: short hash of the earlier one.
        ratios: by name.
        second_core: wall time of ``combined`` on one core over that on two, and whether the trajectories are the same
            bytes; None where it was not measured.
    """

    next_step: ClassVar[str] = "measure again with `make bench-commits BEFORE=COMMIT`"
    schema_version: Literal[1] = 1

    origin: Provenance
    before: str
    ratios: dict[str, SpeedRatio]
    second_core: "SecondCore | None"


class SecondCore(BaseModel):
    """What a second core brings.

    Attributes:
        one_s: wall time on one core, s.
        two_s: wall time on two, s.
        is_same: whether all trajectories are the same bytes.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    one_s: float
    two_s: float
    is_same: bool


CommitSpeed.model_rebuild()


@dataclass(frozen=True, slots=True)
class TimedCommand:
    """A command whose processor time is compared.

    Attributes:
        what: it is, in words.
        arguments: of the command line, without the output folder.
    """

    what: str
    arguments: tuple[str, ...]


def timed_commands(sample: Path, shared: Path | None) -> dict[str, TimedCommand]:
    """The commands by name; those of a recording that is not there are left out."""
    commands = {
        "coclo_six_legs": TimedCommand("`coclo`, six legs at 100 Hz", ("run", str(sample), "--mode", "coclo")),
        "vins": TimedCommand("`vins` on stairs, images included", ("run", str(sample), "--mode", "vins")),
        "combined": TimedCommand("`combined` on stairs, images included", ("run", str(sample), "--mode", "combined")),
    }
    go1 = None if shared is None else shared / "go1_mocap"
    if go1 is not None and go1.is_dir():
        arguments = ("run", str(go1), "--robot", "go1", "--mode", "coclo")
        commands = {"coclo_go1": TimedCommand("`coclo`, a real Go1's log at 400 Hz", arguments), **commands}
    return commands


def processor_ratios(
    before: Path, after: Path, commands: Mapping[str, TimedCommand], rounds: int
) -> dict[str, SpeedRatio]:
    """Compare the processor time of the commands by two checkouts, both on the same core.

    Args:
        before: checkout of the earlier commit.
        after: of the later.
        commands: by name.
        rounds: repetitions in turns after a first one that does not count; the least of each counts.

    Raises:
        DatasetError: a command fails.
    """
    ratios = {}
    with TemporaryDirectory() as scratch:
        for name, command in commands.items():
            taken: dict[Path, list[float]] = {before: [], after: []}
            for number in range(rounds + 1):
                for which, checkout in enumerate(taken):
                    folder = Path(scratch) / f"{name}_{number}_{which}"
                    taken[checkout].append(_processor_s(checkout, [*command.arguments, "-o", str(folder)], _ONE_CORE))
            ratios[name] = SpeedRatio(
                what=f"{command.what}, whole command, s", before=min(taken[before][1:]), after=min(taken[after][1:])
            )
    return ratios


def second_core(checkout: Path, command: TimedCommand, threads: Sequence[str], rounds: int) -> SecondCore:
    """Wall time on one core, and on two with threads, in turns.

    Args:
        checkout: of the commit.
        command: what is run.
        threads: further arguments with which it uses threads, on two cores only.
        rounds: repetitions in turns; the least of each counts.

    Raises:
        DatasetError: the command fails.
    """
    taken: dict[int, list[float]] = {1: [], 2: []}
    with TemporaryDirectory() as scratch:
        for number in range(rounds):
            for cores, seconds in taken.items():
                folder = Path(scratch) / f"{number}_{cores}"
                arguments = [*command.arguments, *(threads if cores > 1 else ()), "-o", str(folder)]
                started_s = perf_counter()
                _processor_s(checkout, arguments, set(range(cores)))
                seconds.append(perf_counter() - started_s)
        one, two = ({path.name: path.read_bytes() for path in _trajectories(scratch, cores)} for cores in taken)
    return SecondCore(one_s=min(taken[1]), two_s=min(taken[2]), is_same=bool(one) and one == two)


def _trajectories(scratch: str, cores: int) -> Sequence[Path]:
    return sorted((Path(scratch) / f"0_{cores}").glob("*.tum"))


def _figures(before: Path, after: Path, rounds: int) -> dict[str, SpeedRatio]:
    """Figures of vision of ``benchmark --json``, in turns."""
    figures: dict[Path, list[dict[str, float]]] = {before: [], after: []}
    for _ in range(rounds):
        for checkout, measured in figures.items():
            measured.append(json.loads(_output(checkout, ["benchmark", "--json"], _ONE_CORE)))
    names = {
        "frontend_ms_median": "front end, ms a frame, median",
        "smoother_ms_median": "window, ms a keyframe, median",
        "vision_ms_per_frame": "vision, ms a frame, mean",
    }
    return {
        name: SpeedRatio(
            what=names[name],
            before=min(one[name] for one in figures[before]),
            after=min(one[name] for one in figures[after]),
        )
        for name in _BENCHMARK_FIGURES
    }


def _processor_s(checkout: Path, arguments: Sequence[str], cpus: set[int]) -> float:
    began = resource.getrusage(resource.RUSAGE_CHILDREN)
    _output(checkout, arguments, cpus)
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return ended.ru_utime + ended.ru_stime - began.ru_utime - began.ru_stime


def _output(checkout: Path, arguments: Sequence[str], cpus: set[int]) -> str:
    """Standard output of a checkout's command line.

    Raises:
        DatasetError: it fails.
    """
    done = subprocess.run(
        [sys.executable, "-c", _COMMAND_LINE, *arguments],
        cwd=checkout,
        env={**os.environ, **_THREADS, "PYTHONPATH": str(checkout)},
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: os.sched_setaffinity(0, cpus),
    )
    if done.returncode:
        command = " ".join(arguments)
        raise DatasetError(f"{checkout}: coclo-vio {command} ended with status {done.returncode}: {done.stderr[-400:]}")
    return done.stdout


def measure_commits(before: str, root: Path, shared: Path | None, rounds: int) -> CommitSpeed:
    """How many times as fast the present commit is as an earlier one, on the present bundled sample.

    Args:
        before: the earlier commit.
        root: of the checkout.
        shared: folder of recordings that are not part of the package; None where there is none.
        rounds: repetitions in turns.

    Raises:
        DatasetError: there is no such commit, or a command fails.
    """
    sample = root / "coclo_vio" / "datasets" / "sample_data" / sample_path().name
    commands = timed_commands(sample.resolve(), None if shared is None else shared.resolve())
    with TemporaryDirectory() as scratch:
        checkout = Path(scratch) / "before"
        _git(root, "worktree", "add", "--detach", str(checkout), before)
        try:
            for theirs in checkout.rglob(sample.name):
                shutil.copyfile(sample, theirs)  # the benchmark reads the sample of its own checkout
            ratios = processor_ratios(checkout, root.resolve(), commands, rounds)
            ratios |= _figures(checkout, root.resolve(), rounds)
            short = _git(root, "rev-parse", "--short=7", before)
        finally:
            _git(root, "worktree", "remove", "--force", str(checkout))
    cores = len(os.sched_getaffinity(0))
    second = second_core(root.resolve(), commands["combined"], _FRAME_THREADS, rounds) if cores > 1 else None
    command = f"make bench-commits BEFORE={short}"
    return CommitSpeed(origin=Provenance.now(command, root), before=short, ratios=ratios, second_core=second)


def _git(root: Path, *arguments: str) -> str:
    done = subprocess.run(["git", "-C", str(root), *arguments], check=False, capture_output=True, text=True)
    if done.returncode:
        raise DatasetError(f"git {' '.join(arguments)} failed: {done.stderr.strip()}")
    return done.stdout.strip()

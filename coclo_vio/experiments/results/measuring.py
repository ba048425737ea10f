# SPDX-License-Identifier: BSD-3-Clause
"""Measures into the folder of results: the demo, a real Go1, speed and costs."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from coclo_vio.evaluation.evaluation_record import ComparisonRecord
from coclo_vio.experiments.results.provenance import Provenance, Provenances
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.record import read_json, write_json

RESULTS = Path("docs") / "results"
IMAGES = Path("docs") / "images"
_GO1_MODES = "naive,naive_rolling,naive_weighted,coclo,coclo_leg_scale,coclo_paper,inekf"
_GO1 = Path("..") / "shared" / "data" / "go1_mocap"
BEFORE_SPEED = "8fd7be3"
"""The commit before filter, front end and window were compiled, with which speed is compared."""
_NEXT = "measure again with `make results`"


def measure(name: str, root: Path) -> None:
    """Measure one result and note its origin.

    Args:
        name: one of ``MEASURED``.
        root: of the checkout.

    Raises:
        DatasetError: the command fails, or the recording is not there.
    """
    make = MEASURED[name]
    command = make(root)
    path = root / RESULTS / "provenance.json"
    known = Provenances.read(path) if path.is_file() else Provenances({})
    known.with_entry(f"{name}.json", Provenance.now(command, root)).write(path)


def _demo(root: Path) -> str:
    """What ``coclo-vio demo`` prints and measures on the bundled recording."""
    with TemporaryDirectory() as scratch:
        printed = _run(root, "demo", "-o", scratch)
        metrics = ComparisonRecord.read(Path(scratch) / "compare.json")
        shutil.copyfile(Path(scratch) / "figures" / "overview.png", root / IMAGES / "demo.png")
    lines = [line.rstrip() for line in printed.splitlines() if not line.startswith("report: ")]
    values = {"printed": "\n".join(lines).strip("\n"), "metrics": metrics.to_json()}
    write_json(root / RESULTS / "demo.json", values)
    return "coclo-vio demo"


def _go1(root: Path) -> str:
    """A real Go1 with motion capture, every mode of legs."""
    recording = root / _GO1
    if not recording.is_dir():
        raise DatasetError(f"there is no {recording}: the Go1's recording is not part of the package; leave out go1")
    with TemporaryDirectory() as scratch:
        _run(root, "compare", str(recording), "--robot", "go1", "--modes", _GO1_MODES, "-o", scratch)
        metrics = ComparisonRecord.read(Path(scratch) / "compare.json")
        shutil.copyfile(Path(scratch) / "figures" / "path.png", root / IMAGES / "go1_path.png")
    write_json(root / RESULTS / "go1.json", metrics.to_json())
    return f"coclo-vio compare RECORDING --robot go1 --modes {_GO1_MODES}"


def _speed(root: Path) -> str:
    """Latencies and rates on one core."""
    printed = _run(root, "benchmark", "--json")
    path = root / RESULTS / "speed.json"
    path.write_text(printed, encoding="utf-8")
    write_json(path, read_json(path, _NEXT))
    return "coclo-vio benchmark --json"


def _bench(root: Path) -> str:
    """Cost of every stage, how it grows, and an hour of input at a stretch; takes about half an hour."""
    arguments = ["--scaling", "--minutes", "60"]
    plot = IMAGES / "scaling.png"
    _run_bench(root, *arguments, "--plot", str(plot), "-o", str(RESULTS / "bench.json"))
    return f"python -m coclo_vio.experiments.bench {' '.join(arguments)}"


def _commit_speed(root: Path) -> str:
    """How many times as fast as the commit before the work on speed, and what a second core brings."""
    arguments = ["--before", BEFORE_SPEED]
    _run_bench(root, *arguments, "-o", str(RESULTS / "commit_speed.json"))
    return f"python -m coclo_vio.experiments.bench {' '.join(arguments)}"


MEASURED: Mapping[str, Callable[[Path], str]] = {
    "demo": _demo,
    "go1": _go1,
    "speed": _speed,
    "bench": _bench,
    "commit_speed": _commit_speed,
}
"""What ``measure`` can do; the larger studies write their files themselves."""


def _run(root: Path, *arguments: str) -> str:
    """Standard output of the command line, on one core.

    Raises:
        DatasetError: it fails.
    """
    return _output(root, "coclo_vio", arguments)


def _run_bench(root: Path, *arguments: str) -> None:
    """The benchmark of costs, which binds the processes that it starts to a core itself.

    Raises:
        DatasetError: it fails.
    """
    print(_output(root, "coclo_vio.experiments.bench", arguments), file=sys.stderr)


def _output(root: Path, module: str, arguments: Sequence[str]) -> str:
    one_thread = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "COLUMNS": "100"}
    done = subprocess.run(
        [sys.executable, "-m", module, *arguments],
        cwd=root,
        env={**os.environ, **one_thread},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise DatasetError(f"{module} {' '.join(arguments)} ended with status {done.returncode}: {done.stderr[-500:]}")
    return done.stdout

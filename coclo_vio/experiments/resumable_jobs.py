# SPDX-License-Identifier: BSD-3-Clause
"""What experiments share that go on where they stopped: results by commit of the code, and jobs in processes."""

import hashlib
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

import coclo_vio
from coclo_vio.experiments.results.provenance import Provenance
from coclo_vio.experiments.studies.study import Row, run_jobs
from coclo_vio.values.errors import DatasetError

_ROOT = Path(coclo_vio.__file__).resolve().parents[1]
_CODE = ("coclo_vio", ":!coclo_vio/cli", ":!coclo_vio/experiments")
CODE_OF_RECORDINGS = ("coclo_vio/simulation", "coclo_vio/robot", "coclo_vio/datasets/rosbag/writing")
"""What decides simulated recordings, as paths of git."""


class ResumableUnit(Protocol):
    """A recording and its unfinished jobs; can be pickled for another process."""

    def run(self, origin: Provenance) -> Row:
        """Run the jobs, each stored as soon as it is finished; ``lines`` of progress."""


def run_units(work: Sequence[ResumableUnit], origin: Provenance, workers: int, report: Callable[[str], None]) -> None:
    """Run the work, in this process with one worker.

    Args:
        work: that is left.
        origin: of the results.
        workers: how many processes.
        report: called with lines of progress.

    Raises:
        DatasetError: a finished job cannot be stored.
    """
    rows = (
        (unit.run(origin) for unit in work)
        if workers == 1
        else run_jobs(_run, [(unit, origin) for unit in work], workers)
    )
    for row in rows:
        for line in row["lines"]:
            report(line)


def _run(unit: ResumableUnit, origin: Provenance) -> Row:
    return unit.run(origin)


def commit_of_code(root: Path = _ROOT, code: Sequence[str] = _CODE) -> str:
    """The last commit that changed what decides results; with a digest of changes that are not committed.

    Args:
        root: of the checkout.
        code: paths of git.

    Raises:
        DatasetError: it is no git checkout.
    """
    try:
        commit = _git(root, "log", "-1", "--format=%h", "--", *code)
        changes = _git(root, "diff", "HEAD", "--", *code)
    except (OSError, subprocess.CalledProcessError) as error:
        raise DatasetError(f"{root} is no git checkout, so results cannot be kept by commit: {error}") from error
    return commit + (f"+{hashlib.sha256(changes.encode()).hexdigest()[:6]}" if changes else "")


def _git(root: Path, *arguments: str) -> str:
    done = subprocess.run(["git", "-C", str(root), *arguments], check=True, capture_output=True, text=True)
    return done.stdout.strip()

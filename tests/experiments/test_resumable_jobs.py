# SPDX-License-Identifier: BSD-3-Clause
"""Experiments that go on where they stopped: the commit that their results are kept by, and jobs in processes."""

import os
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

from coclo_vio.experiments.results.provenance import Provenance
from coclo_vio.experiments.resumable_jobs import CODE_OF_RECORDINGS, commit_of_code, run_units
from coclo_vio.experiments.studies.study import Row
from coclo_vio.values.errors import DatasetError

ORIGIN = Provenance(commit="abc1234", date="2026-01-02", machine="one", versions={}, command="a command")


@dataclass(frozen=True, slots=True)
class NamedUnit:
    """Two jobs of a recording, which note the process that ran them; without a name they cannot be stored."""

    folder: Path
    name: str

    def run(self, origin: Provenance) -> Row:
        if not self.name:
            raise DatasetError("the disk is full")
        (self.folder / self.name).write_text(str(os.getpid()), encoding="utf-8")
        return {"lines": [f"{self.name}-{mode}: by {origin.commit}" for mode in ("coclo", "vins")]}


def lines_of(work: list[NamedUnit], workers: int) -> list[str]:
    lines: list[str] = []
    run_units(work, ORIGIN, workers, lines.append)
    return lines


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.long)])
def test_every_job_is_run_and_reported_once(tmp_path: Path, workers: int) -> None:
    lines = lines_of([NamedUnit(tmp_path, name) for name in ("flat", "ramp", "stairs")], workers)
    expected = [f"{name}-{mode}: by abc1234" for name in ("flat", "ramp", "stairs") for mode in ("coclo", "vins")]
    assert (lines if workers == 1 else sorted(lines)) == expected
    processes = {path.read_text(encoding="utf-8") for path in tmp_path.iterdir()}
    assert (str(os.getpid()) in processes) is (workers == 1)


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.long)])
def test_a_job_that_cannot_be_stored_is_an_error(tmp_path: Path, workers: int) -> None:
    with pytest.raises(DatasetError, match="the disk is full"):
        lines_of([NamedUnit(tmp_path, "")], workers)


def test_lines_come_as_soon_as_a_unit_is_finished(tmp_path: Path) -> None:
    lines: list[str] = []
    with pytest.raises(DatasetError):
        run_units([NamedUnit(tmp_path, "flat"), NamedUnit(tmp_path, "")], ORIGIN, 1, lines.append)
    assert lines == ["flat-coclo: by abc1234", "flat-vins: by abc1234"]


def git(root: Path, *arguments: str) -> None:
    name = ("-c", "user.name=a", "-c", "user.email=a@b.c")
    subprocess.run(["git", "-C", str(root), *name, *arguments], check=True, capture_output=True)


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A git checkout with a commit of some parts of the package."""
    git(tmp_path, "init", "-q")
    for part in ("filter", "simulation", "cli"):
        (tmp_path / "coclo_vio" / part).mkdir(parents=True)
        (tmp_path / "coclo_vio" / part / "a.py").write_text("1\n", encoding="utf-8")
    git(tmp_path, "add", "-A")
    git(tmp_path, "commit", "-qm", "one")
    return tmp_path


def test_the_commit_of_the_code_has_a_digest_of_what_is_not_committed(checkout: Path) -> None:
    first = commit_of_code(checkout)
    (checkout / "coclo_vio" / "cli" / "a.py").write_text("2\n", encoding="utf-8")
    git(checkout, "commit", "-qam", "two")
    assert commit_of_code(checkout) == first, "the command line decides no result"
    (checkout / "coclo_vio" / "filter" / "a.py").write_text("2\n", encoding="utf-8")
    changed = commit_of_code(checkout)
    assert changed.startswith(f"{first}+")
    git(checkout, "commit", "-qam", "three")
    assert "+" not in commit_of_code(checkout) != first
    with pytest.raises(DatasetError, match="no git checkout"):
        commit_of_code(checkout / "coclo_vio" / "none")


def test_recordings_are_kept_while_what_makes_them_is_as_it_was(checkout: Path) -> None:
    first = commit_of_code(checkout, CODE_OF_RECORDINGS)
    (checkout / "coclo_vio" / "filter" / "a.py").write_text("2\n", encoding="utf-8")
    git(checkout, "commit", "-qam", "two")
    assert commit_of_code(checkout, CODE_OF_RECORDINGS) == first != commit_of_code(checkout), (
        "an estimator makes no recording"
    )
    (checkout / "coclo_vio" / "simulation" / "a.py").write_text("2\n", encoding="utf-8")
    assert commit_of_code(checkout, CODE_OF_RECORDINGS).startswith(f"{first}+")

# SPDX-License-Identifier: BSD-3-Clause
"""Where a result comes from: commit, date, machine, versions and command, one entry a file of results."""

import os
import platform
import subprocess
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import ClassVar, Self

from pydantic import BaseModel, ConfigDict, RootModel

from coclo_vio.values.errors import DatasetError
from coclo_vio.values.record import JsonModel

_LIBRARIES = ("numpy", "gtsam", "opencv-python-headless", "pin")


class Provenance(BaseModel):
    """The origin of one file of results.

    Attributes:
        commit: of the code, short; with ``+`` where the tree had changes that were not committed.
        date: of the measurement, year-month-day.
        machine: processor and number of cores.
        versions: of Python and of the libraries that do the computing; empty where it was not noted.
        command: that makes the file.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    commit: str
    date: str
    machine: str
    versions: dict[str, str]
    command: str

    @classmethod
    def now(cls, command: str, root: Path) -> Self:
        """The origin of what is measured now.

        Args:
            command: that makes the file.
            root: of the checkout.

        Raises:
            DatasetError: it is no git checkout.
        """
        return cls(
            commit=_commit(root),
            date=datetime.now(UTC).date().isoformat(),
            machine=_machine(),
            versions={"python": platform.python_version(), **{name: version(name) for name in _LIBRARIES}},
            command=command,
        )

    @property
    def sentence(self) -> str:
        """For a reader of a page."""
        return f"Commit {self.commit}, {self.date}, {self.machine}: `{self.command}`"


class Provenances(JsonModel, RootModel[dict[str, Provenance]]):
    """``provenance.json``: the origin of each file of results beside it, by the name of the file."""

    next_step: ClassVar[str] = "measure again with `make results`"

    def of(self, name: str) -> Provenance:
        """The origin of a file.

        Raises:
            DatasetError: it is not noted.
        """
        if name not in self.root:
            raise DatasetError(f"provenance.json has no entry for {name}; {self.next_step}")
        return self.root[name]

    def with_entry(self, name: str, provenance: Provenance) -> Self:
        """The same with one entry new or replaced."""
        return type(self)({**self.root, name: provenance})


def committed_text(root: Path, path: Path) -> str | None:
    """A file as the last commit has it; None where it has none, or there is no git checkout.

    Args:
        root: of the checkout.
        path: within it.
    """
    try:
        return _git(root, "show", f"HEAD:./{path.as_posix()}")
    except (OSError, subprocess.CalledProcessError):
        return None


def _commit(root: Path) -> str:
    try:
        short = _git(root, "rev-parse", "--short=7", "HEAD")
        is_changed = bool(_git(root, "status", "--porcelain", "--untracked-files=no", "--", "coclo_vio"))
    except (OSError, subprocess.CalledProcessError) as error:
        raise DatasetError(f"{root} is no git checkout, so the origin of results cannot be noted: {error}") from error
    return short + ("+" if is_changed else "")


def _git(root: Path, *arguments: str) -> str:
    done = subprocess.run(["git", "-C", str(root), *arguments], check=True, capture_output=True, text=True)
    return done.stdout.strip()


def _machine() -> str:
    """Processor and cores, without the name of the host."""
    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        model = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), model)
    except OSError:
        pass
    return f"{os.cpu_count()} cores of {model}"

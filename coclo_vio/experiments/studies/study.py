# SPDX-License-Identifier: BSD-3-Clause
"""What all studies share: options, worker processes, recordings, and results that an interrupted study continues."""

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from coclo_vio.evaluation.evaluate import EvaluationConfig
from coclo_vio.experiments.table.job import against_truth
from coclo_vio.simulation.simulated_recording import Execution, SimulationConfig, simulate_recording
from coclo_vio.simulation.trial.terrain import TerrainName
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.record import read_json, write_json

Row = dict[str, Any]
"""Results of one trial, or of one case of it, as JSON."""

JPEG = {"camera": {"encoding": "jpeg"}}
"""A change of the simulation: images a third as large as PNG."""

AGAINST_TRUTH = against_truth(EvaluationConfig())
"""Evaluation against the exact truth, on the recording's clock."""

_NEXT_STEP = "remove it, or name another file with -o"


def parser(description: str | None, output: Path) -> argparse.ArgumentParser:
    """A parser with ``-o``, whose default is ``output``; the description is the first line of a docstring."""
    made = argparse.ArgumentParser(description=(description or "").partition("\n")[0])
    made.add_argument("-o", "--output", type=Path, default=output, help="JSON file of the results")
    return made


def add_seeds_and_workers(to: argparse.ArgumentParser, seeds: int) -> None:
    """Options of a study over many trials: ``--seeds``, ``--first-seed``, ``--workers``."""
    to.add_argument("--seeds", type=int, default=seeds, help="number of seeds")
    to.add_argument("--first-seed", type=int, default=1)
    to.add_argument("--workers", type=int, default=1, help="processes")


def seeds_of(options: argparse.Namespace) -> range:
    """The seeds of ``--seeds`` and ``--first-seed``."""
    return range(options.first_seed, options.first_seed + options.seeds)


@dataclass(slots=True)
class ResultFile:
    """The rows of a study and their summary in a JSON file, written after each row.

    Attributes:
        path: of the file; rows of an earlier run are read from it.
        summarise: the summary of all rows.
        key: identifies a row, and orders the rows.
        parts: name of the mapping in a row whose entries add up over runs, such as ``modes``; None where a new row
            replaces the earlier one.
        rows_name: of the rows in the file.

    Raises:
        DatasetError: the file exists and is no result of this study.
    """

    path: Path
    summarise: Callable[[list[Row]], Row]
    key: Callable[[Row], tuple[int, ...]]
    parts: str | None = None
    rows_name: str = "trials"
    rows: list[Row] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if self.path.is_file():
            document = read_json(self.path, _NEXT_STEP)
            if not isinstance(document, dict) or self.rows_name not in document:
                raise DatasetError(
                    f"{self.path} has no {self.rows_name!r}: it is no result of this study; {_NEXT_STEP}"
                )
            self.rows = document[self.rows_name]

    def add(self, row: Row) -> None:
        """Add a row, or its parts to the row with the same key, and write the file."""
        earlier = [each for each in self.rows if self.key(each) == self.key(row)]
        if self.parts is not None:
            parts = {name: part for each in (*earlier, row) for name, part in each[self.parts].items()}
            row = {**row, self.parts: parts}
        others = [each for each in self.rows if self.key(each) != self.key(row)]
        self.rows = sorted([*others, row], key=self.key)
        write_json(self.path, {"summary": self.summary(), self.rows_name: self.rows})

    def summary(self) -> Row:
        """The summary of all rows."""
        return self.summarise(self.rows)


def run_jobs(function: Callable[..., Row], jobs: Iterable[tuple[Any, ...]], workers: int) -> Iterator[Row]:
    """The rows of a module's function for each tuple of arguments, from worker processes, in order of completion."""
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        for job in as_completed([pool.submit(function, *arguments) for arguments in jobs]):
            yield job.result()


def simulate_if_missing(
    path: Path, name: TerrainName, seed: int, config: SimulationConfig, *, images: bool = True
) -> bool:
    """Simulate the recording ``path`` if it does not exist; returns whether it was simulated.

    Raises:
        DatasetError: it cannot be written.
        SimulationError: the robot fell, or there is no OpenGL to render with.
    """
    if path.exists():
        return False
    report(f"{path.name}: simulating")
    simulate_recording(path, name, config, seed, images=images, execution=Execution(workers=1))
    return True


def report(line: str) -> None:
    """Print a line of progress on standard error."""
    print(line, file=sys.stderr)

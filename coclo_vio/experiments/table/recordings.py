# SPDX-License-Identifier: BSD-3-Clause
"""The recordings of a table: simulated where they are missing, each by one process only, and whole or not there."""

import fcntl
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import current_process
from pathlib import Path

from coclo_vio.experiments.table.plan import TablePlan
from coclo_vio.runs import run_folder
from coclo_vio.simulation.simulated_recording import Execution, SimulationConfig, simulate_recording, truth_folder
from coclo_vio.simulation.trial.terrain import TerrainName
from coclo_vio.values.config import read_yaml
from coclo_vio.values.errors import ConfigError, DatasetError, SimulationError
from coclo_vio.values.trajectory import GroundTruth, read_tum


@dataclass(frozen=True, slots=True)
class Recordings:
    """A folder with ``<trial>_<seed>`` (EuRoC style) and, beside each, ``<trial>_<seed>_truth``.

    Attributes:
        folder: of all recordings of the table.
        plan: decides how they are simulated.
        keeps: whether a recording stays once all its jobs are finished.
        motions: folder of true motions, shared by recordings that differ in their sensors only; None: none is kept.
    """

    folder: Path
    plan: TablePlan
    keeps: bool = True
    motions: Path | None = None

    def path(self, trial: TerrainName, seed: int) -> Path:
        """Where a recording is, or will be."""
        return self.folder / f"{trial}_{seed}"

    def check(self) -> None:
        """Check that existing recordings are those of the plan.

        Raises:
            DatasetError: one was simulated with other settings, or its truth is missing.
        """
        for trial, seed in dict.fromkeys((job.trial, job.seed) for job in self.plan.jobs()):
            if self.path(trial, seed).exists():
                self._check(trial, seed)

    def is_there(self, trial: TerrainName, seed: int) -> bool:
        """Whether the whole recording exists."""
        return self.path(trial, seed).exists()

    def make(self, trial: TerrainName, seed: int) -> None:
        """Simulate a recording if it is missing; a second process waits for the first and uses its recording.

        Remains of a killed process are removed.

        Raises:
            SimulationError: it cannot be simulated.
            DatasetError: the folder cannot be written.
        """
        path = self.path(trial, seed)
        run_folder.prepare(self.folder)
        with _alone(path.with_name(f".{path.name}.lock")):
            if path.exists():
                return
            if current_process().daemon:
                raise SimulationError(
                    f"{path} is missing, and this worker, a Dask worker with a nanny, cannot start a process to "
                    "render it: start workers with --no-nanny, or make the recordings first without --scheduler"
                )
            for left in (
                truth_folder(path),
                *(found for found in self.folder.glob(f".{path.name}.*") if found.is_dir()),
            ):
                shutil.rmtree(left, ignore_errors=True)
            simulation = self.plan.simulation_of(trial)
            images, until_s = self.plan.images, self.plan.until_s
            execution = Execution(workers=1, motions=self.motions)
            simulate_recording(path, trial, simulation, seed, images=images, until_s=until_s, execution=execution)

    def truth(self, trial: TerrainName, seed: int) -> GroundTruth:
        """The exact poses, on the clock of the recording."""
        return GroundTruth(read_tum(truth_folder(self.path(trial, seed)) / "groundtruth.tum"), True, "truth")

    def discard(self, trial: TerrainName, seed: int) -> None:
        """Remove a recording and its truth, unless they are kept."""
        if not self.keeps:
            path = self.path(trial, seed)
            shutil.rmtree(path, ignore_errors=True)
            shutil.rmtree(truth_folder(path), ignore_errors=True)

    def _check(self, trial: TerrainName, seed: int) -> None:
        path = self.path(trial, seed)
        config = truth_folder(path) / "config.yaml"
        next_step = f"remove it, or choose another folder than {self.folder} with --recordings"
        if not config.with_name("groundtruth.tum").is_file():
            raise DatasetError(f"{path} has no truth beside it in {config.parent}; {next_step}")
        try:
            made = SimulationConfig.parse(read_yaml(config), str(config))
        except ConfigError as error:
            raise DatasetError(f"{path} was simulated by another release ({error}); {next_step}") from error
        if made != self.plan.simulation_of(trial):
            parts = [
                f"{part}.{key}"
                for part in SimulationConfig.model_fields
                for key, value in getattr(made, part)
                if value != getattr(getattr(self.plan.simulation_of(trial), part), key)
            ]
            raise DatasetError(f"{path} was simulated with other settings ({', '.join(parts)}); {next_step}")


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Only one process at a time is inside; the lock ends with the process that holds it."""
    with run_folder.writing(path.parent), path.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        try:
            yield
        finally:
            path.unlink(missing_ok=True)

# SPDX-License-Identifier: BSD-3-Clause
"""What a grid consists of: a table of trials, seeds and modes for each cell, of one commit of the code."""

from dataclasses import dataclass, field
from pathlib import Path

from coclo_vio.experiments.grid.cells import CELLS, Cell
from coclo_vio.experiments.table.job_store import JobStore
from coclo_vio.experiments.table.plan import Job, TablePlan, default_modes
from coclo_vio.experiments.table.recordings import Recordings
from coclo_vio.experiments.table.table_record import JobRecord
from coclo_vio.experiments.table.work_unit import WorkUnit, units
from coclo_vio.runs.modes.registry import mode_of
from coclo_vio.runs.run_config import RunConfig, resolve
from coclo_vio.simulation.simulated_recording import SIMULATED_ROBOT
from coclo_vio.simulation.trial.terrain import TERRAINS, TerrainName
from coclo_vio.values.config import merged

UNTIL_S = 60.0  # of each trial: the whole ramp, half of the square and of the stairs
FRAME_RATE_HZ = 7.5  # costs nothing in accuracy at this walking speed, and half of the time


class GridStore(JobStore):
    """The finished jobs of a cell, without their trajectories, which would be large."""

    def write(self, job: Job, record: JobRecord) -> None:
        """Keep the result of a job.

        Raises:
            DatasetError: it cannot be written.
        """
        super().write(job, record)
        self.forget_run(job)


@dataclass(frozen=True, slots=True)
class GridPlan:
    """Everything that decides the results of a grid.

    Attributes:
        folder: of results, recordings and motions.
        commit: of the code; results of each are in a folder of its own.
        cells: conditions that hold together.
        seeds: how many.
        first_seed: the first of them; the others follow.
        trials: names of the terrains.
        modes: their names.
        has_policies: whether modes with feedback are run with every policy, not with the default one only.
        until_s: trials end after this long, s; None for whole trials.
        config: of the estimators.
    """

    folder: Path
    commit: str
    cells: tuple[Cell, ...] = CELLS
    seeds: int = 1
    first_seed: int = 1
    trials: tuple[TerrainName, ...] = TERRAINS
    modes: tuple[str, ...] = field(default_factory=default_modes)
    has_policies: bool = True
    until_s: float | None = UNTIL_S
    config: RunConfig = field(default_factory=lambda: resolve(SIMULATED_ROBOT))

    def table(self, cell: Cell) -> TablePlan:
        """The table of a cell."""
        return TablePlan(
            config=self.config,
            seeds=self.seeds,
            first_seed=self.first_seed,
            trials=self.trials,
            modes=self.modes,
            policy_seeds=self.seeds if self.has_policies else 0,
            simulation=merged({"trial": {"frame_rate_hz": FRAME_RATE_HZ}}, cell.changes),
            images=any(mode_of(name).has_cameras for name in self.modes),
            until_s=self.until_s,
            commit=self.commit,
        )

    def store(self, cell: Cell) -> GridStore:
        """The finished jobs of a cell."""
        return GridStore(self.folder / self.commit / cell.name)

    def work(self) -> list[WorkUnit]:
        """What is left to do: all cells of a trial and seed after one another, as they share true motions.

        Raises:
            DatasetError: finished jobs were made with other settings, or a folder cannot be made.
        """
        every: list[WorkUnit] = []
        for cell in self.cells:
            table, store = self.table(cell), self.store(cell)
            places = Recordings(self.folder / "recordings" / cell.name, table, False, self.folder / "motions")
            places.check()
            store.prepare()
            left = units(table, places, store, store.kept(table))
            every += [WorkUnit(unit.jobs, table, places, store, f"{cell.name}/") for unit in left]
        return sorted(every, key=lambda unit: (unit.jobs[0].seed, self.trials.index(unit.jobs[0].trial)))

    def records(self, cell: Cell) -> list[JobRecord]:
        """The finished jobs of a cell.

        Raises:
            DatasetError: they were made with other settings.
        """
        return list(self.store(cell).kept(self.table(cell)).values())

# SPDX-License-Identifier: BSD-3-Clause
"""The paper's figures 4 to 9 of the median recording: standalone and fused estimates beside the ground truth."""

import shutil
from collections.abc import Mapping
from pathlib import Path

from coclo_vio.evaluation.figure_style import save_png
from coclo_vio.evaluation.figures import plot_path, plot_positions, plot_velocities
from coclo_vio.experiments.table.job import keeps_state
from coclo_vio.experiments.table.job_store import JobStore
from coclo_vio.experiments.table.plan import Job, TablePlan
from coclo_vio.experiments.table.summary import representative_seed
from coclo_vio.experiments.table.table_record import JobRecord
from coclo_vio.experiments.table.trial_results import Results
from coclo_vio.runs import run_folder
from coclo_vio.runs.evaluating import evaluate_run
from coclo_vio.values.errors import CocloError
from coclo_vio.values.trajectory import Trajectory


def draw(plan: TablePlan, store: JobStore, records: Mapping[Job, JobRecord]) -> list[Path]:
    """Draw the figures of every trial into ``figures/``; returns their paths.

    Args:
        plan: of the table.
        store: has the trajectories.
        records: of all jobs.

    Raises:
        EvaluationError: matplotlib is missing.
        DatasetError: the folder cannot be written.
    """
    results = Results.of(records.values())
    folder = store.folder / "figures"
    with run_folder.writing(store.folder):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        figures: list[Path] = []
        for trial in plan.trials:
            seed = representative_seed(results, trial)
            if seed is not None:
                jobs = [Job(trial, seed, variant) for variant in plan.variants]
                figures += _of_recording(jobs, plan, store, folder)
    return figures


def _of_recording(jobs: list[Job], plan: TablePlan, store: JobStore, folder: Path) -> list[Path]:
    """Positions over time; where velocities were kept, these and the path from above too."""
    estimates: dict[str, Trajectory] = {}
    references: list[Trajectory] = []
    for job in jobs:
        try:
            evaluations, _ = evaluate_run(store.run_of(job), plan.config.evaluation)
        except CocloError:  # the job failed, its record has the reason
            continue
        estimates |= {name: evaluation.estimate for name, evaluation in evaluations.items()}
        references += [evaluation.reference for evaluation in evaluations.values()]
    if not estimates:
        return []
    name, reference = jobs[0].recording, references[-1]
    drawn = [save_png(plot_positions(estimates, reference), folder / f"{name}_positions.png")]
    if keeps_state(jobs[0]):
        drawn.append(save_png(plot_path(estimates, reference), folder / f"{name}_path.png"))
        drawn.append(save_png(plot_velocities(estimates, reference), folder / f"{name}_velocities.png"))
    return drawn

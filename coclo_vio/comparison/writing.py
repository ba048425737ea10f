# SPDX-License-Identifier: BSD-3-Clause
"""What a comparison leaves in its run folder: numbers, figures, report."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from coclo_vio import run_folder
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.evaluation.figures import plot_contacts, plot_keyframes, write_figures
from coclo_vio.evaluation.report import write_report
from coclo_vio.keyframe_log import read_keyframes
from coclo_vio.run_config import RunConfig
from coclo_vio.run_folder import RecordedRun
from coclo_vio.trajectory import Trajectory


def write_comparison(folder: Path, title: str, evaluations: Mapping[str, Evaluation], config: RunConfig) -> Path:
    """``compare.json``, figures and ``report.html`` of a run folder; returns the path of the report."""
    with run_folder.writing(folder):
        write_evaluations(folder / "compare.json", evaluations)
        runs = [run_folder.read_estimates(folder, name) for name in evaluations]
        figures = _figures(folder, evaluations, runs)
        return write_report(folder / "report.html", title, evaluations, figures, config.model_dump(mode="json"))


def write_evaluations(path: Path, evaluations: Mapping[str, Evaluation]) -> None:
    """An object per estimator."""
    run_folder.write_json(path, {name: evaluation.to_json() for name, evaluation in evaluations.items()})


def _figures(folder: Path, evaluations: Mapping[str, Evaluation], runs: Sequence[RecordedRun]) -> list[Path]:
    if not evaluations:
        return []
    estimates: dict[str, Trajectory] = {name: evaluation.estimate for name, evaluation in evaluations.items()}
    reference = next(iter(evaluations.values())).reference
    figures = write_figures(estimates, reference, folder / "figures")
    first = next((run for run in runs if run.leg_names), None)
    if first is not None:
        bands = folder / "figures" / "contacts.png"
        figures.append(plot_contacts(first.trajectory.stamps_ns, first.contact_probability, first.leg_names, bands))
    keyframes = {name: read for name in evaluations if (read := read_keyframes(folder, name)) is not None}
    if keyframes:
        figures.append(plot_keyframes(keyframes, folder / "figures" / "keyframes.png"))
    return figures

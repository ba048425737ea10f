# SPDX-License-Identifier: BSD-3-Clause
"""The figures of a run, by name; their time is counted from the beginning of the recording, as that of events is."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from coclo_vio.evaluation.diagnostic_figures import plot_contacts, plot_error_bands, plot_keyframes
from coclo_vio.evaluation.evaluate import EvaluationConfig
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.evaluation.figure_style import save_png
from coclo_vio.evaluation.figures import (
    plot_overview,
    plot_path,
    plot_position_error,
    plot_positions,
    plot_velocities,
)
from coclo_vio.runs.drawn_run import DrawnRun
from coclo_vio.runs.run_record import RunRecord
from coclo_vio.values.errors import EvaluationError, listing

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _overview(run: DrawnRun) -> "Figure | None":
    if not run.evaluations:
        return None
    return plot_overview(run.estimates, run.references, start_ns=run.start_ns)


def _path(run: DrawnRun) -> "Figure | None":
    return plot_path(run.estimates, run.reference)


def _positions(run: DrawnRun) -> "Figure | None":
    return plot_positions(run.estimates, run.reference, start_ns=run.start_ns)


def _velocities(run: DrawnRun) -> "Figure | None":
    return plot_velocities(run.estimates, run.reference, start_ns=run.start_ns)


def _position_error(run: DrawnRun) -> "Figure | None":
    if not run.evaluations:
        return None
    return plot_position_error(run.estimates, run.references, events=run.events, start_ns=run.start_ns)


def _error_bands(run: DrawnRun) -> "Figure | None":
    if not run.evaluations or not run.with_covariance:
        return None
    return plot_error_bands(
        run.with_covariance,
        run.references,
        start_ns=run.start_ns,
        rotation_noise_rad=run.config.ground_truth_rotation_noise_rad,
        position_noise_m=run.config.ground_truth_position_noise_m,
    )


def _keyframes(run: DrawnRun) -> "Figure | None":
    keyframes = run.keyframes
    return plot_keyframes(keyframes, events=run.events, start_ns=run.start_ns) if keyframes else None


def _contacts(run: DrawnRun) -> "Figure | None":
    first = run.with_feet
    if first is None:
        return None
    stamps_ns = first.trajectory.stamps_ns
    return plot_contacts(stamps_ns, first.contact_probability, first.leg_names, start_ns=run.start_ns)


_FIGURES: Mapping[str, Callable[[DrawnRun], "Figure | None"]] = {
    "overview": _overview,
    "path": _path,
    "positions": _positions,
    "velocities": _velocities,
    "position_error": _position_error,
    "error_bands": _error_bands,
    "keyframes": _keyframes,
    "contacts": _contacts,
}


def check_figure(kind: str) -> None:
    """See that there is a figure of this name.

    Raises:
        EvaluationError: there is none; lists those there are.
    """
    if kind not in _FIGURES:
        raise EvaluationError(f"there is no figure {kind!r}; the figures are: {listing(_FIGURES)}")


def draw_figure(
    kind: str, folder: Path, record: RunRecord, evaluations: Mapping[str, Evaluation], config: EvaluationConfig
) -> "Figure":
    """One figure of a run.

    Args:
        kind: its name.
        folder: of the run.
        record: of the run.
        evaluations: by trajectory; empty without ground truth.
        config: how they were compared.

    Raises:
        EvaluationError: there is no such figure, the run has no data for it, or matplotlib is not installed.
    """
    check_figure(kind)
    figure = _FIGURES[kind](DrawnRun(folder, record, evaluations, config))
    if figure is None:
        raise EvaluationError(
            f"{folder} has no data for the figure {kind!r}: overview, position_error and error_bands "
            "need ground truth, keyframes a visual mode, contacts a mode with legs"
        )
    return figure


def write_figures(
    folder: Path, record: RunRecord, evaluations: Mapping[str, Evaluation], config: EvaluationConfig
) -> list[Path]:
    """Every figure that the run has data for, as PNG files in ``figures`` of the run folder; the paths written.

    Raises:
        EvaluationError: matplotlib is not installed, or there is no estimate.
    """
    (folder / "figures").mkdir(exist_ok=True)
    for kind in _FIGURES:
        (folder / "figures" / f"{kind}.png").unlink(missing_ok=True)
    run = DrawnRun(folder, record, evaluations, config)
    drawn = {kind: draw(run) for kind, draw in _FIGURES.items()}
    return [
        save_png(figure, folder / "figures" / f"{kind}.png") for kind, figure in drawn.items() if figure is not None
    ]

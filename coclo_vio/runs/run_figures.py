# SPDX-License-Identifier: BSD-3-Clause
"""The figures of a run, by name; their time is counted from the beginning of the recording, as that of events is."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
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
from coclo_vio.runs import run_folder
from coclo_vio.runs.modes.registry import modes
from coclo_vio.runs.output_logs import read_keyframes
from coclo_vio.runs.run_record import RunRecord
from coclo_vio.values.errors import EvaluationError, listing
from coclo_vio.values.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, eq=False)
class _Drawn:
    """What figures are drawn from.

    Attributes:
        folder: of the run.
        record: of the run.
        evaluations: by trajectory; empty without ground truth.
        config: how they were compared.
    """

    folder: Path
    record: RunRecord
    evaluations: Mapping[str, Evaluation]
    config: EvaluationConfig

    @property
    def start_ns(self) -> int | None:
        return None if self.record.recording_ns is None else self.record.recording_ns[0]

    @property
    def estimates(self) -> dict[str, Trajectory]:
        """In the world of the ground truth where there is one, otherwise in that of each estimator."""
        if self.evaluations:
            return {name: evaluation.estimate for name, evaluation in self.evaluations.items()}
        estimated = [name for name, run in self.record.estimators.items() if run.estimates]
        if not estimated:
            raise EvaluationError(f"{self.folder} has no estimate to draw")
        return {name: run_folder.read_estimates(self.folder, name).trajectory for name in estimated}

    @property
    def references(self) -> dict[str, Trajectory]:
        return {name: evaluation.reference for name, evaluation in self.evaluations.items()}

    @property
    def reference(self) -> Trajectory | None:
        return next(iter(self.references.values()), None)

    @property
    def events(self) -> dict[str, list[int]]:
        """Stamps of the events of all modes, by kind."""
        stamps: dict[str, list[int]] = {}
        for _, event in self.record.events():
            stamps.setdefault(f"event: {event.kind}", []).append(event.stamp_ns)
        return stamps

    @property
    def with_covariance(self) -> dict[str, Trajectory]:
        """Featured trajectories of leg odometry whose covariance is known."""
        legs = {
            mode.trajectories[0].name for mode in modes().values() if mode.has_legs and mode.trajectories[0].is_featured
        }
        return {name: one for name, one in self.estimates.items() if name in legs and one.covariance is not None}


def _overview(run: _Drawn) -> "Figure | None":
    if not run.evaluations:
        return None
    return plot_overview(run.estimates, run.references, start_ns=run.start_ns)


def _path(run: _Drawn) -> "Figure | None":
    return plot_path(run.estimates, run.reference)


def _positions(run: _Drawn) -> "Figure | None":
    return plot_positions(run.estimates, run.reference, start_ns=run.start_ns)


def _velocities(run: _Drawn) -> "Figure | None":
    return plot_velocities(run.estimates, run.reference, start_ns=run.start_ns)


def _position_error(run: _Drawn) -> "Figure | None":
    if not run.evaluations:
        return None
    return plot_position_error(run.estimates, run.references, events=run.events, start_ns=run.start_ns)


def _error_bands(run: _Drawn) -> "Figure | None":
    if not run.evaluations or not run.with_covariance:
        return None
    return plot_error_bands(
        run.with_covariance,
        run.references,
        start_ns=run.start_ns,
        rotation_noise_rad=run.config.ground_truth_rotation_noise_rad,
        position_noise_m=run.config.ground_truth_position_noise_m,
    )


def _keyframes(run: _Drawn) -> "Figure | None":
    found = ((name, read_keyframes(run.folder, name)) for name in run.record.estimators)
    keyframes = {name: columns for name, columns in found if columns is not None}
    return plot_keyframes(keyframes, events=run.events, start_ns=run.start_ns) if keyframes else None


def _contacts(run: _Drawn) -> "Figure | None":
    recorded = (run_folder.read_estimates(run.folder, name) for name in run.estimates)
    first = next((one for one in recorded if one.leg_names), None)
    if first is None:
        return None
    stamps_ns = first.trajectory.stamps_ns
    return plot_contacts(stamps_ns, first.contact_probability, first.leg_names, start_ns=run.start_ns)


_FIGURES: Mapping[str, Callable[[_Drawn], "Figure | None"]] = {
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
    figure = _FIGURES[kind](_Drawn(folder, record, evaluations, config))
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
    run = _Drawn(folder, record, evaluations, config)
    drawn = {kind: draw(run) for kind, draw in _FIGURES.items()}
    return [
        save_png(figure, folder / "figures" / f"{kind}.png") for kind, figure in drawn.items() if figure is not None
    ]

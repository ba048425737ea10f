# SPDX-License-Identifier: BSD-3-Clause
"""The paper's figures as PNG files: positions, path, velocities, position error, contact bands, keyframes.

The only importer of matplotlib (extra ``viz``), inside the functions and without a display. The trajectories of a
figure are in one world and on one clock, as ``Evaluation.estimate`` and ``Evaluation.reference`` are; None where there
is no ground truth.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from coclo_vio.arrays import Array, IntArray
from coclo_vio.errors import EvaluationError
from coclo_vio.evaluation.association import gaps_ns
from coclo_vio.evaluation.metrics import velocities
from coclo_vio.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NS_PER_S = 1_000_000_000
_DPI = 110
_AXES = ("x", "y", "z")
_REFERENCE_STYLE: dict[str, Any] = {"color": "black", "linewidth": 1.4, "label": "ground truth"}
_HOLE_S = 1.0

Estimates = Mapping[str, Trajectory]


def plot_positions(estimates: Estimates, reference: Trajectory | None, path: Path) -> Path:
    """x, y and z over time of all estimates and the ground truth (the paper's ramp and stairs figures)."""
    figure = _figure(8.0, 6.5)
    start_ns = _start_ns(estimates)
    axes = figure.subplots(3, 1, sharex=True)
    for index, axis in enumerate(axes):
        if reference is not None:
            axis.plot(
                _seconds(reference, start_ns), _broken(reference, reference.positions)[:, index], **_REFERENCE_STYLE
            )
        for name, estimate in estimates.items():
            axis.plot(_seconds(estimate, start_ns), _broken(estimate, estimate.positions)[:, index], label=name)
        axis.set_ylabel(f"{_AXES[index]} [m]")
    return _finish(figure, axes, "time [s]", path)


def plot_path(estimates: Estimates, reference: Trajectory | None, path: Path) -> Path:
    """The way in the x-y plane, both axes to one scale (the paper's flat-ground figure)."""
    figure = _figure(6.5, 6.0)
    axis = figure.subplots()
    if reference is not None:
        axis.plot(*_broken(reference, reference.positions)[:, :2].T, **_REFERENCE_STYLE)
    for name, estimate in estimates.items():
        axis.plot(*_broken(estimate, estimate.positions)[:, :2].T, label=name)
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_ylabel("y [m]")
    return _finish(figure, [axis], "x [m]", path)


def plot_velocities(
    estimates: Estimates, reference: Trajectory | None, path: Path, *, window_s: float = 0.25, max_gap_s: float = 0.25
) -> Path:
    """Velocities in the world over time; those of the ground truth, and of estimates without any, from positions."""
    figure = _figure(8.0, 6.5)
    start_ns = _start_ns(estimates)
    axes = figure.subplots(3, 1, sharex=True)
    for index, axis in enumerate(axes):
        if reference is not None:
            shown = _velocity(reference, window_s, max_gap_s)[:, index]
            axis.plot(_seconds(reference, start_ns), shown, **_REFERENCE_STYLE)
        for name, estimate in estimates.items():
            own = estimate.velocity_world
            shown = _velocity(estimate, window_s, _HOLE_S) if own is None else _broken(estimate, own)
            axis.plot(_seconds(estimate, start_ns), shown[:, index], label=name, linewidth=0.8)
        axis.set_ylabel(f"v{_AXES[index]} [m/s]")
    return _finish(figure, axes, "time [s]", path)


def plot_position_error(estimates: Estimates, reference: Trajectory, path: Path, *, max_gap_s: float = 0.25) -> Path:
    """Distance to the ground truth over time; broken where the ground truth has a hole.

    Raises:
        EvaluationError: an estimate has no pose within the ground truth.
    """
    figure = _figure(8.0, 3.5)
    start_ns = _start_ns(estimates)
    axis = figure.subplots()
    for name, estimate in estimates.items():
        inside = estimate.between(int(reference.stamps_ns[0]), int(reference.stamps_ns[-1]))
        error = np.linalg.norm(inside.positions - reference.interpolated(inside.stamps_ns).positions, axis=1)
        for start, end in gaps_ns(reference.stamps_ns, max_gap_s):
            error[(inside.stamps_ns > start) & (inside.stamps_ns < end)] = np.nan
        axis.plot(_seconds(inside, start_ns), error, label=name)
    axis.set_ylabel("position error [m]")
    axis.set_ylim(bottom=0.0)
    return _finish(figure, [axis], "time [s]", path)


def plot_contacts(
    stamps_ns: IntArray,
    probability: Array,
    legs: Sequence[str],
    path: Path,
    *,
    threshold: float = 0.5,
) -> Path:
    """One band a leg: dark while it stands, with its contact probability as a line.

    Args:
        stamps_ns: times, ns, (N,).
        probability: contact probabilities 0..1, (N, legs).
        legs: names, one a column.
        path: PNG file to write.
        threshold: a leg stands above this probability.

    Raises:
        EvaluationError: the shapes do not belong together.
    """
    if probability.shape != (len(stamps_ns), len(legs)) or len(stamps_ns) == 0:
        raise EvaluationError(
            f"contact bands need probabilities of shape ({len(stamps_ns)}, {len(legs)}), stamps by legs and not empty, "
            f"got {probability.shape}"
        )
    figure = _figure(8.0, 0.6 * len(legs) + 1.2)
    axis = figure.subplots()
    times_s = (stamps_ns - stamps_ns[0]) / _NS_PER_S
    for row, column in enumerate(probability.T):
        low = np.full(len(times_s), -row - 0.4)
        axis.fill_between(times_s, low, low + 0.8, where=column > threshold, step="post", alpha=0.35, linewidth=0)
        axis.plot(times_s, low + 0.8 * column, linewidth=0.6, color="black")
    axis.set_yticks([-float(row) for row in range(len(legs))], labels=list(legs))
    axis.margins(x=0.0)
    return _finish(figure, [axis], "time [s]", path)


def plot_keyframes(keyframes: Mapping[str, Mapping[str, Array]], path: Path) -> Path:
    """Over time and for each smoother: tracks at its keyframes, and what is left of their reprojection errors.

    Args:
        keyframes: by estimator, columns (N,) by name: ``stamp_ns``, ``tracks``, ``reprojection_px``.
        path: PNG file to write.

    Raises:
        EvaluationError: there is no keyframe.
    """
    stamps = [columns["stamp_ns"] for columns in keyframes.values() if len(columns["stamp_ns"])]
    if not stamps:
        raise EvaluationError("a figure of keyframes needs at least one, there is none; run a visual mode first")
    start_ns = min(float(each[0]) for each in stamps)
    figure = _figure(8.0, 4.0)
    axes = figure.subplots(2, 1, sharex=True)
    for name, columns in keyframes.items():
        times_s = (columns["stamp_ns"] - start_ns) / _NS_PER_S
        axes[0].plot(times_s, columns["tracks"], label=name, linewidth=0.8)
        axes[1].plot(times_s, columns["reprojection_px"], label=name, linewidth=0.8)
    axes[0].set_ylabel("tracks")
    axes[1].set_ylabel("reprojection [px]")
    for axis in axes:
        axis.set_ylim(bottom=0.0)
    return _finish(figure, axes, "time [s]", path)


def write_figures(estimates: Estimates, reference: Trajectory | None, folder: Path) -> list[Path]:
    """Every figure that needs trajectories only, in ``folder``, which is made; the paths written.

    Raises:
        EvaluationError: matplotlib is missing, or there is no estimate.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = [
        plot_path(estimates, reference, folder / "path.png"),
        plot_positions(estimates, reference, folder / "positions.png"),
        plot_velocities(estimates, reference, folder / "velocities.png"),
    ]
    if reference is not None:
        written.append(plot_position_error(estimates, reference, folder / "position_error.png"))
    return written


def _figure(width: float, height: float) -> "Figure":
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415 -- an extra, and slow
        from matplotlib.figure import Figure  # noqa: PLC0415
    except ImportError as error:
        raise EvaluationError(
            "figures need matplotlib, which is not installed; install it with `pip install 'coclo-vio[viz]'`, or go "
            "without figures"
        ) from error
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _finish(figure: "Figure", axes: Sequence[Any], x_label: str, path: Path) -> Path:
    for axis in axes:
        axis.grid(visible=True, alpha=0.3)
    if axes[0].get_legend_handles_labels()[0]:
        axes[0].legend(loc="best", fontsize="small")
    axes[-1].set_xlabel(x_label)
    figure.savefig(path, dpi=_DPI, format="png")
    return path


def _start_ns(estimates: Estimates) -> int:
    if not estimates:
        raise EvaluationError("a figure needs at least one estimate, there is none; run an estimator first")
    return min(int(estimate.stamps_ns[0]) for estimate in estimates.values())


def _seconds(trajectory: Trajectory, start_ns: int) -> Array:
    return np.asarray((trajectory.stamps_ns - start_ns) / _NS_PER_S)


def _broken(trajectory: Trajectory, values: Array) -> Array:
    """Values (N, k) with NaN before each hole, so that no line is drawn across it."""
    shown = values.copy()
    shown[:-1][np.diff(trajectory.stamps_ns) > _HOLE_S * _NS_PER_S] = np.nan
    return shown


def _velocity(trajectory: Trajectory, window_s: float, max_gap_s: float) -> Array:
    velocity, is_trusted = velocities(trajectory, window_s, max_gap_s)
    return np.where(is_trusted[:, None], velocity, np.nan)

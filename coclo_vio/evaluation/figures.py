# SPDX-License-Identifier: BSD-3-Clause
"""The paper's figures 4 to 9 as PNG files: path, positions, velocities, and the distance to ground truth.

Standalone estimators are on the left, fused ones on the right, on one scale. The trajectories of a figure are in one
world and on one clock, as ``Evaluation.estimate`` and ``Evaluation.reference`` are; the reference is None where there
is no ground truth.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from coclo_vio.evaluation.curves import (
    Estimates,
    ahead_of,
    broken,
    distance,
    middle,
    own_velocity,
    seconds,
    smooth_velocity,
    within,
    zero_ns_of,
)
from coclo_vio.evaluation.figure_style import REFERENCE, empty_figure, finish, mark_events, style_of
from coclo_vio.evaluation.trajectory_roles import featured, is_fused
from coclo_vio.values.trajectory import Trajectory
from coclo_vio.values.units import NS_PER_S

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_AXES = ("x", "y", "z")
_SCALE_OF_FEATURED = 2.5  # baselines further off than this times the worst featured estimate leave the figure
_SMALL_M = 0.1
_MM_PER_M = 1e3
_PATH_WIDTH, _PATH_HEIGHTS = 7.0, (1.8, 6.5)

Events = Mapping[str, Sequence[int]]
"""Stamps, ns, by kind."""


def plot_positions(estimates: Estimates, reference: Trajectory | None, *, start_ns: int | None = None) -> "Figure":
    """x, y and z over time of all estimates and the ground truth (the paper's ramp and stairs figures).

    Args:
        estimates: by name.
        reference: the ground truth, where there is any.
        start_ns: time zero; the first estimate where None.
    """
    zero_ns, shown = zero_ns_of(estimates, start_ns), within(estimates, reference)

    def draw(axis: Any, index: int, names: Sequence[str]) -> None:
        if shown is not None:
            axis.plot(seconds(shown, zero_ns), broken(shown, shown.positions)[:, index], **REFERENCE)
        for name in names:
            estimate = estimates[name]
            axis.plot(seconds(estimate, zero_ns), broken(estimate, estimate.positions)[:, index], **style_of(name))

    return _in_columns(list(estimates), [f"{name} [m]" for name in _AXES], draw)


def plot_velocities(
    estimates: Estimates,
    reference: Trajectory | None,
    *,
    start_ns: int | None = None,
    window_s: float = 0.25,
    max_gap_s: float = 0.25,
) -> "Figure":
    """Velocities in the world over time; those of the ground truth, and of estimates without any, from positions.

    So many curves hide each other: baselines are left out where there are featured trajectories, and of a long
    recording the middle is shown.

    Args:
        estimates: by name.
        reference: the ground truth, where there is any.
        start_ns: time zero; the first estimate where None.
        window_s: over which positions give a velocity, s.
        max_gap_s: a hole of the ground truth is longer, s.
    """
    zero_ns, leading = zero_ns_of(estimates, start_ns), set(featured(estimates))
    estimates = middle({name: estimate for name, estimate in estimates.items() if name in leading})
    names, shown = list(estimates), within(estimates, reference)
    true = None if shown is None else smooth_velocity(shown, window_s, max_gap_s)
    own = {name: own_velocity(estimates[name], window_s) for name in names}

    def draw(axis: Any, index: int, drawn: Sequence[str]) -> None:
        for name in drawn:
            style = {**style_of(name), "linewidth": 0.7 * style_of(name)["linewidth"]}
            axis.plot(seconds(estimates[name], zero_ns), own[name][:, index], **style)
        if shown is not None and true is not None:
            axis.plot(seconds(shown, zero_ns), true[:, index], **{**REFERENCE, "zorder": 7, "linewidth": 0.9})

    return _in_columns(names, [f"v{name} [m/s]" for name in _AXES], draw)


def plot_path(estimates: Estimates, reference: Trajectory | None) -> "Figure":
    """The path from above, both axes to one scale (the paper's flat-ground figure), and below it from the side.

    The height in the view from the side is not to scale.
    """
    shown = within(estimates, reference)
    longest = shown if shown is not None else next(iter(estimates.values()))
    extent = np.ptp(longest.positions, axis=0)
    height = float(np.clip(_PATH_WIDTH * extent[1] / max(extent[0], 1e-9), *_PATH_HEIGHTS))
    figure = empty_figure(_PATH_WIDTH + 1.0, height + 3.4)
    above, side = figure.subplots(2, 1, height_ratios=(height, 2.0))
    _draw_path(above, estimates, shown, (0, 1))
    above.set_xlabel("x [m]")
    above.set_ylabel("y [m]")
    above.set_aspect("equal", adjustable="datalim")
    _draw_side(side, estimates, shown)
    return finish(figure, [above, side], "along the path, from the side [m]")


def plot_position_error(
    estimates: Estimates,
    references: Estimates,
    *,
    events: Events | None = None,
    start_ns: int | None = None,
    max_gap_s: float = 0.25,
) -> "Figure":
    """Distance to the ground truth over time; broken where the ground truth has a hole.

    Args:
        estimates: by name.
        references: the ground truth on the clock of each.
        events: marked where they happened.
        start_ns: time zero; the first estimate where None.
        max_gap_s: a hole of the ground truth is longer, s.

    Raises:
        EvaluationError: an estimate has no pose within the ground truth.
    """
    figure = empty_figure(9.0, 3.8)
    axis = figure.subplots()
    zero_ns = zero_ns_of(estimates, start_ns)
    _draw_error(axis, estimates, references, max_gap_s, zero_ns)
    mark_events([axis], _event_times(events or {}, zero_ns))
    return finish(figure, [axis], "time [s]")


def plot_overview(
    estimates: Estimates,
    references: Estimates,
    *,
    start_ns: int | None = None,
    max_gap_s: float = 0.25,
) -> "Figure":
    """The path, from the side where it climbs, and the distance to the ground truth.

    Args:
        estimates: by name.
        references: the ground truth on the clock of each.
        start_ns: time zero; the first estimate where None.
        max_gap_s: a hole of the ground truth is longer, s.
    """
    figure = empty_figure(10.0, 3.9)
    route, error = figure.subplots(1, 2)
    reference = next(iter(references.values()))
    shown = within(estimates, reference)
    extent = reference.positions.max(axis=0) - reference.positions.min(axis=0)
    if extent[2] > 0.05 * float(np.hypot(extent[0], extent[1])):
        _draw_side(route, estimates, shown)
        route.set_xlabel("along the path, from the side [m]")
    else:
        _draw_path(route, estimates, shown, (0, 1))
        route.set_aspect("equal", adjustable="datalim")
        route.set_xlabel("x [m]")
        route.set_ylabel("y [m]")
    _draw_error(error, estimates, references, max_gap_s, zero_ns_of(estimates, start_ns))
    return finish(figure, [route, error], "time [s]")


def _in_columns(names: Sequence[str], rows: Sequence[str], draw: Any) -> "Figure":
    """A row for each axis of the world; a column for standalone estimators, and one for fused ones."""
    standalone = [name for name in names if not is_fused(name)]
    fused = [name for name in names if is_fused(name)]
    columns = [(title, drawn) for title, drawn in (("standalone", standalone), ("combined", fused)) if drawn]
    figure = empty_figure(8.5 if len(columns) == 1 else 12.0, 7.0)
    axes = figure.subplots(len(rows), len(columns), sharex=True, sharey="row", squeeze=False)
    for column, (title, drawn) in enumerate(columns):
        for index, label in enumerate(rows):
            draw(axes[index, column], index, drawn)
            if column == 0:
                axes[index, column].set_ylabel(label)
        if len(columns) > 1:
            axes[0, column].set_title(title, fontsize="medium")
    return finish(figure, list(axes.flat), "time [s]", labelled=axes[-1, :-1])


def _draw_path(axis: Any, estimates: Estimates, reference: Trajectory | None, plane: tuple[int, int]) -> None:
    """Positions in a plane of the world."""
    if reference is not None:
        axis.plot(*broken(reference, reference.positions)[:, plane].T, **REFERENCE)
    for name, estimate in estimates.items():
        axis.plot(*broken(estimate, estimate.positions)[:, plane].T, **style_of(name))


def _draw_side(axis: Any, estimates: Estimates, reference: Trajectory | None) -> None:
    """Height over the horizontal direction of the largest extent of the path."""
    longest = reference if reference is not None else next(iter(estimates.values()))
    start, ahead = longest.positions[0], ahead_of(longest)
    drawn = [] if reference is None else [(reference, dict(REFERENCE))]
    for trajectory, style in [*drawn, *((estimate, style_of(name)) for name, estimate in estimates.items())]:
        moved = broken(trajectory, trajectory.positions - start)
        axis.plot(moved[:, :2] @ ahead, moved[:, 2], **style)
    axis.set_ylabel("height [m]")


def _draw_error(axis: Any, estimates: Estimates, references: Estimates, max_gap_s: float, zero_ns: int) -> None:
    """Distances to the ground truth, its noise averaged out; in millimetres where they are small."""
    errors = {name: distance(estimate, references[name], max_gap_s) for name, estimate in estimates.items()}
    worst = {name: float(np.nanmax(error, initial=0.0)) for name, (_, error) in errors.items()}
    leading = max(worst[name] for name in featured(worst))
    top_m = min(max(worst.values()), _SCALE_OF_FEATURED * leading)
    scale, unit = (_MM_PER_M, "mm") if top_m < _SMALL_M else (1.0, "m")
    for name, (inside, error) in errors.items():
        axis.plot(seconds(inside, zero_ns), scale * error, **style_of(name))
    axis.set_ylabel(f"position error [{unit}]")
    axis.set_ylim(0.0, 1.05 * scale * top_m or None)
    axis.margins(x=0.01)


def _event_times(events: Events, zero_ns: int) -> dict[str, list[float]]:
    return {kind: [(stamp_ns - zero_ns) / NS_PER_S for stamp_ns in stamps] for kind, stamps in events.items()}

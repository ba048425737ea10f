# SPDX-License-Identifier: BSD-3-Clause
"""Diagnostics of an estimator as PNG files: feet in stance, health of the smoother, errors within their sigmas."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from coclo_vio.evaluation.alignment import heading_error_rad
from coclo_vio.evaluation.figure_style import STANCE_COLOUR, empty_figure, finish, mark_events, style_of
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.errors import EvaluationError
from coclo_vio.values.trajectory import Trajectory
from coclo_vio.values.units import NS_PER_S

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIGMAS = 3.0
"""Half the width of an error band."""
_ROWS = ("x [mm]", "y [mm]", "z [mm]", "yaw [deg]")
_SCALES = np.array([1e3, 1e3, 1e3, np.degrees(1.0)])  # of m and rad, to the units of _ROWS


def plot_contacts(
    stamps_ns: IntArray,
    probability: Array,
    legs: Sequence[str],
    *,
    threshold: float = 0.5,
    start_ns: int | None = None,
) -> "Figure":
    """One band a leg: dark in stance, with the contact probability as a line.

    Args:
        stamps_ns: times, ns, (N,).
        probability: contact probabilities 0..1, (N, legs).
        legs: names, one a column.
        threshold: a leg is in stance above this probability.
        start_ns: time zero; the first stamp where None.

    Raises:
        EvaluationError: the shapes do not belong together.
    """
    if probability.shape != (len(stamps_ns), len(legs)) or len(stamps_ns) == 0:
        raise EvaluationError(
            f"contact bands need probabilities of shape ({len(stamps_ns)}, {len(legs)}), stamps by legs and not empty, "
            f"got {probability.shape}"
        )
    figure = empty_figure(9.0, 0.5 * len(legs) + 1.2)
    axis = figure.subplots()
    times_s = (stamps_ns - (stamps_ns[0] if start_ns is None else start_ns)) / NS_PER_S
    for row, column in enumerate(probability.T):
        low = np.full(len(times_s), -row - 0.4)
        axis.fill_between(
            times_s,
            low,
            low + 0.8,
            where=column > threshold,
            step="post",
            color=STANCE_COLOUR,
            alpha=0.35,
            linewidth=0,
        )
        axis.plot(times_s, low + 0.8 * column, linewidth=0.6, color="black")
    axis.set_yticks([-float(row) for row in range(len(legs))], labels=list(legs))
    axis.margins(x=0.0)
    return finish(figure, [axis], "time [s]")


def plot_keyframes(
    keyframes: Mapping[str, Mapping[str, Array]],
    *,
    events: Mapping[str, Sequence[int]] | None = None,
    start_ns: int | None = None,
) -> "Figure":
    """Over time and for each smoother: tracks at its keyframes, the residual reprojection error, events.

    Args:
        keyframes: by trajectory, columns (N,) by name: ``stamp_ns``, ``tracks``, ``reprojection_px``.
        events: stamps, ns, by kind, of the events of the estimators.
        start_ns: time zero; the first keyframe where None.

    Raises:
        EvaluationError: there is no keyframe.
    """
    stamps = [columns["stamp_ns"] for columns in keyframes.values() if len(columns["stamp_ns"])]
    if not stamps:
        raise EvaluationError("a figure of keyframes needs at least one, there is none; run a visual mode first")
    zero_ns = min(float(each[0]) for each in stamps) if start_ns is None else float(start_ns)
    figure = empty_figure(9.0, 4.2)
    axes = figure.subplots(2, 1, sharex=True)
    for name, columns in keyframes.items():
        times_s = (columns["stamp_ns"] - zero_ns) / NS_PER_S
        style = {**style_of(name), "linewidth": 1.0, "marker": ".", "markersize": 3.0}
        axes[0].plot(times_s, columns["tracks"], **style)
        axes[1].plot(times_s, columns["reprojection_px"], **style)
    axes[0].set_ylabel("tracks")
    axes[1].set_ylabel("reprojection [px]")
    mark_events(
        axes,
        {kind: [(stamp_ns - zero_ns) / NS_PER_S for stamp_ns in of_kind] for kind, of_kind in (events or {}).items()},
    )
    for axis in axes:
        axis.set_ylim(0.0, 1.1 * axis.get_ylim()[1])
    return finish(figure, axes, "time [s]")


def error_and_sigma(
    estimate: Trajectory, reference: Trajectory, rotation_noise_rad: float = 0.0, position_noise_m: float = 0.0
) -> tuple[Array, Array]:
    """Errors in the world's axes and their standard deviations: both (N, 4), [x, y, z m, yaw rad].

    The covariance is of right/local errors ``T = T_mean exp([rotation, position])``; turned into the world it is
    ``R P R^T``, of position and, about the vertical, of yaw. The noise of the ground truth is added.

    Args:
        estimate: with covariance, in the reference's world, inside its time.
        reference: the ground truth.
        rotation_noise_rad: of the ground truth, one sigma an axis, rad.
        position_noise_m: the same of its positions, m.

    Raises:
        EvaluationError: the estimate has no covariance.
    """
    if estimate.covariance is None:
        raise EvaluationError(
            "error bands need the covariance of the estimate; the state file of the run is missing: run again"
        )
    true = reference.interpolated(estimate.stamps_ns)
    R = estimate.rotations
    rotation, position = (
        np.einsum("nij,njk,nik->ni", R, estimate.covariance[:, part, part], R) for part in (slice(0, 3), slice(3, 6))
    )
    variance = np.column_stack((position + position_noise_m**2, rotation[:, 2] + rotation_noise_rad**2))
    error = np.column_stack((estimate.positions - true.positions, -heading_error_rad(estimate, true)))
    return error, np.sqrt(variance)


def plot_error_bands(
    estimates: Mapping[str, Trajectory],
    references: Mapping[str, Trajectory],
    *,
    start_ns: int | None = None,
    rotation_noise_rad: float = 0.0,
    position_noise_m: float = 0.0,
) -> "Figure":
    """Error along each axis of the world and of yaw, within three sigmas of the estimator's own covariance.

    A column for each estimate; a consistent one is outside its band for 0.3 % of the time.

    Args:
        estimates: with covariance, in the ground truth's world.
        references: the ground truth on the clock of each.
        start_ns: time zero; the first estimate where None.
        rotation_noise_rad: of the ground truth, one sigma an axis, rad.
        position_noise_m: the same of its positions, m.

    Raises:
        EvaluationError: no estimate, or one without covariance or outside the ground truth.
    """
    if not estimates:
        raise EvaluationError("a figure needs at least one estimate, there is none; run an estimator first")
    figure = empty_figure(4.5 + 3.75 * len(estimates), 8.0)
    axes = figure.subplots(len(_ROWS), len(estimates), sharex=True, squeeze=False)
    zero_ns = min(int(estimate.stamps_ns[0]) for estimate in estimates.values()) if start_ns is None else start_ns
    for column, (name, estimate) in enumerate(estimates.items()):
        reference = references[name]
        inside = estimate.between(int(reference.stamps_ns[0]), int(reference.stamps_ns[-1]))
        error, sigma = error_and_sigma(inside, reference, rotation_noise_rad, position_noise_m)
        times_s, style = (inside.stamps_ns - zero_ns) / NS_PER_S, {**style_of(name), "linewidth": 1.0}
        for row, label in enumerate(_ROWS):
            axis, band = axes[row, column], SIGMAS * _SCALES[row] * sigma[:, row]
            axis.fill_between(times_s, -band, band, color=style["color"], alpha=0.2, linewidth=0)
            axis.plot(times_s, _SCALES[row] * error[:, row], **style)
            axis.axhline(0.0, color="black", linewidth=0.6)
            if column == 0:
                axis.set_ylabel(label)
        axes[0, column].set_title(f"{name}: error and three sigmas", fontsize="medium")
    return finish(figure, list(axes.flat), "time [s]", labelled=axes[-1, :-1])

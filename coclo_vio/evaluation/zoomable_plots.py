# SPDX-License-Identifier: BSD-3-Clause
"""The figures of a report as zoomable plots: the same curves as the PNG files, whole and with all trajectories."""

from collections.abc import Mapping, Sequence

import numpy as np

from coclo_vio.evaluation.curves import (
    Estimates,
    ahead_of,
    broken,
    distance,
    own_velocity,
    seconds,
    smooth_velocity,
    within,
    zero_ns_of,
)
from coclo_vio.evaluation.diagnostic_figures import SIGMAS, error_and_sigma
from coclo_vio.evaluation.trajectory_roles import featured, in_order
from coclo_vio.evaluation.zoomable_plot import GROUND_TRUTH, ContactBands, Curve, ZoomablePlot
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.trajectory import Trajectory
from coclo_vio.values.units import NS_PER_S

_AXES = ("x", "y", "z")
_TIME = ("time [s]",)
_WINDOW_S, _MAX_GAP_S = 0.25, 0.25
_SMALL_M, _MM_PER_M = 0.1, 1e3
_LEG_PX = 26

Events = Mapping[str, Sequence[int]]
"""Stamps, ns, by kind."""


def path_plot(estimates: Estimates, reference: Trajectory | None) -> ZoomablePlot:
    """The path from above, to scale, and its height along its longest direction."""
    shown = within(estimates, reference)
    longest = shown if shown is not None else next(iter(estimates.values()))
    start, ahead = longest.positions[0], ahead_of(longest)
    curves = []
    for group, trajectory in _with_truth(estimates, shown):
        positions = broken(trajectory, trajectory.positions)
        curves.append(Curve(group, 0, positions[:, 0], positions[:, 1]))
        moved = positions - start
        curves.append(Curve(group, 1, moved[:, :2] @ ahead, moved[:, 2]))
    return ZoomablePlot(
        "path",
        "The path from above, to scale, and from the side, its height not to scale.",
        ("y [m]", "height [m]"),
        ("x [m]", "along the path [m]"),
        (300, 130),
        curves,
        is_to_scale=True,
    )


def position_error_plot(
    estimates: Estimates, references: Estimates, *, events: Events, start_ns: int | None
) -> ZoomablePlot:
    """Distance to ground truth over time; in millimetres where featured trajectories are that near.

    Args:
        estimates: by name.
        references: the ground truth on the clock of each.
        events: marked where they happened.
        start_ns: time zero; the first estimate where None.

    Raises:
        EvaluationError: an estimate has no pose within the ground truth.
    """
    zero_ns = zero_ns_of(estimates, start_ns)
    errors = {name: distance(one, references[name], _MAX_GAP_S) for name, one in estimates.items()}
    leading = max(float(np.nanmax(errors[name][1], initial=0.0)) for name in featured(errors))
    scale, unit = (_MM_PER_M, "mm") if leading < _SMALL_M else (1.0, "m")
    return ZoomablePlot(
        "position_error",
        "Distance to ground truth over time, averaged over 0.3 s; estimates are tied to ground truth at the start "
        "only. Vertical lines mark events.",
        (f"position error [{unit}]",),
        _TIME,
        (230,),
        [Curve(name, 0, seconds(errors[name][0], zero_ns), scale * errors[name][1]) for name in in_order(errors)],
        from_zero=True,
        events=_event_times(events, zero_ns),
    )


def positions_plot(estimates: Estimates, reference: Trajectory | None, *, start_ns: int | None) -> ZoomablePlot:
    """x, y and z over time."""
    zero_ns = zero_ns_of(estimates, start_ns)
    drawn = _with_truth(estimates, within(estimates, reference))
    return ZoomablePlot(
        "positions",
        "Position over time, in the world of the ground truth where there is one.",
        [f"{axis} [m]" for axis in _AXES],
        _TIME,
        (120, 120, 120),
        [
            Curve(group, row, seconds(one, zero_ns), broken(one, one.positions)[:, row])
            for row in range(3)
            for group, one in drawn
        ],
    )


def velocities_plot(estimates: Estimates, reference: Trajectory | None, *, start_ns: int | None) -> ZoomablePlot:
    """Velocity in the world over time; that of the ground truth from its positions, over 0.25 s."""
    zero_ns, shown = zero_ns_of(estimates, start_ns), within(estimates, reference)
    drawn: list[tuple[str, Trajectory, Array]] = []
    if shown is not None:
        drawn.append((GROUND_TRUTH, shown, smooth_velocity(shown, _WINDOW_S, _MAX_GAP_S)))
    drawn += [(name, estimates[name], own_velocity(estimates[name], _WINDOW_S)) for name in in_order(estimates)]
    return ZoomablePlot(
        "velocities",
        "Velocity in the world. That of ground truth is the slope of its positions over 0.25 s, which flattens short "
        "peaks.",
        [f"v{axis} [m/s]" for axis in _AXES],
        _TIME,
        (120, 120, 120),
        [
            Curve(group, row, seconds(one, zero_ns), velocity[:, row])
            for row in range(3)
            for group, one, velocity in drawn
        ],
    )


def error_bands_plot(
    estimates: Estimates,
    references: Estimates,
    *,
    start_ns: int | None,
    rotation_noise_rad: float,
    position_noise_m: float,
) -> ZoomablePlot:
    """Error along each axis and of yaw, within three sigmas.

    Args:
        estimates: with covariance, in the ground truth's world.
        references: the ground truth on the clock of each.
        start_ns: time zero; the first estimate where None.
        rotation_noise_rad: of the ground truth, one sigma an axis, rad.
        position_noise_m: the same of its positions, m.

    Raises:
        EvaluationError: an estimate without covariance or outside the ground truth.
    """
    zero_ns = zero_ns_of(estimates, start_ns)
    curves: list[Curve] = []
    for name in in_order(estimates):
        reference = references[name]
        inside = estimates[name].between(int(reference.stamps_ns[0]), int(reference.stamps_ns[-1]))
        error, sigma = error_and_sigma(inside, reference, rotation_noise_rad, position_noise_m)
        times_s, scales = seconds(inside, zero_ns), np.array([_MM_PER_M] * 3 + [np.degrees(1.0)])
        curves += [
            Curve(name, row, times_s, scales[row] * error[:, row], SIGMAS * scales[row] * sigma[:, row])
            for row in range(4)
        ]
    return ZoomablePlot(
        "error_bands",
        "Error along each axis in the band of three sigmas of the filter's own covariance, ground truth's noise "
        "included. A consistent filter is outside it for 0.3 % of the time; a much wider band is conservative.",
        ("x [mm]", "y [mm]", "z [mm]", "yaw [deg]"),
        _TIME,
        (110, 110, 110, 110),
        curves,
    )


def keyframes_plot(
    keyframes: Mapping[str, Mapping[str, Array]], *, events: Events, start_ns: int | None
) -> ZoomablePlot:
    """Tracks and the residual reprojection error at each keyframe.

    Args:
        keyframes: by trajectory, columns (N,) by name: ``stamp_ns``, ``tracks``, ``reprojection_px``.
        events: stamps, ns, by kind.
        start_ns: time zero; the first keyframe where None.
    """
    zero_ns = round(min(columns["stamp_ns"][0] for columns in keyframes.values())) if start_ns is None else start_ns
    return ZoomablePlot(
        "keyframes",
        "Tracked points and the residual reprojection error at each keyframe; vertical lines mark events.",
        ("tracks", "reprojection [px]"),
        _TIME,
        (120, 120),
        [
            Curve(name, row, (columns["stamp_ns"] - zero_ns) / NS_PER_S, columns[what])
            for row, what in enumerate(("tracks", "reprojection_px"))
            for name, columns in keyframes.items()
        ],
        from_zero=True,
        events=_event_times(events, zero_ns),
    )


def contacts_plot(
    stamps_ns: IntArray, probability: Array, legs: Sequence[str], *, start_ns: int | None
) -> ZoomablePlot:
    """Contact probability of each leg over time.

    Args:
        stamps_ns: times, ns, (N,).
        probability: 0..1, (N, legs).
        legs: names.
        start_ns: time zero; the first stamp where None.
    """
    zero_ns = int(stamps_ns[0]) if start_ns is None else start_ns
    return ZoomablePlot(
        "contacts",
        "Contact probability of the feet: white 0, dark 1.",
        ("",),
        _TIME,
        (_LEG_PX * len(legs),),
        bands=ContactBands(np.asarray((stamps_ns - zero_ns) / NS_PER_S), probability, legs),
    )


def _with_truth(estimates: Estimates, shown: Trajectory | None) -> list[tuple[str, Trajectory]]:
    truth = [] if shown is None else [(GROUND_TRUTH, shown)]
    return [*truth, *((name, estimates[name]) for name in in_order(estimates))]


def _event_times(events: Events, zero_ns: int) -> dict[str, list[float]]:
    return {kind: [(stamp_ns - zero_ns) / NS_PER_S for stamp_ns in stamps] for kind, stamps in events.items()}

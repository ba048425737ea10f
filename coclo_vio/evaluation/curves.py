# SPDX-License-Identifier: BSD-3-Clause
"""The numbers that figures and zoomable plots draw: curves over time, broken at holes, and views of a path."""

from collections.abc import Mapping

import numpy as np
from scipy.ndimage import uniform_filter1d

from coclo_vio.evaluation.association import gaps_ns
from coclo_vio.evaluation.metrics import velocities
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import EvaluationError
from coclo_vio.values.trajectory import Trajectory
from coclo_vio.values.units import NS_PER_S

_HOLE_S = 1.0
_AVERAGING_S = 0.3
_LONGEST_S = 20.0

Estimates = Mapping[str, Trajectory]
"""By name."""


def ahead_of(trajectory: Trajectory) -> Array:
    """The horizontal direction of the largest extent of a path, towards its end: unit vector, world frame, (2,)."""
    flat = trajectory.positions[:, :2]
    ahead = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)[2][0]
    return np.asarray(ahead * (1.0 if ahead @ (flat[-1] - flat[0]) >= 0.0 else -1.0))


def distance(estimate: Trajectory, reference: Trajectory, max_gap_s: float) -> tuple[Trajectory, Array]:
    """The part of an estimate within the ground truth, and how far it is off, m; NaN in holes of the ground truth.

    Positions are averaged over ``_AVERAGING_S``, so that the noise of the ground truth does not count as an error.
    """
    inside = estimate.between(int(reference.stamps_ns[0]), int(reference.stamps_ns[-1]))
    apart = inside.positions - reference.interpolated(inside.stamps_ns).positions
    spacing_s = inside.duration_s / max(1, len(inside) - 1)
    width = min(len(inside), max(1, round(_AVERAGING_S / spacing_s))) if spacing_s > 0.0 else 1
    error = np.linalg.norm(uniform_filter1d(apart, width, axis=0, mode="nearest"), axis=1)
    for start, end in gaps_ns(reference.stamps_ns, max_gap_s):
        error[(inside.stamps_ns > start) & (inside.stamps_ns < end)] = np.nan
    return inside, error


def zero_ns_of(estimates: Estimates, start_ns: int | None) -> int:
    """Time zero of a figure, ns: the one given, else the first estimate."""
    return start_ns_of(estimates) if start_ns is None else start_ns


def start_ns_of(estimates: Estimates) -> int:
    """Stamp of the first estimate, ns.

    Raises:
        EvaluationError: there is no estimate.
    """
    if not estimates:
        raise EvaluationError("a figure needs at least one estimate, there is none; run an estimator first")
    return min(int(estimate.stamps_ns[0]) for estimate in estimates.values())


def within(estimates: Estimates, reference: Trajectory | None) -> Trajectory | None:
    """The ground truth while there are estimates."""
    start_ns = start_ns_of(estimates)
    if reference is None:
        return None
    return reference.between(start_ns, max(int(estimate.stamps_ns[-1]) for estimate in estimates.values()))


def middle(estimates: Estimates) -> Estimates:
    """The parts within ``_LONGEST_S`` about the middle of the time covered; the whole where there is none in it."""
    start_ns, end_ns = start_ns_of(estimates), max(int(estimate.stamps_ns[-1]) for estimate in estimates.values())
    margin_ns = (end_ns - start_ns - round(_LONGEST_S * NS_PER_S)) // 2
    if margin_ns <= 0:
        return estimates
    first_ns, last_ns = start_ns + margin_ns, end_ns - margin_ns
    inside = {
        name: estimate.between(first_ns, last_ns)
        for name, estimate in estimates.items()
        if ((estimate.stamps_ns >= first_ns) & (estimate.stamps_ns <= last_ns)).any()
    }
    return inside or estimates


def seconds(trajectory: Trajectory, zero_ns: int) -> Array:
    """Seconds since time zero, (N,)."""
    return np.asarray((trajectory.stamps_ns - zero_ns) / NS_PER_S)


def broken(trajectory: Trajectory, values: Array) -> Array:
    """Values (N, k) with NaN before each hole, so that no line is drawn across it."""
    shown = values.copy()
    shown[:-1][np.diff(trajectory.stamps_ns) > _HOLE_S * NS_PER_S] = np.nan
    return shown


def own_velocity(estimate: Trajectory, window_s: float) -> Array:
    """Velocity in the world, m/s, (N, 3): the estimate's own, else the slope of its positions over this window."""
    own = estimate.velocity_world
    return smooth_velocity(estimate, window_s, _HOLE_S) if own is None else broken(estimate, own)


def smooth_velocity(trajectory: Trajectory, window_s: float, max_gap_s: float) -> Array:
    """Slope of the positions over a window, m/s, world frame, (N, 3); NaN in holes and at their edges."""
    velocity, is_trusted = velocities(trajectory, window_s, max_gap_s)
    return np.where(is_trusted[:, None], velocity, np.nan)

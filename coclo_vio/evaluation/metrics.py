# SPDX-License-Identifier: BSD-3-Clause
"""The numbers of an evaluation, each a pure function; None where a number is not defined, never a silent zero.

Pairs of trajectories stand on the same stamps and, but for RPE, in the same world.
"""

from typing import Literal

import numpy as np
from scipy.signal import savgol_filter

from coclo_vio.evaluation.alignment import heading_error_rad
from coclo_vio.evaluation.association import gaps_ns
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array, BoolArray, IntArray
from coclo_vio.values.trajectory import Trajectory
from coclo_vio.values.units import NS_PER_S

_RPE_TOLERANCE = 0.1
_SHORTEST_PATH_M = 1e-6
_LOW_PASS_SAMPLES = 11
_POLYNOMIAL_ORDER = 2
_FEWEST_SAMPLES = 5

DriftInstant = Literal["end", "first_metre"]


def ate_m(estimate: Trajectory, reference: Trajectory) -> float:
    """RMS distance between positions, m (absolute trajectory error; evo's APE ``trans_part`` RMSE)."""
    return _rms(estimate.positions - reference.positions)


def ate_planar_m(estimate: Trajectory, reference: Trajectory) -> float:
    """RMS distance in x and y, m."""
    return _rms((estimate.positions - reference.positions)[:, :2])


def travelled_m(trajectory: Trajectory, spacing_s: float) -> Array:
    """Distance travelled since the first pose, m, (N,), without what noise would add.

    Positions are averaged over ``spacing_s`` and taken that far apart before distances are summed. The averaging
    window is symmetric and closes towards either end, so uniform motion keeps its exact length. Distance is linear
    between the samples taken.
    """
    times_s = trajectory.times_s
    steps = int(np.floor(times_s[-1] / spacing_s + 1e-9))
    at_s = np.append(np.arange(steps) * spacing_s, times_s[-1]) if steps else times_s[[0, -1]]
    half_s = np.minimum(0.5 * spacing_s, np.minimum(at_s, times_s[-1] - at_s))
    around_s = at_s[:, None] + half_s[:, None] * np.linspace(-1.0, 1.0, _LOW_PASS_SAMPLES)
    smooth = np.stack([np.interp(around_s, times_s, column).mean(axis=1) for column in trajectory.positions.T], axis=1)
    distance = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(smooth, axis=0), axis=1)))
    return np.asarray(np.interp(times_s, at_s, distance))


def segments(travelled: Array, length_m: float) -> IntArray:
    """Index pairs (K, 2) of all segments of this length: from each pose to the pose nearest to it further on.

    Segments that miss the length by more than a tenth are left out, as evo does with ``--all_pairs``.
    """
    first = np.arange(len(travelled) - 1)
    target_m = travelled[first] + length_m
    right = np.clip(np.searchsorted(travelled, target_m), first + 1, len(travelled) - 1)
    left = np.maximum(right - 1, first + 1)
    second = np.where(np.abs(travelled[left] - target_m) <= np.abs(travelled[right] - target_m), left, right)
    keep = np.abs(travelled[second] - target_m) <= _RPE_TOLERANCE * length_m
    return np.stack((first[keep], second[keep]), axis=1)


def relative_errors_m(estimate: Trajectory, reference: Trajectory, pairs: IntArray) -> Array:
    """Translation errors, m, (K,), of the motion from pose i to pose j of each pair (evo's RPE ``trans_part``).

    ``|trans((R_i^-1 R_j)^-1 (E_i^-1 E_j))|`` with reference poses R and estimated poses E: no alignment of the worlds
    enters, but the body frames have to be the same.
    """
    start, end = pairs[:, 0], pairs[:, 1]
    true = se3.inverse(reference.T_world_body[start]) @ reference.T_world_body[end]
    estimated = se3.inverse(estimate.T_world_body[start]) @ estimate.T_world_body[end]
    return np.asarray(np.linalg.norm((se3.inverse(true) @ estimated)[:, :3, 3], axis=1))


def rpe_percent(estimate: Trajectory, reference: Trajectory, travelled: Array, length_m: float) -> float | None:
    """Median of the relative translation errors over all segments of ``length_m`` of ground-truth travel, percent.

    None where the ground truth travels less than one segment.
    """
    pairs = segments(travelled, length_m)
    if len(pairs) == 0:
        return None
    return float(100.0 * np.median(relative_errors_m(estimate, reference, pairs)) / length_m)


def segment_drift_percent(
    estimate: Trajectory, reference: Trajectory, length_m: float, travelled: Array | None = None
) -> float | None:
    """Mean of the relative translation errors over all segments of ``length_m`` of ground-truth travel, percent.

    The measure of road data: the KITTI odometry benchmark's translational error (Geiger et al. 2012) of one length of
    segment. A segment starts at every pose and ends at the one nearest to its length; errors are over its own length.

    Args:
        estimate: poses (N,).
        reference: the ground truth on the same stamps.
        length_m: of a segment, m.
        travelled: distance travelled by the ground truth, m, (N,); the sum of its steps where None, as in KITTI.

    Returns:
        None where the ground truth travels less than one segment.
    """
    if travelled is None:
        steps_m = np.linalg.norm(np.diff(reference.positions, axis=0), axis=1)
        travelled = np.append(0.0, np.cumsum(steps_m))
    pairs = segments(travelled, length_m)
    if len(pairs) == 0:
        return None
    lengths_m = travelled[pairs[:, 1]] - travelled[pairs[:, 0]]
    return float(100.0 * np.mean(relative_errors_m(estimate, reference, pairs) / lengths_m))


def drift_percent(estimate: Trajectory, reference: Trajectory, path_m: float) -> float | None:
    """``100 |p_est(T) - p_gt(T)| / path``, tied at the start only. None where there is no path."""
    if path_m < _SHORTEST_PATH_M:
        return None
    return float(100.0 * np.linalg.norm(estimate.positions[-1] - reference.positions[-1]) / path_m)


def paper_drift_percent(estimate: Trajectory, reference: Trajectory, index: int | None) -> float | None:
    """``100 |p_est(t) - p_gt(t)| / |p_gt(t) - p_gt(0)|`` at one pose, tied at the start only (paper, Table I).

    None without a pose to take it at, or where the ground truth is at its start there.
    """
    if index is None:
        return None
    net_m = float(np.linalg.norm(reference.positions[index] - reference.positions[0]))
    if net_m < _SHORTEST_PATH_M:
        return None
    return float(100.0 * np.linalg.norm(estimate.positions[index] - reference.positions[index]) / net_m)


def paper_drift_instant(reference: Trajectory, travelled: Array, closed_loop_fraction: float) -> DriftInstant:
    """When the paper's drift is taken: at the end, but of a closed loop after the first metre.

    A loop is closed where the net displacement stays below this fraction of the path: the denominator would be the
    small distance between start and end, and the quotient meaningless.
    """
    net_m = float(np.linalg.norm(reference.positions[-1] - reference.positions[0]))
    return "first_metre" if net_m < closed_loop_fraction * travelled[-1] else "end"


def index_at(instant: DriftInstant, travelled: Array) -> int | None:
    """The pose at which a drift is taken; None where no metre is travelled."""
    if instant == "end":
        return len(travelled) - 1
    return int(np.searchsorted(travelled, 1.0)) if travelled[-1] >= 1.0 else None


def yaw_drift_deg(estimate: Trajectory, reference: Trajectory, start_window_s: float) -> float:
    """Heading error at the end less its mean over the first seconds, degrees in -180..180; left turn positive."""
    errors = -heading_error_rad(estimate, reference)
    head = errors[estimate.times_s <= start_window_s]
    drift = errors[-1] - np.arctan2(np.sin(head).mean(), np.cos(head).mean())
    return float(np.degrees(np.arctan2(np.sin(drift), np.cos(drift))))


def velocities(trajectory: Trajectory, window_s: float, max_gap_s: float) -> tuple[Array, BoolArray]:
    """Velocity of the body, m/s, world frame, (N, 3), from positions, and where it can be trusted, (N,).

    A local parabola over ``window_s`` (Savitzky, Golay, 1964) on positions resampled at their median spacing; at least
    five samples, so the window grows for slow trajectories. Motion faster than the window is lost and tracker noise s
    leaves about ``3.5 s / (window sqrt(n))`` with n samples in it. Half a window at the ends and around holes longer
    than ``max_gap_s`` is not trusted.
    """
    count = len(trajectory)
    if count < _FEWEST_SAMPLES:
        return np.zeros((count, 3)), np.zeros(count, dtype=np.bool_)
    times_s = trajectory.times_s
    spacing_s = float(np.median(np.diff(times_s)))
    grid_s = np.arange(0.0, times_s[-1] + 1e-9, spacing_s)
    samples = max(_FEWEST_SAMPLES, 2 * round(0.5 * window_s / spacing_s) + 1)
    if len(grid_s) < samples:
        return np.zeros((count, 3)), np.zeros(count, dtype=np.bool_)
    even = np.stack([np.interp(grid_s, times_s, column) for column in trajectory.positions.T], axis=1)
    slope = savgol_filter(even, samples, _POLYNOMIAL_ORDER, deriv=1, delta=spacing_s, axis=0)
    velocity = np.stack([np.interp(times_s, grid_s, column) for column in slope.T], axis=1)
    half_s = 0.5 * (samples - 1) * spacing_s
    is_trusted: BoolArray = (times_s >= half_s) & (times_s <= grid_s[-1] - half_s)
    for start_s, end_s in (gaps_ns(trajectory.stamps_ns, max_gap_s) - trajectory.stamps_ns[0]) / NS_PER_S:
        is_trusted &= (times_s <= start_s - half_s) | (times_s >= end_s + half_s)
    return velocity, is_trusted


def velocity_rmse_mps(estimate: Array, reference: Array, is_trusted: BoolArray) -> float | None:
    """RMS length of the difference of velocities (N, 3) of one world, m/s; None where none can be trusted."""
    return _rms((estimate - reference)[is_trusted]) if is_trusted.any() else None


def path_length_ratio(estimate_m: float, reference_m: float) -> float | None:
    """Path of the estimate over path of the ground truth; None where the ground truth stands still."""
    return estimate_m / reference_m if reference_m > _SHORTEST_PATH_M else None


def start_tilt_deg(estimate: Trajectory, reference: Trajectory, start_window_s: float) -> float:
    """Mean angle over the first seconds between the world's vertical as seen from either body, degrees.

    Not zero where the tracked body is mounted tilted to the estimate's, or gravity is misjudged: then RPE has a floor
    of about the sine of this angle.
    """
    head = estimate.times_s <= start_window_s
    up_e, up_r = estimate.rotations[head, 2, :].mean(axis=0), reference.rotations[head, 2, :].mean(axis=0)
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(up_e, up_r)), up_e @ up_r)))


def _rms(vectors: Array) -> float:
    return float(np.sqrt((vectors**2).sum(axis=1).mean()))

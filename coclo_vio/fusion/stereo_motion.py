# SPDX-License-Identifier: BSD-3-Clause
"""Motion of a stereo camera between two frames by their common tracks alone: no prior, no other sensor.

Points are triangulated in the earlier frame, and the pose is sought from which the later frame shows them where it
does: Gauss-Newton on left column, row and disparity, with Huber weights. Source: Nister, Naroditsky, Bergen, "Visual
odometry", 2004.
"""

from dataclasses import dataclass

import numpy as np

from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.measurements import StereoTracks

_FEWEST = 15
_LEAST_DISPARITY_PX = 0.5
_NEAREST_M = 0.1
_MOST_ITERATIONS = 12
_CONVERGED = 1e-7
_HUBER = 1.5  # in robust sigmas of the residuals
_LEAST_PX = 0.1  # of that sigma
_MOST_PX = 3.0  # of that sigma: more is no common motion
_TO_SIGMA = 1.4826  # from the median of absolute values


@dataclass(frozen=True, slots=True, eq=False)
class StereoMotion:
    """Motion between two frames.

    Attributes:
        T_start_end: maps coordinates of the left camera at the later frame to those at the earlier one, (4, 4).
        covariance: of its right/local error, by the size of the residuals, (6, 6).
    """

    T_start_end: Array
    covariance: Array


def stereo_motion(rig: RectifiedStereo, start: StereoTracks, end: StereoTracks) -> StereoMotion | None:
    """The motion between two frames; None where fewer than 15 of their common tracks agree on one.

    Args:
        rig: the cameras.
        start: tracks of the earlier frame.
        end: tracks of the later one.
    """
    _, at_start, at_end = np.intersect1d(start.track_ids, end.track_ids, assume_unique=True, return_indices=True)
    disparity = start.left_px[at_start, 0] - start.right_px[at_start, 0]
    is_near = disparity > _LEAST_DISPARITY_PX  # not where there is none
    at_start, at_end = at_start[is_near], at_end[is_near]
    if len(at_start) < _FEWEST:
        return None
    points = rig.points(start.left_px[at_start], disparity[is_near])
    left, right = end.left_px[at_end], end.right_px[at_end]
    observed = np.column_stack((left, left[:, 0] - right[:, 0]))
    T_end_start = np.eye(4)
    for _ in range(_MOST_ITERATIONS):
        rows, residuals, is_known = _linearised(rig, T_end_start, points, observed)
        sizes = np.linalg.norm(residuals, axis=1)
        sigma = max(_TO_SIGMA * float(np.median(sizes)) / np.sqrt(2.0), _LEAST_PX)
        weights = np.minimum(1.0, _HUBER * sigma / np.maximum(sizes, 1e-9))
        stacked = rows.reshape(-1, 6)
        weighted = stacked * np.repeat(weights, 3)[:, None]
        information = weighted.T @ stacked
        try:
            inverse = np.linalg.inv(information)
        except np.linalg.LinAlgError:
            return None
        step = inverse @ (weighted.T @ residuals.ravel())
        T_end_start = se3.exp(step) @ T_end_start
        if np.abs(step).max() < _CONVERGED:
            break
    agree = int(np.count_nonzero(is_known & (sizes < 3.0 * sigma)))
    if sigma > _MOST_PX or agree < max(_FEWEST, len(points) // 2) or not np.isfinite(T_end_start).all():
        return None
    # an error exp(e) on the left of T_end_start is exp(-e) on the right of its inverse
    return StereoMotion(np.asarray(se3.inverse(T_end_start)), np.asarray(inverse * sigma**2))


def _linearised(rig: RectifiedStereo, T: Array, points: Array, observed: Array) -> tuple[Array, Array, BoolArray]:
    """Jacobian (N, 3, 6) by a left error of the pose, residuals (N, 3), and which points are in front, (N,)."""
    moved = se3.apply(T, points)
    is_ahead = moved[:, 2] > _NEAREST_M
    moved = np.where(is_ahead[:, None], moved, [0.0, 0.0, 1.0])
    (fx, fy), (x, y, z) = rig.focal_px, moved.T
    left, disparity = rig.pixels(moved)
    residuals = observed - np.column_stack((left, disparity))
    has_disparity = np.isfinite(residuals[:, 2])
    residuals[:, 2] = np.where(has_disparity, residuals[:, 2], 0.0)
    across, down, nearer = x / z, y / z, np.where(has_disparity, -fx * rig.baseline_m / z**2, 0.0)
    rows = np.zeros((len(points), 3, 6))  # d(column, row, disparity) / d(point) times [-hat(point), identity]
    rows[:, 0, 0], rows[:, 0, 1], rows[:, 0, 2] = -fx * across * down, fx * (1.0 + across**2), -fx * down
    rows[:, 0, 3], rows[:, 0, 5] = fx / z, -fx * across / z
    rows[:, 1, 0], rows[:, 1, 1], rows[:, 1, 2] = -fy * (1.0 + down**2), fy * across * down, fy * across
    rows[:, 1, 4], rows[:, 1, 5] = fy / z, -fy * down / z
    rows[:, 2, 0], rows[:, 2, 1], rows[:, 2, 5] = nearer * y, -nearer * x, nearer
    rows[~is_ahead] = residuals[~is_ahead] = 0.0
    return rows, residuals, is_ahead

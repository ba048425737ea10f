# SPDX-License-Identifier: BSD-3-Clause
"""Compiled kernels of the pose of one frame by landmarks, and of their uncertainty.

``StereoModel`` has the readable forms.

Arguments that they share: ``points`` (N, 3), m, world frame; ``observed`` (N, 3) left column, row, right column or NaN,
px; ``whiten`` (N, 3, 3), lower triangles that make residuals white; ``T_body_world`` and ``T_camera_body`` (4, 4);
``optics`` = fx, fy, cx, cy (px), baseline (m), (5,).
"""

import numpy as np

from coclo_vio.backend.window.reprojection_kernels import transformed
from coclo_vio.geometry.compiled import compiled
from coclo_vio.values.arrays import Array, BoolArray, IntArray

NEAREST_M = 1e-3  # depth of a point that counts as ahead of the camera
FARTHEST_PX = 1e6  # projection of a point behind the camera: an outlier whatever was observed
DIGITS = 1e-12  # relative to a matrix: what keeps it positive definite in floating point


@compiled
def _whitened(in_camera: Array, observed: Array, whiten: Array, optics: Array, result: Array) -> float:
    """Residual (3,), observed less projected, in sigmas: left column, row, disparity; and its norm."""
    x, y, z = in_camera[0], in_camera[1], in_camera[2]
    column = row = FARTHEST_PX
    disparity = 0.0
    if z > NEAREST_M:
        column, row = optics[0] * x / z + optics[2], optics[1] * y / z + optics[3]
        disparity = optics[0] * optics[4] / z
    off = 0.0 if np.isnan(observed[2]) else observed[0] - observed[2] - disparity
    column, row = observed[0] - column, observed[1] - row
    result[0] = whiten[0, 0] * column
    result[1] = whiten[1, 0] * column + whiten[1, 1] * row
    result[2] = whiten[2, 0] * column + whiten[2, 1] * row + whiten[2, 2] * off
    return float(np.sqrt(result[0] ** 2 + result[1] ** 2 + result[2] ** 2))


@compiled
def _set_slopes(in_camera: Array, T_camera_body: Array, has_right: bool, optics: Array, slopes: Array) -> None:
    """Derivatives (3, 3) of left column, row and disparity to the point in the frame before the camera's."""
    x, y, z = in_camera[0], in_camera[1], max(in_camera[2], NEAREST_M)
    for i in range(3):
        ahead = T_camera_body[2, i] / z
        slopes[0, i] = optics[0] * (T_camera_body[0, i] - x * ahead) / z
        slopes[1, i] = optics[1] * (T_camera_body[1, i] - y * ahead) / z
        slopes[2, i] = -optics[0] * optics[4] * ahead / z if has_right else 0.0


@compiled
def set_whitening(
    whiten: Array, points: Array, covariances: Array, observed: Array, T_camera_world: Array, noise: tuple[Array, Array]
) -> None:
    """Lower triangles (N, 3, 3) that make residuals white, points being uncertain.

    Args:
        whiten: result.
        points: the landmarks.
        covariances: of the landmarks, m^2, (N, 3, 3).
        observed: of the landmarks.
        T_camera_world: of the left camera, (4, 4).
        noise: sigmas of left column, row, disparity, px, (3,), and ``optics``.
    """
    sigmas, optics = noise
    in_camera, slopes, spread, L = np.empty(3), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for n in range(len(points)):
        transformed(T_camera_world, points[n], in_camera)
        _set_slopes(in_camera, T_camera_world, not np.isnan(observed[n, 2]), optics, slopes)
        for i in range(3):
            for j in range(3):
                spread[i, j] = (
                    slopes[i, 0] * covariances[n, 0, j]
                    + slopes[i, 1] * covariances[n, 1, j]
                    + slopes[i, 2] * covariances[n, 2, j]
                )
        for i in range(3):
            for j in range(i + 1):
                L[i, j] = spread[i, 0] * slopes[j, 0] + spread[i, 1] * slopes[j, 1] + spread[i, 2] * slopes[j, 2]
            L[i, i] += sigmas[i] ** 2
        least = DIGITS * (L[0, 0] + L[1, 1] + L[2, 2])
        for i in range(3):
            L[i, i] += least
        _set_inverse_root(L, whiten[n])


@compiled
def _set_inverse_root(L: Array, inverse: Array) -> None:
    """Inverse (3, 3) of Cholesky's root of a matrix (3, 3), whose lower triangle the root replaces."""
    for i in range(3):
        for j in range(i + 1):
            for k in range(j):
                L[i, j] -= L[i, k] * L[j, k]
            if j < i:
                L[i, j] /= L[j, j]
        L[i, i] = np.sqrt(L[i, i])
    for i in range(3):
        for j in range(3):
            inverse[i, j] = 0.0
        inverse[i, i] = 1.0 / L[i, i]
        for j in range(i):
            total = 0.0
            for k in range(j, i):
                total += L[i, k] * inverse[k, j]
            inverse[i, j] = -total / L[i, i]


@compiled
def set_point_covariances(
    covariances: Array,
    points: Array,
    rows: tuple[IntArray, IntArray, Array],
    T_camera_world: Array,
    optics: Array,
    least: tuple[float, float],
) -> None:
    """Covariances (P, 3, 3) of points (P, 3), m, world frame, from their observations, poses taken as known.

    Args:
        covariances: zero; result, m^2.
        points: the landmarks.
        rows: of N observations: the point and the keyframe, and the inverse sigmas of [left column, row, disparity],
            1/px, (N, 3).
        T_camera_world: of the keyframes' left camera, (K, 4, 4).
        optics: of the cameras.
        least: information that is added in every direction, 1/m^2 and a share of the trace.
    """
    in_camera, slopes, L, inverse = np.empty(3), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for n in range(len(rows[0])):
        point, T = rows[0][n], T_camera_world[rows[1][n]]
        transformed(T, points[point], in_camera)
        _set_slopes(in_camera, T, rows[2][n, 2] > 0.0, optics, slopes)
        for k in range(3):
            weight = rows[2][n, k] ** 2
            for i in range(3):
                for j in range(i + 1):
                    covariances[point, i, j] += weight * slopes[k, i] * slopes[k, j]
    for point in range(len(points)):
        trace = covariances[point, 0, 0] + covariances[point, 1, 1] + covariances[point, 2, 2]
        for i in range(3):
            for j in range(i + 1):
                L[i, j] = covariances[point, i, j]
            L[i, i] += least[0] + least[1] * trace
        _set_inverse_root(L, inverse)
        for i in range(3):
            for j in range(3):
                covariances[point, i, j] = (
                    inverse[0, i] * inverse[0, j] + inverse[1, i] * inverse[1, j] + inverse[2, i] * inverse[2, j]
                )


@compiled
def set_residual_norms(
    norms: Array, points: Array, observed: Array, whiten: Array, T_body_world: Array, camera: tuple[Array, Array]
) -> None:
    """Distances (N,) of the observations from the projections, in sigmas; ``camera``: T_camera_body and ``optics``."""
    in_body, in_camera, residual = np.empty(3), np.empty(3), np.empty(3)
    for n in range(len(points)):
        transformed(T_body_world, points[n], in_body)
        transformed(camera[0], in_body, in_camera)
        norms[n] = _whitened(in_camera, observed[n], whiten[n], camera[1], residual)


@compiled
def add_pose_equations(
    hessian: Array,
    gradient: Array,
    points: Array,
    observed: Array,
    whiten: Array,
    use: BoolArray,
    T_body_world: Array,
    camera: tuple[Array, Array, float],
) -> None:
    """Add the observations that are used (N,) to zero information (6, 6) and vector (6,) of the pose, right/local.

    ``camera``: T_camera_body, ``optics``, and Huber's limit in sigmas.
    """
    in_body, in_camera, residual = np.empty(3), np.empty(3), np.empty(3)
    slopes, J = np.empty((3, 3)), np.empty(6)
    for n in range(len(points)):
        if not use[n]:
            continue
        transformed(T_body_world, points[n], in_body)
        transformed(camera[0], in_body, in_camera)
        if in_camera[2] < NEAREST_M:
            continue
        size = _whitened(in_camera, observed[n], whiten[n], camera[1], residual)
        weight = 1.0 if size <= camera[2] else camera[2] / size
        _set_slopes(in_camera, camera[0], not np.isnan(observed[n, 2]), camera[1], slopes)
        for k in range(3):
            for i in range(3):
                J[3 + i] = 0.0
                for m in range(k + 1):
                    J[3 + i] -= whiten[n, k, m] * slopes[m, i]
            J[0] = J[5] * in_body[1] - J[4] * in_body[2]
            J[1] = J[3] * in_body[2] - J[5] * in_body[0]
            J[2] = J[4] * in_body[0] - J[3] * in_body[1]
            for i in range(6):
                weighted = weight * J[i]
                gradient[i] += weighted * residual[k]
                for j in range(i + 1):
                    hessian[i, j] += weighted * J[j]
    for i in range(6):
        for j in range(i):
            hessian[j, i] = hessian[i, j]

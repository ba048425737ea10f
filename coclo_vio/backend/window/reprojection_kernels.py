# SPDX-License-Identifier: BSD-3-Clause
"""Compiled kernels of an observation: residual, robust weight and derivatives; and the cost of all observations.

They are those of the GTSAM factors that ``ObservationFactors`` makes, which are the oracle in the tests. Left column,
row and disparity have independent errors, so each is divided by its own sigma.

Arguments that many kernels share: ``optics`` = fx, fy, cx, cy (px), baseline (m), (5,); ``T_camera_body`` (4, 4);
``T_body_world`` (K, 4, 4); ``pixels`` (N, 3) left column, row, right column or NaN; ``sigmas`` (N, 2) of pixel and
disparity, px; ``huber`` in sigmas.
"""

import numpy as np
from numpy.typing import NDArray

from coclo_vio.geometry.compiled import compiled, inlined
from coclo_vio.values.arrays import Array

Indices = NDArray[np.int64]
Camera = tuple[Array, Array, float]  # T_camera_body, optics, huber
Observed = tuple[Indices, Indices, Array, Array]  # point and keyframe of each row, (N,); pixels and sigmas


@compiled
def transformed(T: Array, point: Array, result: Array) -> None:
    """A point (3,) under a transform (4, 4)."""
    for i in range(3):
        result[i] = T[i, 0] * point[0] + T[i, 1] * point[1] + T[i, 2] * point[2] + T[i, 3]


@compiled
def whitened_residual(in_camera: Array, pixels: Array, sigmas: Array, optics: Array, result: Array) -> float:
    """The residual (3,) in sigmas, projected less observed, and its norm; as GTSAM's for a point behind the camera."""
    if in_camera[2] <= 0.0:
        result[0] = result[1] = 2.0 * optics[0] / sigmas[0]
        result[2] = 0.0
    else:
        x, y, z = in_camera[0], in_camera[1], in_camera[2]
        result[0] = (optics[0] * x / z + optics[2] - pixels[0]) / sigmas[0]
        result[1] = (optics[1] * y / z + optics[3] - pixels[1]) / sigmas[0]
        result[2] = 0.0
        if not np.isnan(pixels[2]):
            result[2] = (optics[0] * optics[4] / z - (pixels[0] - pixels[2])) / sigmas[1]
    return float(np.sqrt(result[0] ** 2 + result[1] ** 2 + result[2] ** 2))


@compiled
def reprojection_cost(points: Array, observed: Observed, T_body_world: Array, camera: Camera) -> float:
    """Huber's cost of all observations of points (P, 3), m, world frame."""
    point_of, keyframe_of, pixels, sigmas = observed
    T_camera_body, optics, huber = camera
    in_body, in_camera, residual = np.empty(3), np.empty(3), np.empty(3)
    cost = 0.0
    for row in range(len(pixels)):
        transformed(T_body_world[keyframe_of[row]], points[point_of[row]], in_body)
        transformed(T_camera_body, in_body, in_camera)
        size = whitened_residual(in_camera, pixels[row], sigmas[row], optics, residual)
        cost += 0.5 * size**2 if size <= huber else huber * (size - 0.5 * huber)
    return cost


@inlined
def pixel_slopes(
    in_camera: Array, T_camera_body: Array, has_right: bool, weights: Array, optics: Array, slopes: Array
) -> None:
    """Derivatives of the residual to the point in the body frame, (3, 3); zero for a point behind the camera.

    Args:
        in_camera: the point, m, (3,).
        T_camera_body: of the left camera.
        has_right: whether there is a disparity.
        weights: by which column, row and disparity are multiplied, 1/px, (3,).
        optics: of the cameras.
        slopes: result.
    """
    x, y, z = in_camera[0], in_camera[1], in_camera[2]
    for i in range(3):
        if z <= 0.0:
            slopes[0, i] = slopes[1, i] = slopes[2, i] = 0.0
        else:
            ahead = T_camera_body[2, i] / z
            slopes[0, i] = weights[0] * optics[0] * (T_camera_body[0, i] - x * ahead) / z
            slopes[1, i] = weights[1] * optics[1] * (T_camera_body[1, i] - y * ahead) / z
            slopes[2, i] = -weights[2] * optics[0] * optics[4] * ahead / z if has_right else 0.0


@inlined
def jacobians(slopes: Array, in_body: Array, T_body_world: Array, J_pose: Array, J_point: Array) -> None:
    """Derivatives to the pose, right/local, (3, 6), and to the point in the world, (3, 3), from those in the body."""
    for k in range(3):
        J_pose[k, 0] = slopes[k, 1] * in_body[2] - slopes[k, 2] * in_body[1]
        J_pose[k, 1] = slopes[k, 2] * in_body[0] - slopes[k, 0] * in_body[2]
        J_pose[k, 2] = slopes[k, 0] * in_body[1] - slopes[k, 1] * in_body[0]
        for i in range(3):
            J_pose[k, 3 + i] = -slopes[k, i]
            J_point[k, i] = (
                slopes[k, 0] * T_body_world[0, i]
                + slopes[k, 1] * T_body_world[1, i]
                + slopes[k, 2] * T_body_world[2, i]
            )


@compiled
def linearised(
    point: Array, T_body_world: Array, camera: Camera, pixels: Array, sigmas: Array, row: tuple[Array, Array, Array]
) -> None:
    """One observation of a point (3,), times the root of its robust weight.

    Args:
        point: m, world frame.
        T_body_world: of the observing keyframe, (4, 4).
        camera: that observes.
        pixels: observed, (3,).
        sigmas: of pixel and disparity, (2,).
        row: results: residual (3,), its derivatives to the pose, (3, 6), and to the point, (3, 3).
    """
    in_body, in_camera, weights, slopes = np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    T_camera_body, optics, huber = camera
    residual, J_pose, J_point = row
    transformed(T_body_world, point, in_body)
    transformed(T_camera_body, in_body, in_camera)
    size = whitened_residual(in_camera, pixels, sigmas, optics, residual)
    scale = 1.0 if size <= huber else np.sqrt(huber / size)
    weights[0] = weights[1] = scale / sigmas[0]
    weights[2] = scale / sigmas[1]
    for k in range(3):
        residual[k] *= scale
    pixel_slopes(in_camera, T_camera_body, not np.isnan(pixels[2]), weights, optics, slopes)
    jacobians(slopes, in_body, T_body_world, J_pose, J_point)

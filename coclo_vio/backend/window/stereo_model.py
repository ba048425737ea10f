# SPDX-License-Identifier: BSD-3-Clause
"""The stereo camera's measurement model, and the pose of one frame that fits landmarks of known position."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.backend.window.config import PixelNoiseConfig
from coclo_vio.backend.window.observation_table import ObservationTable
from coclo_vio.backend.window.pixel_noise import PixelNoise
from coclo_vio.backend.window.pose_kernels import (
    DIGITS,
    FARTHEST_PX,
    NEAREST_M,
    add_pose_equations,
    set_point_covariances,
    set_residual_norms,
    set_whitening,
)
from coclo_vio.geometry import se3, so3
from coclo_vio.geometry.compiled import IS_COMPILED
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.calibration import RectifiedStereo

_MOST_ITERATIONS = 10
_CONVERGED = 1e-7  # rad and m
_LEAST_INFORMATION = (1e-6, DIGITS)  # of a point, 1/m^2 and a share of all of it: bounds its covariance


@dataclass(frozen=True, slots=True, eq=False)
class PoseFit:
    """The pose of a frame by the landmarks.

    Attributes:
        T_world_body: the pose, (4, 4).
        covariance: of its right/local error, landmarks taken as known, (6, 6).
        is_inlier: the observations that fit, (N,).
    """

    T_world_body: Array
    covariance: Array
    is_inlier: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class WhitenedPoints:
    """Landmarks that a frame observes.

    Attributes:
        points_world: m, (N, 3).
        observations: left column, row, right column or NaN, px, (N, 3).
        whiten: matrices that make residuals of left column, row and disparity white, (N, 3, 3).
    """

    points_world: Array
    observations: Array
    whiten: Array

    @property
    def arrays(self) -> tuple[Array, Array, Array]:
        """Points, observations, and whitening matrices."""
        return self.points_world, self.observations, self.whiten


class StereoModel:
    """Projection into a stereo camera on the body, with residuals whitened by their noise.

    Observations are rows (left column, row, right column); the right column is NaN without a match in the right image.
    """

    def __init__(self, rig: RectifiedStereo, noise: PixelNoiseConfig | PixelNoise) -> None:
        self._rig, self._noise = rig, noise
        self._T_camera_body = np.ascontiguousarray(se3.inverse(rig.T_body_camera))
        self._optics = np.array([*rig.focal_px, *rig.principal_point_px, rig.baseline_m])

    @property
    def _sigmas_px(self) -> Array:
        noise = self._noise
        return np.array([noise.track_px, noise.track_px, noise.repeated_disparity_px])

    def project(self, T_world_body: Array, points_world: Array) -> Array:
        """Observations (N, 3), px, of points (N, 3) from one pose or (N, 4, 4); far outside every image if behind."""
        return self._project_camera(self._in_camera(T_world_body, points_world))

    def whitened(self, residuals_px: Array) -> Array:
        """Residuals (N, 3) = [left column, row, disparity] in sigmas; 0 for the disparity of a right column of NaN."""
        return np.asarray(_offsets(residuals_px) / self._sigmas_px)

    def residual_norms(self, residuals_px: Array) -> Array:
        """Lengths (N,) of residuals (N, 3), observed less projected, in sigmas."""
        whitened = self.whitened(residuals_px)
        return np.asarray(np.sqrt(np.einsum("ij,ij->i", whitened, whitened)))

    def fit_pose(
        self,
        T_predicted: Array,
        covariance: Array,
        points_world: Array,
        observations: Array,
        point_covariances: Array | None = None,
    ) -> PoseFit:
        """The pose that fits observations and prediction best: Gauss-Newton, robust first, then without outliers.

        Args:
            T_predicted: prediction of the body's pose, (4, 4).
            covariance: of the prediction's right/local error, (6, 6), positive definite.
            points_world: landmarks, m, (N, 3).
            observations: of the landmarks, px, (N, 3).
            point_covariances: of the landmarks, m^2, (N, 3, 3); None: they are known exactly.
        """
        information = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
        whiten = self.whitening(T_predicted, points_world, observations, point_covariances)
        frame = WhitenedPoints(*_contiguous(points_world, observations, whiten))
        everything = np.ones(len(observations), dtype=np.bool_)
        T = self._iterate(T_predicted, T_predicted, information, frame, everything)[0]
        is_inlier = self.distances(T, frame) < self._noise.outlier
        T, hessian = self._iterate(T, T_predicted, information, frame, is_inlier)
        is_inlier = np.asarray(self.distances(T, frame) < self._noise.outlier)
        return PoseFit(T, np.asarray(np.linalg.inv(hessian), dtype=np.float64), is_inlier)

    def _iterate(
        self, start: Array, predicted: Array, information: Array, frame: WhitenedPoints, use: BoolArray
    ) -> tuple[Array, Array]:
        """The pose (4, 4), and its information (6, 6), by the observations that are used (N,) and the prediction."""
        T, hessian = start, information
        for _ in range(_MOST_ITERATIONS):
            off = se3.log(se3.inverse(T) @ predicted)
            hessian, gradient = self.equations(T, frame, use)
            hessian += information
            step = np.asarray(np.linalg.solve(hessian, gradient + information @ off), dtype=np.float64)
            T = T @ se3.exp(step)
            if np.abs(step).max() < _CONVERGED:
                break
        return T, hessian

    def equations(self, T_world_body: Array, frame: WhitenedPoints, use: BoolArray) -> tuple[Array, Array]:
        """Information (6, 6) and vector (6,) of the pose by the observations that are used (N,), robustly weighted."""
        if not IS_COMPILED:
            return self.equations_by_numpy(T_world_body, frame, use)
        hessian, gradient = np.zeros((6, 6)), np.zeros(6)
        camera = (self._T_camera_body, self._optics, self._noise.huber)
        add_pose_equations(hessian, gradient, *frame.arrays, use, se3.inverse(T_world_body), camera)
        return hessian, gradient

    def equations_by_numpy(self, T_world_body: Array, frame: WhitenedPoints, use: BoolArray) -> tuple[Array, Array]:
        """The readable form of ``equations``."""
        points, observed, whiten = (each[use] for each in frame.arrays)
        points_camera = self._in_camera(T_world_body, points)
        whitened = np.einsum("nij,nj->ni", whiten, _offsets(observed - self._project_camera(points_camera)))
        size = np.sqrt(np.einsum("ij,ij->i", whitened, whitened))
        weight = np.minimum(1.0, self._noise.huber / np.maximum(size, 1e-9))
        weight[points_camera[:, 2] < NEAREST_M] = 0.0
        rows = whiten @ self._jacobian(T_world_body, points, points_camera, ~np.isnan(observed[:, 2]))
        hessian = np.einsum("nki,n,nkj->ij", rows, weight, rows)
        return np.asarray(hessian), np.asarray(np.einsum("nki,n,nk->i", rows, weight, whitened))

    def _jacobian(
        self,
        T_world_body: Array,
        points_world: Array,
        points_camera: Array,
        has_right: BoolArray,
    ) -> Array:
        """Derivatives (N, 3, 6) of [left column, row, disparity] to a right/local change of the pose."""
        pixel = self._pixel_jacobian(points_camera)
        pixel[:, 2] *= has_right[:, None]
        points_body = (points_world - T_world_body[:3, 3]) @ T_world_body[:3, :3]
        body = np.empty((len(points_world), 3, 6))
        body[:, :, :3] = so3.hat(points_body)
        body[:, :, 3:] = -np.eye(3)
        return np.asarray(pixel @ self._T_camera_body[:3, :3] @ body)

    def _pixel_jacobian(self, points_camera: Array) -> Array:
        """Derivatives (N, 3, 3) of [left column, row, disparity] to the point in the camera."""
        (fx, fy), baseline = self._rig.focal_px, self._rig.baseline_m
        x, y, z = points_camera[:, 0], points_camera[:, 1], np.maximum(points_camera[:, 2], NEAREST_M)
        pixel = np.zeros((len(z), 3, 3))
        pixel[:, 0, 0] = fx / z
        pixel[:, 0, 2] = -fx * x / z**2
        pixel[:, 1, 1] = fy / z
        pixel[:, 1, 2] = -fy * y / z**2
        pixel[:, 2, 2] = -fx * baseline / z**2
        return pixel

    def point_covariances(
        self, points_world: Array, table: ObservationTable, T_world_body: Array, has_disparity: BoolArray
    ) -> Array:
        """Covariance of each point from its observations, poses taken as known, m^2, world frame, (P, 3, 3).

        Args:
            points_world: of the table's landmarks, m, (P, 3).
            table: the observations.
            T_world_body: of the table's keyframes, (K, 4, 4).
            has_disparity: whether the disparity of a row counts, (N,).
        """
        if not IS_COMPILED:
            return self.point_covariances_by_numpy(points_world, table, T_world_body, has_disparity)
        weights = np.full((len(table), 3), 1.0 / self._noise.track_px)
        weights[:, 2] = np.where(has_disparity, 1.0 / self._noise.disparity_px, 0.0)
        T_camera_world = np.ascontiguousarray(se3.inverse(T_world_body @ self._rig.T_body_camera))
        rows, covariances = (table.landmark, table.keyframe, weights), np.zeros((len(points_world), 3, 3))
        set_point_covariances(covariances, points_world, rows, T_camera_world, self._optics, _LEAST_INFORMATION)
        return covariances

    def point_covariances_by_numpy(
        self, points_world: Array, table: ObservationTable, T_world_body: Array, has_disparity: BoolArray
    ) -> Array:
        """The readable form of ``point_covariances``."""
        points, T = points_world[table.landmark], T_world_body[table.keyframe]
        rotation = (T @ self._rig.T_body_camera)[:, :3, :3]
        rows = self._pixel_jacobian(self._in_camera(T, points)) @ np.swapaxes(rotation, -1, -2)
        rows[:, :2] /= self._noise.track_px
        rows[:, 2] /= np.where(has_disparity, self._noise.disparity_px, np.inf)[:, None]
        information = np.add.reduceat(np.swapaxes(rows, 1, 2) @ rows, table.starts[:-1])
        absolute, relative = _LEAST_INFORMATION
        least = absolute + relative * np.einsum("nii->n", information)  # large for a point close to a camera
        return np.asarray(np.linalg.inv(information + least[:, None, None] * np.eye(3)))

    def whitening(
        self, T_world_body: Array, points_world: Array, observations: Array, covariances: Array | None
    ) -> Array:
        """Matrices (N, 3, 3) that make [left column, row, disparity] residuals white, points being uncertain."""
        if not IS_COMPILED or covariances is None:
            return self.whitening_by_numpy(T_world_body, points_world, observations, covariances)
        whiten = np.empty((len(points_world), 3, 3))
        T_camera_world = np.ascontiguousarray(self._T_camera_body @ se3.inverse(T_world_body))
        noise = (self._sigmas_px, self._optics)
        points, spread, observed = _contiguous(points_world, covariances, observations)
        set_whitening(whiten, points, spread, observed, T_camera_world, noise)
        return whiten

    def whitening_by_numpy(
        self, T_world_body: Array, points_world: Array, observations: Array, covariances: Array | None
    ) -> Array:
        """The readable form of ``whitening``."""
        noise = np.broadcast_to(np.diag(np.square(self._sigmas_px)), (len(points_world), 3, 3))
        if covariances is not None:
            rotation = (T_world_body @ self._rig.T_body_camera)[:3, :3]
            rows = self._pixel_jacobian(self._in_camera(T_world_body, points_world)) @ rotation.T
            rows[:, 2] *= ~np.isnan(observations[:, 2:])  # a missing disparity holds no information on the rest
            noise = noise + rows @ covariances @ np.swapaxes(rows, 1, 2)
            size = np.einsum("nii->n", noise)  # of a point close to the camera it exceeds the digits of a float
            noise = noise + DIGITS * size[:, None, None] * np.eye(3)
        return np.asarray(np.linalg.inv(np.linalg.cholesky(noise)))

    def distances(self, T_world_body: Array, frame: WhitenedPoints) -> Array:
        """Distance of each observation from the projection of its point, whitened, (N,)."""
        if not IS_COMPILED:
            return self.distances_by_numpy(T_world_body, frame)
        norms = np.empty(len(frame.points_world))
        set_residual_norms(norms, *frame.arrays, se3.inverse(T_world_body), (self._T_camera_body, self._optics))
        return norms

    def distances_by_numpy(self, T_world_body: Array, frame: WhitenedPoints) -> Array:
        """The readable form of ``distances``."""
        off = _offsets(frame.observations - self.project(T_world_body, frame.points_world))
        return np.asarray(np.linalg.norm(np.einsum("nij,nj->ni", frame.whiten, off), axis=1))

    def _in_camera(self, T_world_body: Array, points_world: Array) -> Array:
        return se3.apply(self._T_camera_body @ se3.inverse(T_world_body), points_world)

    def _project_camera(self, points_camera: Array) -> Array:
        ahead = points_camera[:, 2] > NEAREST_M
        left_px, disparity = self._rig.pixels(np.where(ahead[:, None], points_camera, [0.0, 0.0, 1.0]))
        projected = np.column_stack((left_px, left_px[:, 0] - disparity))
        return np.where(ahead[:, None], projected, FARTHEST_PX)


def _offsets(residuals_px: Array) -> Array:
    """Residuals (N, 3) = [left column, row, disparity], px; 0 for the disparity of a right column of NaN."""
    left, row, right = residuals_px.T
    return np.column_stack((left, row, np.nan_to_num(left - right, nan=0.0)))


def _contiguous(*arrays: Array) -> tuple[Array, ...]:
    return tuple(np.ascontiguousarray(array) for array in arrays)

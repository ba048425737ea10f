# SPDX-License-Identifier: BSD-3-Clause
"""Projection by hand, its derivatives, and the pose of a frame with wrong matches."""

import numpy as np
import pytest
from worlds import RIG, WALK, pose_at, scattered

from coclo_vio.backend.window.config import PixelNoiseConfig
from coclo_vio.backend.window.landmark import Landmark
from coclo_vio.backend.window.observation_table import ObservationTable
from coclo_vio.backend.window.stereo_model import StereoModel, WhitenedPoints
from coclo_vio.geometry import se3, so3
from coclo_vio.geometry.compiled import IS_COMPILED
from coclo_vio.values.calibration import RectifiedStereo

NOISE = PixelNoiseConfig(track_px=0.8, disparity_px=0.5, repeated_disparity_px=2.0)
MODEL = StereoModel(RIG, NOISE)
UPRIGHT = RectifiedStereo((100.0, 200.0), (50.0, 60.0), 0.5, np.eye(4))  # a camera that is the body
WIDE = np.diag(np.square(np.repeat([1.0, 3.0], 3)))
POSE = se3.exp(np.array([0.3, -0.2, 0.9, 1.0, -2.0, 0.4]))


def points_ahead(count: int = 40, seed: int = 4) -> np.ndarray:
    """World points in front of the rig at ``POSE``."""
    random = np.random.default_rng(seed)
    in_camera = random.uniform((-1.5, -1.0, 2.0), (1.5, 1.0, 6.0), (count, 3))
    return se3.apply(POSE @ RIG.T_body_camera, in_camera)


def test_a_point_is_projected_by_the_pinhole() -> None:
    """x = 1, y = 2, z = 4: column 100/4 + 50, row 200 * 2/4 + 60, disparity 100 * 0.5 / 4."""
    projected = StereoModel(UPRIGHT, NOISE).project(np.eye(4), np.array([[1.0, 2.0, 4.0]]))
    np.testing.assert_allclose(projected, [[75.0, 160.0, 62.5]])


def test_the_mounting_of_the_camera_is_applied() -> None:
    points = points_ahead()
    in_camera = se3.apply(se3.inverse(POSE @ RIG.T_body_camera), points)
    left_px, disparity = RIG.pixels(in_camera)
    np.testing.assert_allclose(MODEL.project(POSE, points), np.column_stack((left_px, left_px[:, 0] - disparity)))


def test_each_point_may_have_a_pose_of_its_own() -> None:
    points, other = points_ahead(2), POSE @ se3.exp(np.array([0.0, 0.1, 0.0, 0.2, 0.0, 0.0]))
    both = MODEL.project(np.array([POSE, other]), points)
    np.testing.assert_allclose(both[0], MODEL.project(POSE, points[:1])[0])
    np.testing.assert_allclose(both[1], MODEL.project(other, points[1:])[0])


@pytest.mark.parametrize("depth", [0.0, -0.5, -3.0])
def test_a_point_behind_the_camera_fits_no_observation(depth: float) -> None:
    behind = np.array([[0.1, 0.2, depth]])
    projected = StereoModel(UPRIGHT, NOISE).project(np.eye(4), behind)
    assert np.isfinite(projected).all()
    assert StereoModel(UPRIGHT, NOISE).residual_norms(np.array([[50.0, 60.0, 40.0]]) - projected)[0] > 1e4


def test_residuals_are_whitened_by_track_and_repeated_disparity() -> None:
    """Left 1.6 px, row -0.8 px, right -0.4 px: the disparity is off by 2 px."""
    whitened = MODEL.whitened(np.array([[1.6, -0.8, -0.4], [0.8, 0.0, np.nan]]))
    np.testing.assert_allclose(whitened, [[2.0, -1.0, 1.0], [1.0, 0.0, 0.0]])


def test_the_residual_norm_is_the_length_of_the_whitened_residual() -> None:
    points = points_ahead(1)
    observation = MODEL.project(POSE, points) + np.array([1.6, -0.8, -0.4])
    assert MODEL.residual_norms(observation - MODEL.project(POSE, points))[0] == pytest.approx(np.sqrt(6.0))


@pytest.mark.parametrize("pose", [POSE, np.eye(4), se3.transform(so3.exp(np.array([0, 3.1, 0])), np.ones(3))])
def test_the_jacobian_is_the_derivative_of_the_whitened_residual(pose: np.ndarray) -> None:
    """At a generic pose, at zero rotation and near pi; the covariance of ``fit_pose`` is built of it."""
    random = np.random.default_rng(2)
    in_camera = random.uniform((-1.5, -1.0, 2.0), (1.5, 1.0, 6.0), (12, 3))
    points = se3.apply(pose @ RIG.T_body_camera, in_camera)
    observations = MODEL.project(pose, points)
    observations[3, 2] = np.nan

    def whitened(step: np.ndarray) -> np.ndarray:
        return MODEL.whitened(observations - MODEL.project(pose @ se3.exp(step), points))

    step = 1e-6
    columns = [(whitened(step * axis) - whitened(-step * axis)) / (2.0 * step) for axis in np.eye(6)]
    rows = np.stack(columns, axis=2).reshape(-1, 6)
    fit = MODEL.fit_pose(pose, WIDE, points, observations)
    hessian = rows.T @ rows + np.linalg.inv(WIDE)
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(hessian), rtol=1e-6, atol=1e-12)


def test_exact_observations_give_the_exact_pose() -> None:
    start = POSE @ se3.exp(np.array([0.1, -0.08, 0.12, 0.2, 0.1, -0.3]))
    fit = MODEL.fit_pose(start, 1e6 * WIDE, points_ahead(), MODEL.project(POSE, points_ahead()))
    assert np.abs(se3.log(se3.inverse(POSE) @ fit.T_world_body)).max() < 1e-9
    assert fit.is_inlier.all()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_pose_is_found_with_a_third_of_the_matches_wrong_and_they_are_marked(seed: int) -> None:
    random = np.random.default_rng(seed)
    points = points_ahead(60, seed)
    observations = MODEL.project(POSE, points) + 0.2 * random.standard_normal((60, 3))
    is_wrong = random.permutation(60) < 18
    angles = random.uniform(0.0, 2.0 * np.pi, 18)
    observations[is_wrong, :2] += 60.0 * np.column_stack((np.cos(angles), np.sin(angles)))
    start = POSE @ se3.exp(np.array([0.06, -0.05, 0.08, 0.15, 0.1, -0.1]))
    fit = MODEL.fit_pose(start, WIDE, points, observations)
    np.testing.assert_array_equal(fit.is_inlier, ~is_wrong)
    error = se3.log(se3.inverse(POSE) @ fit.T_world_body)
    assert np.abs(error[:3]).max() < 1e-3
    assert np.abs(error[3:]).max() < 5e-3


def test_observations_of_the_left_camera_alone_localise_a_frame_as_well() -> None:
    observations = MODEL.project(POSE, points_ahead())
    observations[:, 2] = np.nan
    start = POSE @ se3.exp(np.array([0.05, -0.04, 0.05, 0.1, 0.05, -0.1]))
    fit = MODEL.fit_pose(start, 1e6 * WIDE, points_ahead(), observations)
    assert np.abs(se3.log(se3.inverse(POSE) @ fit.T_world_body)).max() < 1e-8
    stereo = MODEL.fit_pose(start, 1e6 * WIDE, points_ahead(), MODEL.project(POSE, points_ahead()))
    assert np.trace(fit.covariance) > np.trace(stereo.covariance)


def test_without_observations_the_prediction_is_returned() -> None:
    fit = MODEL.fit_pose(POSE, WIDE, np.zeros((0, 3)), np.zeros((0, 3)))
    np.testing.assert_allclose(fit.T_world_body, POSE)
    np.testing.assert_allclose(fit.covariance, WIDE)


def test_the_prediction_is_weighted_by_its_covariance() -> None:
    """One point straight ahead in the middle measures depth by its disparity alone: by hand for one number."""
    rig = RectifiedStereo((100.0, 100.0), (0.0, 0.0), 0.5, np.eye(4))
    model = StereoModel(rig, PixelNoiseConfig(track_px=1.0, repeated_disparity_px=1.0, huber=50.0, outlier=90.0))
    point = np.array([[0.0, 0.0, 10.0]])  # disparity 5 px, 0.5 px per metre
    observation = np.array([[0.0, 0.0, -5.5]])
    covariance = np.diag(np.square([1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 0.2]))
    fit = model.fit_pose(np.eye(4), covariance, point, observation)
    information = 1.0 / 0.2**2
    gain = 0.5 / (0.5**2 + information)
    assert fit.T_world_body[2, 3] == pytest.approx(gain * 0.5, rel=0.02)
    assert fit.covariance[5, 5] == pytest.approx(1.0 / (0.5**2 + information), rel=0.02)


def test_the_errors_of_noisy_frames_are_those_of_the_covariance() -> None:
    """Mean of the squared error in sigmas, over 200 frames and 6 numbers: 1 +- 0.06."""
    random = np.random.default_rng(9)
    points = points_ahead(50)
    exact = MODEL.project(POSE, points)
    squares = []
    for _ in range(200):
        track, disparity = 0.8 * random.standard_normal((50, 2)), 2.0 * random.standard_normal(50)
        observations = exact + np.column_stack((track, track[:, 0] - disparity))
        fit = StereoModel(RIG, NOISE.model_copy(update={"huber": 50.0, "outlier": 90.0})).fit_pose(
            POSE, 1e4 * WIDE, points, observations
        )
        error = se3.log(se3.inverse(fit.T_world_body) @ POSE)
        squares.append(error @ np.linalg.solve(fit.covariance, error) / 6.0)
    assert 0.85 < np.mean(squares) < 1.15


def test_a_frame_is_localised_against_the_points_of_a_world() -> None:
    world = scattered()
    tracks = world.observed_from(0, pose_at(WALK, 4_000_000_000))
    observations = np.column_stack((tracks.left_px, tracks.right_px[:, 0]))
    start = pose_at(WALK, 4_000_000_000) @ se3.exp(np.full(6, 0.03))
    fit = MODEL.fit_pose(start, WIDE, world.points[tracks.track_ids], observations)
    assert np.abs(se3.log(se3.inverse(pose_at(WALK, 4_000_000_000)) @ fit.T_world_body)).max() < 1e-6


def test_points_without_a_covariance_are_known_exactly() -> None:
    observations = MODEL.project(POSE, points_ahead()) + 0.3
    given = MODEL.fit_pose(POSE, WIDE, points_ahead(), observations, np.zeros((40, 3, 3)))
    without = MODEL.fit_pose(POSE, WIDE, points_ahead(), observations)
    np.testing.assert_allclose(given.T_world_body, without.T_world_body, atol=1e-12)
    np.testing.assert_allclose(given.covariance, without.covariance, rtol=1e-9)


def test_an_error_within_the_depth_uncertainty_of_a_point_is_not_a_wrong_match() -> None:
    """A point that is a metre nearer than estimated is an inlier; the same error in another direction is not."""
    points = points_ahead()
    rotation = (POSE @ RIG.T_body_camera)[:3, :3]
    off = points.copy()
    off[0] -= 1.0 * rotation[:, 2]
    off[1] += 1.0 * rotation[:, 1]
    observations = MODEL.project(POSE, points)
    covariances = np.tile(rotation @ np.diag(np.square([0.01, 0.01, 1.0])) @ rotation.T, (40, 1, 1))
    uncertain = MODEL.fit_pose(POSE, WIDE, off, observations, covariances)
    np.testing.assert_array_equal(uncertain.is_inlier[:3], [True, False, True])
    assert not MODEL.fit_pose(POSE, WIDE, off, observations).is_inlier[:2].any()
    assert np.trace(uncertain.covariance) > np.trace(MODEL.fit_pose(POSE, WIDE, points, observations).covariance)


def test_the_uncertainty_of_a_point_does_not_enter_a_missing_right_column() -> None:
    observations = MODEL.project(POSE, points_ahead())
    observations[::2, 2] = np.nan
    covariances = np.tile(0.04 * np.eye(3), (40, 1, 1))
    start = POSE @ se3.exp(np.full(6, 0.02))
    fit = MODEL.fit_pose(start, 1e6 * WIDE, points_ahead(), observations, covariances)
    assert fit.is_inlier.all()
    assert np.abs(se3.log(se3.inverse(POSE) @ fit.T_world_body)).max() < 1e-6


def observed_by(keyframes: np.ndarray) -> ObservationTable:
    """Of a point each, observed by these keyframes: rows of True in (P, K)."""
    landmarks = {name: Landmark(name) for name in range(len(keyframes))}
    for name, number in np.argwhere(keyframes).tolist():
        landmarks[name].observe(number, np.zeros(3))
    return ObservationTable.of(landmarks, range(keyframes.shape[1]))


@pytest.mark.parametrize("has_disparity", [True, False])
def test_the_covariance_of_a_point_is_that_of_the_derivatives_of_its_observations(has_disparity: bool) -> None:
    """Observed once: with a disparity by it, and without one along the ray by next to nothing."""
    points, table = points_ahead(5), observed_by(np.ones((5, 1), dtype=np.bool_))
    step = 1e-6
    columns = [
        MODEL.whitened(MODEL.project(POSE, points + step * axis) - MODEL.project(POSE, points - step * axis))
        / (2.0 * step)
        for axis in np.eye(3)
    ]
    rows = np.stack(columns, axis=2)
    rows[:, 2] *= NOISE.repeated_disparity_px / NOISE.disparity_px if has_disparity else 0.0
    information = np.swapaxes(rows, 1, 2) @ rows + 1e-6 * np.eye(3)
    covariances = MODEL.point_covariances(points, table, POSE[None], np.full(5, has_disparity))
    np.testing.assert_allclose(covariances, np.linalg.inv(information), rtol=0.1)
    np.testing.assert_allclose(rows @ covariances @ np.swapaxes(rows, 1, 2), rows @ np.linalg.pinv(rows), atol=1e-4)


@pytest.mark.skipif(not IS_COMPILED, reason="numba is not installed: there is no compiled form")
@pytest.mark.parametrize("seed", range(6))
def test_the_compiled_forms_are_the_readable_ones(seed: int) -> None:
    """With points behind the camera and close to it, missing disparities, wrong matches and unused observations."""
    random = np.random.default_rng(seed)
    points = points_ahead(60, seed)
    points[:5] = se3.apply(POSE @ RIG.T_body_camera, random.uniform((-0.2, -0.2, -2.0), (0.2, 0.2, 0.05), (5, 3)))
    observations = MODEL.project(POSE, points_ahead(60, seed)) + random.normal(0.0, 1.5, (60, 3))
    observations[10:20, 2], observations[20:25, 0] = np.nan, 1e4
    roots = 0.1 * random.standard_normal((60, 3, 3))
    covariances, use = roots @ np.swapaxes(roots, 1, 2), random.random(60) < 0.8
    nearby = POSE @ se3.exp(0.02 * random.standard_normal(6))
    whiten = MODEL.whitening(nearby, points, observations, covariances)
    readable = MODEL.whitening_by_numpy(nearby, points, observations, covariances)
    scale = np.abs(readable).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(whiten / scale, readable / scale, atol=1e-12)
    frame = WhitenedPoints(points, observations, whiten)
    np.testing.assert_allclose(MODEL.distances(nearby, frame), MODEL.distances_by_numpy(nearby, frame), rtol=1e-12)
    ours, theirs = MODEL.equations(nearby, frame, use), MODEL.equations_by_numpy(nearby, frame, use)
    for mine, other in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(mine, other, atol=1e-12 * np.abs(other).max())


@pytest.mark.skipif(not IS_COMPILED, reason="numba is not installed: there is no compiled form")
@pytest.mark.parametrize("seed", range(3))
def test_the_compiled_covariances_of_points_are_the_readable_ones(seed: int) -> None:
    """Observed by 1 to 4 keyframes, some of them from behind."""
    random = np.random.default_rng(seed)
    table = observed_by((random.random((30, 4)) < 0.5) | (np.arange(4) == random.integers(0, 4, (30, 1))))
    poses = np.array([POSE @ se3.exp(0.2 * random.standard_normal(6)) for _ in range(4)])
    points = points_ahead(30, seed)
    points[:3] = POSE[:3, 3]
    arguments = (points, table, poses, random.random(len(table)) < 0.9)
    ours, theirs = MODEL.point_covariances(*arguments), MODEL.point_covariances_by_numpy(*arguments)
    np.testing.assert_allclose(np.linalg.inv(ours) @ theirs, np.broadcast_to(np.eye(3), (30, 3, 3)), atol=1e-3)
    is_plain = np.linalg.cond(theirs) < 1e6
    assert is_plain.sum() > 10
    np.testing.assert_allclose(ours[is_plain], theirs[is_plain], rtol=1e-9)

# SPDX-License-Identifier: BSD-3-Clause
"""How landmarks are placed, refused, renewed and removed."""

import numpy as np
import pytest
from worlds import RIG

from coclo_vio.backend.window.config import PixelNoiseConfig, SmootherConfig
from coclo_vio.backend.window.landmark import Landmark
from coclo_vio.backend.window.landmarks import LandmarkMap, triangulated
from coclo_vio.backend.window.stereo_model import StereoModel
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.measurements import StereoTracks

CONFIG = SmootherConfig(spacing_px=0.0, min_disparity_px=1.0, nearest_m=0.2)
LEFT, RIGHT = np.eye(4), se3.transform(np.eye(3), np.array([0.0, -1.0, 0.0]))  # a metre sideways: y is left


def ahead(*points: tuple[float, float, float]) -> Array:
    """World points from coordinates of the left camera of a body at the origin."""
    return se3.apply(RIG.T_body_camera, np.array(points))


def tracks_of(points: Array, pose: Array, has_right: bool = True, stamp_ns: int = 0, first_id: int = 0) -> StereoTracks:
    left_px, disparity = RIG.pixels(se3.apply(se3.inverse(pose @ RIG.T_body_camera), points))
    right_px = left_px - np.column_stack((disparity, np.zeros(len(points))))
    if not has_right:
        right_px = np.full_like(right_px, np.nan)
    return StereoTracks(stamp_ns, np.arange(first_id, first_id + len(points)), left_px, right_px)


def observed(landmarks: LandmarkMap, number: int, tracks: StereoTracks, wrong: Array | None = None) -> None:
    landmarks.observe(number, tracks, np.zeros(len(tracks), dtype=np.bool_) if wrong is None else wrong)


def by_track(landmarks: LandmarkMap) -> dict[int, Landmark]:
    return {each.track_id: each for _, each in landmarks.items()}


def test_a_disparity_places_a_point_at_once() -> None:
    points, landmarks = ahead((0.3, -0.2, 3.0), (-1.0, 0.5, 5.0)), LandmarkMap(RIG, CONFIG)
    observed(landmarks, 0, tracks_of(points, LEFT))
    landmarks.place({0: LEFT})
    for index, landmark in by_track(landmarks).items():
        np.testing.assert_allclose(landmark.point_world, points[index], atol=1e-9)
        assert landmark.depth_keyframe == 0
        assert not landmark.is_solvable  # one keyframe alone is not connected with another


def test_a_placed_point_connects_the_two_keyframes_that_observe_it() -> None:
    points, landmarks = ahead((0.3, -0.2, 3.0)), LandmarkMap(RIG, CONFIG)
    for number, pose in enumerate((LEFT, RIGHT)):
        observed(landmarks, number, tracks_of(points, pose))
        landmarks.place({0: LEFT, 1: RIGHT})
    assert by_track(landmarks)[0].is_solvable
    assert sorted(by_track(landmarks)[0].observations) == [0, 1]


def test_a_landmark_that_is_solved_for_is_not_placed_anew() -> None:
    points, landmarks = ahead((0.3, -0.2, 3.0)), LandmarkMap(RIG, CONFIG)
    for number, pose in enumerate((LEFT, RIGHT)):
        observed(landmarks, number, tracks_of(points, pose))
        landmarks.place({0: LEFT, 1: RIGHT})
    by_track(landmarks)[0].point_world = np.ones(3)
    landmarks.place({0: LEFT, 1: RIGHT})
    np.testing.assert_array_equal(landmarks.point(0), np.ones(3))


def test_a_far_point_is_placed_only_once_there_is_parallax() -> None:
    """40 m, 45 m: 1.0 and 0.89 px of disparity are out of range; 1 m sideways gives 1.4 deg."""
    points, landmarks = ahead((0.5, 0.2, 45.0)), LandmarkMap(RIG, CONFIG)
    observed(landmarks, 0, tracks_of(points, LEFT))
    landmarks.place({0: LEFT})
    assert by_track(landmarks)[0].point_world is None
    near = se3.transform(np.eye(3), np.array([0.0, -0.1, 0.0]))
    observed(landmarks, 1, tracks_of(points, near))
    landmarks.place({0: LEFT, 1: near})
    assert by_track(landmarks)[0].point_world is None
    observed(landmarks, 2, tracks_of(points, RIGHT))
    landmarks.place({0: LEFT, 1: near, 2: RIGHT})
    np.testing.assert_allclose(landmarks.point(0), points[0], atol=1e-6)
    assert by_track(landmarks)[0].depth_keyframe is None


def test_a_point_observed_by_the_left_camera_alone_is_placed_by_parallax() -> None:
    points, landmarks = ahead((0.3, -0.2, 3.0)), LandmarkMap(RIG, CONFIG)
    for number, pose in enumerate((LEFT, RIGHT)):
        observed(landmarks, number, tracks_of(points, pose, has_right=False))
        landmarks.place({0: LEFT, 1: RIGHT})
    np.testing.assert_allclose(landmarks.point(0), points[0], atol=1e-9)


def test_the_first_disparity_counts_even_if_it_comes_late() -> None:
    points, landmarks = ahead((0.3, -0.2, 3.0)), LandmarkMap(RIG, CONFIG)
    observed(landmarks, 4, tracks_of(points, LEFT, has_right=False))
    observed(landmarks, 5, tracks_of(points, RIGHT))
    observed(landmarks, 6, tracks_of(points, LEFT))
    assert by_track(landmarks)[0].depth_keyframe == 5


@pytest.mark.parametrize("depth", [-3.0, 0.1, 80.0], ids=["behind", "too near", "too far"])
def test_rays_that_meet_behind_too_near_or_too_far_place_no_point(depth: float) -> None:
    """Farthest is 500 baselines, 50 m; nearest 0.2 m. The rays are drawn from a point at that depth."""
    landmarks = LandmarkMap(RIG, CONFIG)
    point = ahead((0.0, 0.0, depth))
    far = se3.transform(np.eye(3), np.array([0.0, -0.02 if depth == 0.1 else -3.0, 0.0]))
    for number, pose in enumerate((LEFT, far)):
        in_camera = se3.apply(se3.inverse(pose @ RIG.T_body_camera), point)[0]
        left_px = in_camera[:2] / in_camera[2] * RIG.focal_px + RIG.principal_point_px
        tracks = StereoTracks(number, np.array([0]), left_px[None], np.full((1, 2), np.nan))
        observed(landmarks, number, tracks)
    landmarks.place({0: LEFT, 1: far})
    assert by_track(landmarks)[0].point_world is None


@pytest.mark.parametrize(
    ("disparity", "is_in_range"), [(0.9, False), (1.1, True), (199.0, True), (201.0, False), (-5.0, False)]
)
def test_disparities_of_points_too_far_too_near_or_behind_are_out_of_range(disparity: float, is_in_range: bool) -> None:
    """focal 400 px, baseline 0.1 m, nearest 0.2 m: 200 px at most."""
    left_px = np.array([[300.0, 200.0]])
    tracks = StereoTracks(0, np.array([0]), left_px, left_px - [disparity, 0.0])
    row = LandmarkMap(RIG, CONFIG).observations(tracks)[0]
    assert np.isnan(row[2]) != is_in_range
    np.testing.assert_array_equal(row[:2], left_px[0])


def test_new_points_too_near_to_a_known_or_an_earlier_one_are_left_out() -> None:
    config = CONFIG.model_copy(update={"spacing_px": 6.0})
    landmarks = LandmarkMap(RIG, config)
    columns = np.array([100.0, 104.0, 108.0, 200.0])  # the second is near the first, the third near the second only
    left_px = np.column_stack((columns, np.full(4, 50.0)))
    observed(landmarks, 0, StereoTracks(0, np.arange(4), left_px, left_px - [20.0, 0.0]))
    assert sorted(by_track(landmarks)) == [0, 2, 3]
    more = np.array([[203.0, 50.0], [200.0, 50.0], [400.0, 50.0]])
    observed(landmarks, 1, StereoTracks(1, np.array([7, 3, 8]), more, more - [20.0, 0.0]))
    assert sorted(by_track(landmarks)) == [0, 2, 3, 8]
    assert 1 in by_track(landmarks)[3].observations  # a known one is never left out


def test_wrong_sightings_are_not_taken() -> None:
    points, landmarks = ahead((0.3, -0.2, 3.0), (-1.0, 0.5, 5.0)), LandmarkMap(RIG, CONFIG)
    observed(landmarks, 0, tracks_of(points, LEFT))
    observed(landmarks, 1, tracks_of(points, RIGHT), np.array([True, False]))
    assert [len(by_track(landmarks)[index].observations) for index in (0, 1)] == [1, 2]


def test_a_retired_landmark_takes_no_more_sightings_until_it_is_forgotten() -> None:
    points, landmarks = ahead((0.3, -0.2, 3.0)), LandmarkMap(RIG, CONFIG)
    observed(landmarks, 0, tracks_of(points, LEFT))
    by_track(landmarks)[0].is_retired = True
    observed(landmarks, 1, tracks_of(points, RIGHT))
    assert len(landmarks) == 1
    assert sorted(landmarks[0].observations) == [0]
    landmarks.remove(0)
    observed(landmarks, 2, tracks_of(points, RIGHT))
    assert sorted(landmarks[1].observations) == [2]


def test_a_wandering_track_becomes_another_point_after_a_while() -> None:
    """1 px of track, 0.5 px of walk from keyframe to keyframe: after four observations it is another point."""
    config = CONFIG.model_copy(update={"noise": PixelNoiseConfig(track_px=1.0, walk_px=0.5)})
    points, landmarks = ahead((0.3, -0.2, 3.0)), LandmarkMap(RIG, config)
    for number in range(6):
        observed(landmarks, number, tracks_of(points, LEFT))
    assert [sorted(each.observations) for _, each in landmarks.items()] == [[0, 1, 2, 3], [3, 4, 5]]
    assert [each.is_retired for _, each in landmarks.items()] == [True, False]
    assert landmarks[1].track_id == landmarks[0].track_id
    landmarks.remove(0)
    observed(landmarks, 6, tracks_of(points, LEFT))
    assert 6 in landmarks[1].observations  # the track still observes the new landmark


def test_known_tracks_are_those_of_placed_landmarks() -> None:
    points, landmarks = ahead((0.3, -0.2, 3.0), (0.0, 0.0, 60.0)), LandmarkMap(RIG, CONFIG)
    observed(landmarks, 0, tracks_of(points, LEFT))
    landmarks.place({0: LEFT})
    both = tracks_of(np.concatenate((points, ahead((1.0, 0.3, 4.0)))), RIGHT)
    is_known, where, covariances = landmarks.known(both)
    np.testing.assert_array_equal(is_known, [True, False, False])
    np.testing.assert_allclose(where, points[:1], atol=1e-9)
    assert covariances.shape == (1, 3, 3)


def test_an_empty_frame_is_possible() -> None:
    landmarks = LandmarkMap(RIG, CONFIG)
    nothing = StereoTracks(0, np.zeros(0, dtype=np.int64), np.zeros((0, 2)), np.zeros((0, 2)))
    observed(landmarks, 0, nothing)
    is_known, where, covariances = landmarks.known(nothing)
    assert len(is_known) == len(where) == len(covariances) == len(landmarks) == 0
    landmarks.update_covariances({}, StereoModel(RIG, CONFIG.noise))


def test_a_removed_keyframe_takes_its_observations_and_the_points_that_only_it_observed() -> None:
    points, landmarks = ahead((0.3, -0.2, 3.0), (-1.0, 0.5, 5.0), (1.0, 0.5, 4.0)), LandmarkMap(RIG, CONFIG)
    observed(landmarks, 0, tracks_of(points, LEFT))
    observed(landmarks, 1, tracks_of(points[:1], RIGHT))
    landmarks[2].is_in_prior = True
    landmarks.remove_keyframe(0)
    assert sorted(by_track(landmarks)) == [0, 2]
    assert sorted(landmarks[0].observations) == [1]


def test_a_landmark_whose_disparity_left_the_window_is_placed_by_parallax() -> None:
    points, landmarks = ahead((0.3, -0.2, 3.0)), LandmarkMap(RIG, CONFIG)
    for number, pose in enumerate((LEFT, RIGHT)):
        observed(landmarks, number, tracks_of(points, pose, has_right=number == 0))
    landmarks.remove_keyframe(0)
    landmarks.place({1: RIGHT})
    nearer = se3.transform(np.eye(3), np.array([0.5, -1.0, 0.0]))
    observed(landmarks, 2, tracks_of(points, nearer, has_right=False))
    landmarks.place({1: RIGHT, 2: nearer})
    np.testing.assert_allclose(landmarks.point(0), points[0], atol=1e-9)


def covariance_of_first(landmarks: LandmarkMap, points: Array, poses: list[Array], has_right: bool = True) -> Array:
    """The covariance of the first point in the axes of the camera of a body at the origin, (3, 3)."""
    known = dict(enumerate(poses))
    for number, pose in known.items():
        observed(landmarks, number, tracks_of(points, pose, has_right=has_right))
        landmarks.place(known)
    landmarks.update_covariances(known, StereoModel(RIG, CONFIG.noise))
    covariance, rotation = landmarks[0].covariance, RIG.T_body_camera[:3, :3]
    assert covariance is not None
    return np.asarray(rotation.T @ covariance @ rotation)


def test_the_covariance_from_one_pair_is_that_of_track_and_disparity() -> None:
    """Straight ahead at 4 m: z / f track_px across, z^2 / (f baseline) disparity_px along."""
    noise = CONFIG.noise
    covariance = covariance_of_first(LandmarkMap(RIG, CONFIG), ahead((0.0, 0.0, 4.0)), [LEFT])
    sigmas = [4.0 / 400.0 * noise.track_px, 4.0 / 410.0 * noise.track_px, 16.0 / 40.0 * noise.disparity_px]
    np.testing.assert_allclose(covariance, np.diag(np.square(sigmas)), rtol=1e-4, atol=1e-9)


def test_a_second_observation_reduces_the_covariance_but_its_disparity_counts_once() -> None:
    """Observed twice from the same place, the track counts twice and the disparity once."""
    once = covariance_of_first(LandmarkMap(RIG, CONFIG), ahead((0.0, 0.0, 4.0)), [LEFT])
    twice = covariance_of_first(LandmarkMap(RIG, CONFIG), ahead((0.0, 0.0, 4.0)), [LEFT, LEFT])
    aside = covariance_of_first(LandmarkMap(RIG, CONFIG), ahead((0.0, 0.0, 4.0)), [LEFT, RIGHT])
    np.testing.assert_allclose(np.diag(twice), np.diag(once) * [0.5, 0.5, 1.0], rtol=1e-4)
    assert aside[2, 2] < 0.1 * once[2, 2]


def test_a_point_placed_by_parallax_has_the_covariance_of_parallax_alone() -> None:
    point = ahead((0.0, 0.0, 4.0))
    alone = covariance_of_first(LandmarkMap(RIG, CONFIG), point, [LEFT, RIGHT], has_right=False)
    both = covariance_of_first(LandmarkMap(RIG, CONFIG), point, [LEFT, RIGHT])
    assert np.linalg.eigvalsh(alone).min() > 0.0
    assert alone[2, 2] > both[2, 2]


@pytest.mark.parametrize("seed", range(3))
def test_the_point_nearest_to_the_rays_is_the_least_squares_one(seed: int) -> None:
    """Each of 20 points by itself, of 2 to 6 disturbed rays; those of the last one are parallel."""
    random = np.random.default_rng(seed)
    counts = random.integers(2, 7, 20)
    starts = np.concatenate(([0], np.cumsum(counts)))
    centres = random.standard_normal((starts[-1], 3))
    rays = np.repeat(random.uniform(3.0, 6.0, (20, 3)), counts, axis=0) - centres
    rays += 0.01 * random.standard_normal(rays.shape)
    rays[starts[-2] :] = rays[starts[-2]]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    points, depths = triangulated(starts, centres, rays)
    for index in range(19):
        own = slice(starts[index], starts[index + 1])
        across = np.vstack([np.eye(3) - np.outer(ray, ray) for ray in rays[own]])
        measured = np.concatenate(
            [part @ centre for part, centre in zip(np.split(across, counts[index]), centres[own], strict=True)]
        )
        np.testing.assert_allclose(points[index], np.linalg.lstsq(across, measured)[0], rtol=1e-9)
        assert depths[index] == pytest.approx(rays[own][-1] @ (points[index] - centres[own][-1]))
    assert np.isnan(depths[19])


def test_points_that_both_cameras_of_a_keyframe_observe_are_counted() -> None:
    landmarks = LandmarkMap(RIG, SmootherConfig())
    points = ahead((0.0, 0.0, 3.0), (0.5, 0.0, 3.0))
    observed(landmarks, 0, tracks_of(points, np.eye(4)))
    observed(landmarks, 1, tracks_of(points, np.eye(4), has_right=False))
    observed(landmarks, 2, tracks_of(points[:1], np.eye(4)))
    assert [landmarks.matched(number) for number in range(4)] == [2, 0, 1, 0]

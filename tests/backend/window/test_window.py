# SPDX-License-Identifier: BSD-3-Clause
"""The window of keyframes: exact measurements, information that is kept or dropped, observations that do not fit."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from worlds import FRAME_NS, RIG, WALK, frames, pose_at, scattered

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.config import DisparityOffsetConfig, PixelNoiseConfig, SmootherConfig
from coclo_vio.backend.window.keyframe import Keyframe, Solution
from coclo_vio.backend.window.variables import BIASES, VELOCITY, KeyframeVariables
from coclo_vio.backend.window.window import Window
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.measurements import StereoTracks

PLAIN = PixelNoiseConfig(
    track_px=1.0, disparity_px=1.0, repeated_disparity_px=1.0, huber=50.0, outlier=90.0, is_learnt=False
)
EXACT = SmootherConfig(
    tolerance=0.0,
    iterations=4,
    spacing_px=0.0,
    most_kept_landmarks=10_000,
    noise=PLAIN,
    disparity_offset=DisparityOffsetConfig(is_estimated=False),
)
WORLD = scattered(count=800)  # 60 points in view
START_COVARIANCE = 1e-8 * np.eye(6)
STAMPS = range(1_500_000_000, 6_500_000_000, 3 * FRAME_NS)


def with_new_identities(tracked: list[StereoTracks]) -> list[StereoTracks]:
    """A point that returns into view gets a new identity, as from a tracker."""
    named: dict[int, int] = {}
    fresh, result = 0, []
    for tracks in tracked:
        now = {}
        for point in tracks.track_ids.tolist():
            if point not in named:
                fresh += 1
            now[point] = named.get(point, fresh)
        named = now
        result.append(replace(tracks, track_ids=np.array([*now.values()])))
    return result


def add(window: Window, number: int, tracks: StereoTracks, pose: Array, *terms: factors.Term) -> None:
    window.add(Keyframe(number, tracks.stamp_ns, tracks, [*terms]), pose, np.zeros(len(tracks), dtype=np.bool_))


def filled(
    config: SmootherConfig, tracked: list[StereoTracks], longest: int | None = None, disturbed: float = 0.0
) -> tuple[Window, Solution]:
    """A window that was fed keyframes of the walk, never longer than ``longest``."""
    random = np.random.default_rng(6)
    window = Window(RIG, config)
    solution = None
    for number, tracks in enumerate(tracked):
        pose = pose_at(WALK, tracks.stamp_ns)
        off = se3.exp(disturbed * random.standard_normal(6)) if number else np.eye(4)
        add(window, number, tracks, pose @ off)
        if number == 0:
            window.fix_first(START_COVARIANCE)
        if longest is not None:
            solution = window.solve()
            if len(window.keyframes) > longest:
                window.drop_oldest()
    return window, window.solve() if solution is None else solution


def worst_pose(window: Window) -> float:
    return max(
        np.abs(se3.log(se3.inverse(pose_at(WALK, each.stamp_ns)) @ window.pose(each.number))).max()
        for each in window.keyframes
    )


def test_exact_measurements_are_fitted_to_1e_8_from_disturbed_values() -> None:
    """Poses off by 6 cm and 3 deg, points placed from those poses."""
    tracked = frames(WALK, STAMPS[:8], WORLD)
    config = EXACT.model_copy(update={"iterations": 15})
    window, solution = filled(config, tracked, disturbed=0.05)
    assert worst_pose(window) < 1e-8
    assert solution.reprojection_px < 1e-6
    points = WORLD.points
    placed = [(each.track_id, each.point_world) for _, each in window.landmarks.items() if each.is_solvable]
    assert len(placed) == solution.landmarks > 50
    assert max(np.abs(point - points[track]).max() for track, point in placed if point is not None) < 1e-7


def test_the_default_configuration_converges_as_well_from_ordinary_initial_values() -> None:
    tracked = frames(WALK, STAMPS[:8], WORLD)
    window, _ = filled(SmootherConfig(tolerance=0.0, iterations=15), tracked, disturbed=0.005)
    assert worst_pose(window) < 1e-8


def batch(tracked: list[StereoTracks]) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """All observations of all frames and a prior on the first pose, solved at once."""
    make = factors.ObservationFactors(RIG, PLAIN).make
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.push_back(factors.pose_prior(0, pose_at(WALK, tracked[0].stamp_ns), START_COVARIANCE).factor)
    times = np.unique(np.concatenate([tracks.track_ids for tracks in tracked]), return_counts=True)
    often = {int(track) for track, count in zip(*times, strict=True) if count > 1}
    for number, tracks in enumerate(tracked):
        pose = pose_at(WALK, tracks.stamp_ns)
        values.insert(factors.pose_key(number), gtsam.Pose3(pose))
        points = RIG.points(tracks.left_px, tracks.left_px[:, 0] - tracks.right_px[:, 0])
        for row, track in enumerate(tracks.track_ids.tolist()):
            if track in often:
                observation = np.array([*tracks.left_px[row], tracks.right_px[row, 0]])
                graph.push_back(make(number, track, observation, is_first=False).factor)
                if not values.exists(factors.landmark_key(track)):
                    point = se3.apply(pose @ RIG.T_body_camera, points[row])
                    values.insert(factors.landmark_key(track), point)
    for _ in range(3):
        values = values.retract(graph.linearize(values).optimize())
    return graph, values


def between(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, first: int, last: int) -> tuple[Array, Array]:
    """The motion (4, 4) from one pose to another, and the covariance (6, 6) of its right/local error."""
    keys = [factors.pose_key(first), factors.pose_key(last)]
    start, end = (np.asarray(values.atPose3(key).matrix()) for key in keys)
    joint = gtsam.Marginals(graph, values).jointMarginalCovariance(gtsam.KeyVector(keys))
    J = np.hstack((-se3.adjoint(se3.inverse(end) @ start), np.eye(6)))
    blocks = np.block([[joint.at(row, column) for column in keys] for row in keys])
    return se3.inverse(start) @ end, J @ blocks @ J.T


@pytest.mark.parametrize("longest", [4, 6])
def test_a_sliding_window_has_estimate_and_covariance_of_the_batch(longest: int) -> None:
    """Of the newest keyframe relative to the oldest one, which is fixed.

    Noise of 1e-4 px makes a linear problem of it: the two differ far less than noise moves them.
    """
    tracked = with_new_identities(frames(WALK, STAMPS, WORLD, noise_px=1e-4))
    window, slid = filled(EXACT, tracked, longest)
    oldest, newest = window.keyframes[0].number, len(tracked) - 1
    assert oldest == newest - longest + 1
    graph, values = batch(tracked)
    slid_motion = se3.inverse(window.pose(oldest)) @ window.pose(newest)
    whole, _ = between(graph, values, oldest, newest)
    truth = se3.inverse(pose_at(WALK, tracked[oldest].stamp_ns)) @ pose_at(WALK, tracked[newest].stamp_ns)
    apart, off = (se3.log(se3.inverse(each) @ whole) for each in (slid_motion, truth))
    assert np.abs(apart).max() < 1e-9
    assert np.abs(apart).max() < 1e-4 * np.abs(off).max()
    before, covariance = between(graph, values, oldest - 1, newest)  # solved before the oldest one left
    moved = se3.adjoint(se3.inverse(before))
    np.testing.assert_allclose(slid.covariance, covariance + 1e-8 * moved @ moved.T, rtol=1e-6, atol=1e-9)


def test_landmarks_left_out_of_the_prior_lose_information() -> None:
    tracked = with_new_identities(frames(WALK, STAMPS, WORLD))
    kept = filled(EXACT, tracked, 4)[1].covariance
    some = filled(EXACT.model_copy(update={"most_kept_landmarks": 20}), tracked, 4)[1].covariance
    none = filled(EXACT.model_copy(update={"most_kept_landmarks": 0}), tracked, 4)[1].covariance
    for less, more in ((some, kept), (none, some)):
        assert np.linalg.eigvalsh(less - more).min() > -1e-6 * np.trace(more)
        assert np.trace(less) > 1.05 * np.trace(more)


def test_covariance_is_of_pose_velocity_and_biases_in_this_order() -> None:
    window = Window(RIG, EXACT, KeyframeVariables([VELOCITY, BIASES]))
    tracks = frames(WALK, STAMPS[:1], WORLD)[0]
    pose_covariance = np.diag(np.square([0.01, 0.02, 0.03, 0.1, 0.2, 0.3]))
    terms = [
        factors.pose_prior(0, np.eye(4), pose_covariance),
        factors.velocity_prior(0, np.array([1.0, 2.0, 3.0]), 0.5),
        factors.bias_prior(0, np.zeros(3), np.zeros(3), np.repeat([0.1, 0.01], 3)),
    ]
    values = {VELOCITY: np.zeros(3), BIASES: gtsam.imuBias.ConstantBias()}
    everything = np.zeros(len(tracks), dtype=np.bool_)
    window.add(Keyframe(0, tracks.stamp_ns, tracks, terms), np.eye(4), everything, values)
    covariance = window.solve().covariance
    np.testing.assert_allclose(covariance[:6, :6], pose_covariance, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(covariance[6:, 6:], np.diag(np.square(np.repeat([0.5, 0.1, 0.01], 3))), atol=1e-12)
    np.testing.assert_allclose(covariance[:6, 6:], 0.0, atol=1e-12)
    np.testing.assert_allclose(window.velocity(0), [1.0, 2.0, 3.0])


def test_the_residuals_of_noisy_observations_are_their_noise() -> None:
    """Left column and row with 0.3 px, right column with 0.3 and 0.15 px: 0.31 px, less what the points take up."""
    tracked = frames(WALK, STAMPS[:8], WORLD, noise_px=0.3)
    assert 0.2 < filled(EXACT, tracked)[1].reprojection_px < 0.32


def test_an_observation_that_does_not_fit_is_removed_and_its_landmark_retired_if_it_is_the_newest() -> None:
    tracked = frames(WALK, STAMPS[:5], WORLD)
    common = set.intersection(*({*tracks.track_ids.tolist()} for tracks in tracked))
    early, late = sorted(common)[:2]
    for frame, wrong in ((2, early), (4, late)):
        left_px = tracked[frame].left_px + 30.0 * (tracked[frame].track_ids == wrong)[:, None]
        tracked[frame] = replace(tracked[frame], left_px=left_px)
    window, _ = filled(SmootherConfig(tolerance=0.0, iterations=20, spacing_px=0.0), tracked)
    by_track = {each.track_id: each for _, each in window.landmarks.items()}
    assert sorted(by_track[early].observations) == [0, 1, 3, 4]
    assert not by_track[early].is_retired
    assert sorted(by_track[late].observations) == [0, 1, 2, 3]
    assert by_track[late].is_retired
    window.solve()
    assert worst_pose(window) < 1e-6


def test_a_failed_marginalisation_changes_nothing() -> None:
    """Without its prior the oldest keyframe is indeterminate: none of its observations is left."""
    tracked = frames(WALK, STAMPS[:3], WORLD)
    window, _ = filled(EXACT, tracked)
    window.keyframes[0].terms.clear()
    window.keyframes[0].tracks = replace(tracked[0])
    for _, landmark in window.landmarks.items():
        landmark.observations.pop(0, None)
    before, count = gtsam.Values(window.values), len(window.landmarks)
    with pytest.raises(SmootherError, match="not determined"):
        window.drop_oldest()
    assert [each.number for each in window.keyframes] == [0, 1, 2]
    assert window.values.equals(before, 0.0)
    assert len(window.landmarks) == count


def test_after_discarding_the_oldest_keyframe_the_next_one_is_fixed() -> None:
    tracked = frames(WALK, STAMPS[:6], WORLD)
    window, _ = filled(EXACT, tracked, 4)
    covariance = np.diag(np.square(np.repeat([0.01, 0.02], 3)))
    window.discard_oldest(covariance, [])
    numbers = [each.number for each in window.keyframes]
    solution = window.solve()
    assert numbers == [2, 3, 4, 5][-len(numbers) :]
    assert worst_pose(window) < 1e-7
    assert np.trace(solution.covariance[3:, 3:]) > 3 * 0.02**2 * 0.9


def test_removed_keyframes_leave_nothing_behind() -> None:
    tracked = with_new_identities(frames(WALK, STAMPS, WORLD))
    window, _ = filled(EXACT, tracked, 4)
    alive = {each.number for each in window.keyframes}
    known = {number for _, landmark in window.landmarks.items() for number in landmark.observations}
    assert known <= alive
    assert window.values.size() == len(alive)
    in_prior = {key for term in window.prior for key in term.keys}
    present = {factors.pose_key(number) for number in alive}
    present |= {factors.landmark_key(each) for each, _ in window.landmarks.items()}
    assert in_prior <= present

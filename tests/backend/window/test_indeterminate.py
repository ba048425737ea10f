# SPDX-License-Identifier: BSD-3-Clause
"""A landmark that nothing determines is found and dropped; the window is solved without it and never starts anew."""

from collections.abc import Callable, Iterator

import gtsam
import numpy as np
import pytest
from worlds import FRAME_NS, RIG, WALK, World, frames, pose_at, scattered

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.config import PixelNoiseConfig, SmootherConfig
from coclo_vio.backend.window.event_log import EventLog
from coclo_vio.backend.window.factors import ObservationFactors, Term, relative_pose
from coclo_vio.backend.window.indeterminate import indeterminate_points, supports
from coclo_vio.backend.window.keyframe import Keyframe
from coclo_vio.backend.window.marginalisation import marginal_prior
from coclo_vio.backend.window.smoother import SlidingWindowSmoother
from coclo_vio.backend.window.stereo_model import StereoModel
from coclo_vio.backend.window.window import Window
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.measurements import StereoTracks

PLAIN = PixelNoiseConfig(track_px=1.0, disparity_px=1.0, repeated_disparity_px=1.0, huber=50.0, outlier=90.0)
CONFIG = SmootherConfig(tolerance=0.0, iterations=6, spacing_px=0.0, most_kept_landmarks=1000, noise=PLAIN)
MODEL = StereoModel(RIG, PLAIN)
STAMPS = range(1_500_000_000, 3_000_000_000, 3 * FRAME_NS)
TRACKS = frames(WALK, STAMPS, scattered(count=800))
LOOSE = 1_000_000  # first track of landmarks that are not determined


def in_camera(number: int, point_world: Array) -> Array:
    """A point in the left camera of a keyframe."""
    return se3.apply(se3.inverse(pose_at(WALK, STAMPS[number]) @ RIG.T_body_camera), point_world)


def world_point(number: int, in_camera: Array) -> Array:
    """A point given in the left camera of a keyframe."""
    return se3.apply(pose_at(WALK, STAMPS[number]) @ RIG.T_body_camera, in_camera)


def observed(number: int, point_world: Array) -> Array:
    """Its exact observation without a right column."""
    observation = MODEL.project(pose_at(WALK, STAMPS[number]), point_world[None])[0]
    return np.array([observation[0], observation[1], np.nan])


def seen_once() -> tuple[Array, dict[int, Array]]:
    """By the left camera of one keyframe; the second observation is of no camera that the point is in front of."""
    point = world_point(2, np.array([0.5, 0.2, 4.0]))
    return world_point(3, np.array([0.1, 0.1, -3.0])), {3: observed(2, point), 2: observed(2, point)}


def very_far() -> tuple[Array, dict[int, Array]]:
    """500 km away: no parallax between the keyframes."""
    point = world_point(1, np.array([1e5, -5e4, 5e5]))
    return point, {number: observed(number, point) for number in (1, 2, 3)}


def at_the_epipole() -> tuple[Array, dict[int, Array]]:
    """On the line through the two cameras that observe it."""
    cameras = [(pose_at(WALK, STAMPS[number]) @ RIG.T_body_camera)[:3, 3] for number in (1, 2)]
    point = cameras[1] + 30.0 * (cameras[1] - cameras[0])
    return point, {number: observed(number, point) for number in (1, 2)}


def contradictory() -> tuple[Array, dict[int, Array]]:
    """Two rays that meet behind both cameras."""
    behind = world_point(2, np.array([0.3, 0.2, -2.0]))
    return behind, {number: np.array([320.0 + 90.0 * number, 200.0, np.nan]) for number in (1, 2)}


CASES = pytest.mark.parametrize("case", [seen_once, very_far, at_the_epipole, contradictory])


def window_of(keyframes: int) -> Window:
    window = Window(RIG, CONFIG)
    for number, tracks in enumerate(TRACKS[:keyframes]):
        pose = pose_at(WALK, tracks.stamp_ns)
        window.add(Keyframe(number, tracks.stamp_ns, tracks), pose, np.zeros(len(tracks), dtype=np.bool_))
        if number == 0:
            window.fix_first(1e-8 * np.eye(6))
    return window


def add_loose(window: Window, point_world: Array, observations: dict[int, Array], track: int = LOOSE) -> int:
    """Add a landmark with these observations at this position; its identity."""
    row = StereoTracks(0, np.array([track]), np.array([[100.0, 100.0]]), np.full((1, 2), np.nan))
    window.landmarks.observe(min(observations), row, np.zeros(1, dtype=np.bool_))
    landmark_id, landmark = window.landmarks.items()[-1]
    landmark.observations, landmark.point_world = dict(observations), point_world
    return landmark_id


def poses_of(window: Window) -> Array:
    return np.array([window.pose(each.number) for each in window.keyframes])


@CASES
def test_one_landmark_that_is_not_determined_is_dropped_and_the_others_are_solved(
    case: Callable[[], tuple[Array, dict[int, Array]]],
) -> None:
    plain, disturbed = window_of(5), window_of(5)
    loose = add_loose(disturbed, *case())
    expected, solution = plain.solve(), disturbed.solve()
    assert (expected.dropped, solution.dropped) == (0, 1)
    assert loose not in dict(disturbed.landmarks.items())
    np.testing.assert_allclose(poses_of(disturbed), poses_of(plain), atol=1e-9)
    np.testing.assert_allclose(solution.covariance, expected.covariance, rtol=1e-9, atol=1e-15)


def test_several_landmarks_that_are_not_determined_are_dropped_at_one_keyframe() -> None:
    plain, disturbed = window_of(5), window_of(5)
    for index, case in enumerate((very_far, at_the_epipole, contradictory, seen_once)):
        add_loose(disturbed, *case(), track=LOOSE + index)
    plain.solve()
    assert disturbed.solve().dropped == 4
    np.testing.assert_allclose(poses_of(disturbed), poses_of(plain), atol=1e-9)


def test_a_landmark_of_the_prior_is_dropped_and_the_information_on_the_others_stays() -> None:
    """It has a prior of its own along one line of sight only; the rest of the prior is untouched."""
    plain, disturbed = window_of(5), window_of(5)
    for window in (plain, disturbed):
        window.solve()
        window.drop_oldest()
    loose = add_loose(disturbed, *very_far())
    key, landmark = factors.landmark_key(loose), disturbed.landmarks[loose]
    assert landmark.point_world is not None
    values = gtsam.Values(disturbed.values)
    values.insert(key, landmark.point_world)
    pose = factors.pose_key(1)
    across = np.diag([1.0, 1.0, 0.0])
    linear = gtsam.JacobianFactor(key, across, pose, np.zeros((3, 6)), np.zeros(3), gtsam.noiseModel.Unit.Create(3))
    disturbed.prior.append(Term(gtsam.LinearContainerFactor(linear, values), (key, pose)))
    landmark.is_in_prior = True
    landmark.observations.clear()
    plain.solve()
    assert disturbed.solve().dropped == 1
    assert all(key not in term.keys for term in disturbed.prior)
    np.testing.assert_allclose(poses_of(disturbed), poses_of(plain), atol=1e-8)


def test_a_keyframe_that_is_not_determined_is_an_error_and_no_landmark_is_dropped() -> None:
    window = window_of(3)
    both = [landmark for _, landmark in window.landmarks.items() if 2 in landmark.observations]
    for landmark in both[1:]:
        del landmark.observations[2]
    count = len(window.landmarks)
    with pytest.raises(SmootherError, match="Indeterminate"):
        window.solve()
    assert len(window.landmarks) == count


def linear_point(axes: tuple[float, float, float], seed: int = 5) -> tuple[gtsam.GaussianFactorGraph, int]:
    """One point whose information has these eigenvalues."""
    turn = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
    key = factors.landmark_key(7)
    graph = gtsam.GaussianFactorGraph()
    graph.push_back(gtsam.HessianFactor(key, turn @ np.diag(axes) @ turn.T, np.zeros(3), 0.0))
    return graph, key


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
@pytest.mark.parametrize(("share", "is_loose"), [(2.0**-20, False), (2.0**-28, True)])
def test_the_limit_is_that_of_gtsam_and_a_support_is_above_it(scale: float, share: float, is_loose: bool) -> None:
    graph, key = linear_point((scale, 0.5 * scale, share * scale))
    assert indeterminate_points(graph, [key]) == ([key] if is_loose else [])
    if is_loose:
        with pytest.raises(RuntimeError, match="Indeterminate"):
            graph.eliminateSequential(factors.ordered([key]))
    for factor in supports(graph, [key]):
        graph.push_back(factor)
    graph.eliminateSequential(factors.ordered([key]))


def test_the_variable_that_gtsam_names_is_found_even_if_its_own_information_suffices() -> None:
    graph, key = linear_point((1.0, 1.0, 1.0))
    named = RuntimeError(f"\nIndeterminate linear system detected while working near variable\n{key} (Symbol: l7).")
    assert indeterminate_points(graph, [key], named) == [key]
    assert indeterminate_points(graph, [key], RuntimeError("another")) == []


def test_marginalisation_keeps_what_a_loose_landmark_does_not_concern() -> None:
    """Two poses with a known motion between them, and a point that one of them sees with its left camera only."""
    pose, noise = np.eye(4), np.diag(np.full(6, 0.01))
    point = se3.apply(RIG.T_body_camera, np.array([0.2, 0.1, 3.0]))
    key = factors.landmark_key(0)
    seen = ObservationFactors(RIG, PLAIN).make(0, 0, np.array([346.0, 254.0, np.nan]), is_first=True)
    motion = factors.relative_pose(0, 1, pose, noise)
    first = factors.pose_prior(0, pose, noise)
    values = gtsam.Values()
    values.insert(key, point)
    for number in range(2):
        values.insert(factors.pose_key(number), gtsam.Pose3())
    kept = marginal_prior([seen, motion, first], [key, factors.pose_key(0)], values)
    assert {each for term in kept for each in term.keys} == {factors.pose_key(1)}
    linear = gtsam.GaussianFactorGraph()
    for term in kept:
        linear.push_back(term.factor.linearize(values))
    information = linear.hessian(factors.ordered([factors.pose_key(1)]))[0]
    np.testing.assert_allclose(information, np.linalg.inv(2 * noise), rtol=2e-3, atol=0.1)


def test_many_dropped_landmarks_are_an_event_a_few_are_counted() -> None:
    log = EventLog()
    log.add_dropped(1, 0, 5)
    log.add_dropped(2, 3, 2)
    log.add_dropped(3, 20, 30)
    assert log.take()[0] == ()
    log.add_dropped(4, 20, 12)
    (event,), _ = log.take()
    assert (event.stamp_ns, event.kind) == (4, "many_landmarks_dropped")
    assert log.counts == {"landmarks_dropped": 43, "many_landmarks_dropped": 1}


def motorway(seed: int, speed_mps: float = 25.0) -> Iterator[StereoTracks]:
    """Six seconds straight ahead; points with a disparity below 3 px have no match in the right image."""
    random = np.random.default_rng(seed)
    length = 60 * speed_mps * 0.1
    near = random.uniform((0.0, -20.0, -2.0), (length + 60.0, 20.0, 6.0), (round(3 * length), 3))
    far = random.uniform((length + 200.0, -150.0, -30.0), (length + 600.0, 150.0, 60.0), (40, 3))
    world = World(np.vstack((near, far)))
    for frame in range(60):
        T_world_body = se3.transform(np.eye(3), np.array([speed_mps * 0.1 * frame, 0.0, 0.0]))
        points = se3.apply(se3.inverse(T_world_body @ RIG.T_body_camera), world.points)
        ahead = np.flatnonzero(points[:, 2] > 3.0)
        left_px, disparity = RIG.pixels(points[ahead])
        inside = ((left_px > 0.0) & (left_px < [640.0, 480.0])).all(axis=1)
        noise = 0.5 * np.random.default_rng((seed, frame)).standard_normal((int(inside.sum()), 3))
        left_px, disparity = left_px[inside] + noise[:, :2], disparity[inside] + noise[:, 2]
        right_px = left_px - np.column_stack((disparity, np.zeros(len(disparity))))
        right_px[disparity < 3.0] = np.nan
        yield StereoTracks(frame * FRAME_NS, ahead[inside], left_px, right_px)


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 2, 5])
def test_on_a_motorway_with_distant_points_the_window_never_starts_anew(seed: int) -> None:
    """With a baseline of 10 cm most points have no disparity, and many of them lie near the epipole."""
    smoother = SlidingWindowSmoother(RIG, None, None)
    kinds = []
    for tracks in motorway(seed):
        result = smoother.push_tracks(tracks)
        kinds += [event.kind for event in result.events]
    assert smoother.counts["landmarks_dropped"] > 0
    assert not {"window_restart", "solver_failed"}.intersection(kinds)


def window_of_two(sigma_m: float) -> Window:
    """Two keyframes that share a single point; their relative pose is known to ``sigma_m`` and a fifth of it in rad."""
    window, tracks = Window(RIG, CONFIG), frames(WALK, [STAMPS[0], STAMPS[1]], scattered(count=200))
    common = sorted({*tracks[0].track_ids.tolist()} & {*tracks[1].track_ids.tolist()})[0]
    for number, each in enumerate(tracks):
        index = np.flatnonzero(each.track_ids == common)
        left = each.left_px[index]
        right = each.right_px[index] if number == 0 else np.full((1, 2), np.nan)
        keyframe = Keyframe(number, each.stamp_ns, StereoTracks(each.stamp_ns, each.track_ids[index], left, right))
        if number == 1:
            covariance = np.diag(np.square(np.repeat([0.2 * sigma_m, sigma_m], 3)))
            T_start_end = se3.inverse(pose_at(WALK, STAMPS[0])) @ pose_at(WALK, STAMPS[1])
            keyframe.terms.append(relative_pose(0, 1, T_start_end, covariance))
        window.add(keyframe, pose_at(WALK, each.stamp_ns), np.zeros(1, dtype=np.bool_))
        if number == 0:
            window.fix_first(1e-8 * np.eye(6))
    return window


def test_a_pose_that_is_hardly_determined_gets_a_weak_prior_where_it_is() -> None:
    window = window_of_two(1e4)
    solution = window.solve()
    assert (solution.supported, solution.dropped) == (1, 0)
    assert np.abs(se3.log(se3.inverse(pose_at(WALK, STAMPS[1])) @ window.pose(1))).max() < 1e-6
    sigmas = np.sqrt(np.diag(solution.covariance))
    assert sigmas[3:].max() > 0.5
    assert window.solve().supported == 0


def test_a_pose_that_is_determined_gets_no_prior() -> None:
    assert window_of_two(1.0).solve().supported == 0

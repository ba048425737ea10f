# SPDX-License-Identifier: BSD-3-Clause
"""The compiled solver of the window against GTSAM: normal equations, minima, covariances, what it leaves to it."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from worlds import (
    CHEAP_IMU,
    FRAME_NS,
    IMU,
    RIG,
    WALK,
    frames,
    in_order,
    play,
    pose_at,
    readings,
    scattered,
    sources_of,
    stamps_ns,
)

from coclo_vio.backend.window import window_solver
from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.factors import landmark_key, ordered, pose_key, relative_pose
from coclo_vio.backend.window.keyframe import Keyframe
from coclo_vio.backend.window.observation_table import ObservationTable
from coclo_vio.backend.window.reprojection_kernels import reprojection_cost
from coclo_vio.backend.window.schur import WindowMinimum, WindowProblem
from coclo_vio.backend.window.schur_kernels import factorised, is_determined
from coclo_vio.backend.window.smoother import SlidingWindowSmoother
from coclo_vio.backend.window.window import Window
from coclo_vio.geometry import se3
from coclo_vio.geometry.compiled import IS_COMPILED
from coclo_vio.values.arrays import Array

pytestmark = pytest.mark.skipif(not IS_COMPILED, reason="numba is not installed: GTSAM solves every window")

CONFIG = SmootherConfig(spacing_px=0.0)
STAMPS = range(1_500_000_000, 4_500_000_000, 3 * FRAME_NS)


def disturbed_window(seed: int, longest: int = 6) -> Window:
    """Keyframes of the walk, older ones marginalised; half of the landmarks without, and some with wrong disparities.

    Then its poses and points are disturbed, and a few points are put behind the cameras.
    """
    random, window = np.random.default_rng(seed), Window(RIG, CONFIG)
    for number, tracks in enumerate(frames(WALK, STAMPS, scattered(count=900), noise_px=0.4)):
        right_px = tracks.right_px.copy()
        right_px[(tracks.track_ids + number) % 4 == 0] = np.nan
        right_px[tracks.track_ids % 17 == 0, 0] += 4.0
        keyframe = Keyframe(number, tracks.stamp_ns, replace(tracks, right_px=right_px))
        window.add(keyframe, pose_at(WALK, keyframe.stamp_ns), np.zeros(len(tracks), dtype=np.bool_))
        if number == 0:
            window.fix_first(1e-8 * np.eye(6))
        if number > longest:
            window.solve()
            window.drop_oldest()
    for keyframe in window.keyframes[1:]:
        off = se3.exp(0.01 * random.standard_normal(6))
        window.values.update(pose_key(keyframe.number), gtsam.Pose3(window.pose(keyframe.number) @ off))
    for _, landmark in window.landmarks.items():
        if landmark.point_world is not None:
            landmark.point_world = landmark.point_world + 0.02 * random.standard_normal(3)
    return window


def behind(window: Window, count: int) -> None:
    """Put some points of several observations behind the camera of one keyframe, where it observes nothing of them."""
    placed = [each for _, each in window.landmarks.items() if each.is_solvable and len(each.observations) > 3]
    for landmark in placed[:count]:
        pose = window.pose(min(landmark.observations)) @ RIG.T_body_camera
        landmark.point_world = pose[:3, 3] - 0.05 * pose[:3, 2]


def problem_of(window: Window) -> WindowProblem:
    """Everything that ``solve`` solves for."""
    return window.problem([each for each, landmark in window.landmarks.items() if landmark.is_solvable])


def groups_of(problem: WindowProblem) -> list[list[int]]:
    """The newest pose, the one after the oldest, and two of those between them."""
    poses = list(problem.pose_keys)
    return [poses[-1:], poses[1:2], poses[2:4]]


def by_ours(window: Window, problem: WindowProblem, **limits: float) -> WindowMinimum | None:
    most, tolerance = int(limits.get("most_iterations", 6)), limits.get("tolerance", 1e-4)
    return window.solver.schur.minimise(problem, groups_of(problem), most_iterations=most, tolerance=tolerance)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("count_behind", [0, 5])
def test_cost_and_one_step_are_those_of_gtsam(seed: int, count_behind: int) -> None:
    """With stereo and left-only observations, first and repeated disparities, wrong ones, and points of the prior."""
    window = disturbed_window(seed)
    behind(window, count_behind)
    problem = problem_of(window)
    assert problem.kept > 10
    assert np.isnan(problem.table.pixels[:, 2]).sum() > 10
    assert 0 < problem.table.is_first.sum() < len(problem.table) / 2
    run = window.solver.schur.run(problem)
    values, ids = problem.all_values(), problem.table.landmark_ids
    graph = window.solver.graph(problem)
    assert run.cost(problem.values, problem.points) == pytest.approx(graph.error(values), rel=1e-12)
    step, linear = run.step(problem.values, problem.points), graph.linearize(values)
    assert step is not None
    net = linear.eliminateSequential(ordered(problem.elimination))
    expected = net.optimize()
    ours = np.concatenate([step.points.ravel(), step.keys[3 * problem.kept :]])
    theirs = np.concatenate([expected.at(key) for key in (*map(landmark_key, ids), *problem.keys[problem.kept :])])
    np.testing.assert_allclose(ours, theirs, atol=1e-9 * np.abs(theirs).max())
    decrease = linear.error(values.zeroVectors()) - linear.error(expected)
    assert step.predicted == pytest.approx(decrease, rel=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_the_reduced_information_is_that_of_gtsam(seed: int) -> None:
    window = disturbed_window(seed)
    problem = problem_of(window)
    step = window.solver.schur.run(problem).step(problem.values, problem.points)
    assert step is not None
    ids = problem.table.landmark_ids
    free = [landmark_key(each) for each in ids[: len(ids) - problem.kept]]
    linear = window.solver.graph(problem).linearize(problem.all_values())
    remaining = linear.eliminatePartialSequential(ordered(free))[1]
    expected = remaining.hessian(ordered(problem.keys))[0]
    root = np.tril(step.root)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(root @ root.T / scale, expected / scale, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_the_minimum_is_that_of_gtsam(seed: int) -> None:
    window = disturbed_window(seed)
    problem = problem_of(window)
    found = by_ours(window, problem)
    expected = window.solver.minimum_by_gtsam(problem, groups_of(problem))
    assert found is not None
    assert found.iterations == expected.iterations > 1
    for key in problem.pose_keys:
        ours, theirs = (np.asarray(each.values.atPose3(key).matrix()) for each in (found, expected))
        np.testing.assert_allclose(ours, theirs, atol=1e-9)
    np.testing.assert_allclose(found.points, expected.points, atol=1e-9 * np.abs(expected.points).max())
    for ours, theirs in zip(found.covariances, expected.covariances, strict=True):
        sigmas = np.sqrt(np.diag(theirs))
        scale = np.outer(sigmas, sigmas)
        np.testing.assert_allclose(ours / scale, theirs / scale, atol=1e-8)


@pytest.mark.parametrize("seed", range(4))
def test_the_evidence_of_keyframes_is_that_of_gtsam(seed: int) -> None:
    """With and without a relative motion between them, after which only landmarks tie the newest one."""
    window = disturbed_window(seed)
    before, newest = (keyframe.number for keyframe in window.keyframes[-2:])
    motion = relative_pose(before, newest, se3.exp(0.1 * np.ones(6)), 1e-4 * np.eye(6))
    window.newest.terms.append(motion)
    window.solve()
    for numbers, without in (((before, newest), ()), ((before, newest), (motion,)), ((newest,), ())):
        problem = window.problem(window.solved_landmarks, without, [pose_key(number) for number in numbers])
        ours, theirs = window.evidence(numbers, without), window.solver.evidence_by_gtsam(problem, len(numbers))
        scale = np.sqrt(np.outer(np.diag(theirs[0]), np.diag(theirs[0])))
        np.testing.assert_allclose(ours[0] / scale, theirs[0] / scale, atol=1e-9)
        np.testing.assert_allclose(
            ours[1] / np.sqrt(np.diag(theirs[0])), theirs[1] / np.sqrt(np.diag(theirs[0])), atol=1e-7
        )


@pytest.mark.parametrize("has_imu", [True, False], ids=["vins", "stereo"])
def test_a_walk_is_the_same_as_by_gtsam(monkeypatch: pytest.MonkeyPatch, has_imu: bool) -> None:
    """Compared to the rounding of the numbers that one window leaves to the next, which grows along the way."""
    stamps = stamps_ns(0.0, 3.0, FRAME_NS)
    inertial = readings(WALK, stamps_ns(-0.5, 3.0, 5_000_000), errors=CHEAP_IMU) if has_imu else ()
    measurements = in_order(frames(WALK, stamps, scattered(count=600), noise_px=0.3), inertial)
    ours = play(SlidingWindowSmoother(RIG, None, IMU, sources_of(has_imu)), measurements)
    monkeypatch.setattr(window_solver, "IS_COMPILED", False)
    theirs = play(SlidingWindowSmoother(RIG, None, IMU, sources_of(has_imu)), measurements)
    assert ours.counts == theirs.counts
    assert [each.iterations for each in ours.health] == [each.iterations for each in theirs.health]
    for stamp, estimate in theirs.estimates.items():
        if estimate is not None:
            np.testing.assert_allclose(ours.estimates[stamp].nav.T_world_body, estimate.nav.T_world_body, atol=1e-9)


def test_a_landmark_that_is_not_determined_is_left_to_gtsam() -> None:
    window = disturbed_window(0)
    landmark = next(each for _, each in window.landmarks.items() if each.is_solvable and not each.is_in_prior)
    number = max(landmark.observations)
    landmark.observations = {number: np.array([*landmark.observations[number][:2], np.nan]), number - 1: np.zeros(3)}
    pose = window.pose(number - 1) @ RIG.T_body_camera
    landmark.point_world = pose[:3, 3] - 3.0 * pose[:3, 2]
    assert by_ours(window, problem_of(window)) is None
    assert window.solve().dropped <= 1


def test_a_step_that_no_share_of_lowers_the_cost_is_left_to_gtsam(monkeypatch: pytest.MonkeyPatch) -> None:
    window = disturbed_window(0)
    problem = problem_of(window)
    assert by_ours(window, problem) is not None
    monkeypatch.setattr("coclo_vio.backend.window.schur.is_lower", lambda proposed, cost: False)
    assert by_ours(window, problem) is None


def test_the_number_of_iterations_is_bounded() -> None:
    window = disturbed_window(1)
    found = by_ours(window, problem_of(window), most_iterations=2, tolerance=0.0)
    assert found is not None
    assert found.iterations == 2


def turned(axes: tuple[float, ...], seed: int) -> Array:
    turn = np.linalg.qr(np.random.default_rng(seed).standard_normal((len(axes), len(axes))))[0]
    information: Array = turn @ np.diag(axes) @ turn.T
    return 0.5 * (information + information.T)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("share", [1e-5, 1e-7, 1e-8, 1e-9, 1e-10, 0.0])
def test_a_point_is_determined_where_gtsam_eliminates_it(share: float, seed: int) -> None:
    information = 1e4 * turned((1.0, 0.7, share), seed)
    graph = gtsam.GaussianFactorGraph()
    graph.push_back(gtsam.HessianFactor(0, information, np.ones(3), 0.0))
    try:
        graph.eliminateSequential(ordered([0]))
        expected = True
    except RuntimeError:
        expected = False
    root, vector = information.copy(), np.ones(3)
    assert factorised(root, vector) == expected
    if expected:
        np.testing.assert_allclose(np.tril(root), np.linalg.cholesky(information), rtol=1e-7)
        np.testing.assert_allclose(np.tril(root) @ vector, 1.0, rtol=1e-6)
        assert is_determined(np.linalg.cholesky(information), np.array([0, 3]))
        assert is_determined(np.linalg.cholesky(turned((1.0, 1.0, share), seed)), np.array([0, 1, 2, 3]))


def test_the_cost_of_no_observation_is_zero() -> None:
    nothing = np.zeros(0, dtype=np.int64)
    observed = (nothing, nothing, np.zeros((0, 3)), np.zeros((0, 2)))
    camera = (np.eye(4), np.ones(5), 1.5)
    assert reprojection_cost(np.zeros((0, 3)), observed, np.zeros((0, 4, 4)), camera) == 0.0


def test_the_table_has_the_observations_of_each_landmark_together() -> None:
    window = disturbed_window(0)
    landmarks = dict(window.landmarks.items())
    numbers = [keyframe.number for keyframe in window.keyframes]
    table = ObservationTable.of(landmarks, numbers)
    assert table.starts[-1] == len(table) == sum(len(each.observations) for each in landmarks.values())
    for index, (landmark_id, landmark) in enumerate(landmarks.items()):
        rows = range(table.starts[index], table.starts[index + 1])
        assert table.landmark_ids[index] == landmark_id
        assert [numbers[table.keyframe[row]] for row in rows] == list(landmark.observations)
        for row, (number, pixels) in zip(rows, landmark.observations.items(), strict=True):
            assert table.landmark[row] == index
            assert table.is_first[row] == (landmark.depth_keyframe == number)
            np.testing.assert_array_equal(table.pixels[row], pixels)
    empty = ObservationTable.of({}, numbers)
    assert (len(empty), empty.starts.tolist()) == (0, [0])

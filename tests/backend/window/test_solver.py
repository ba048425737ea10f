# SPDX-License-Identifier: BSD-3-Clause
"""Minima known by hand, covariances against GTSAM's own, and problems without a solution."""

import gtsam
import numpy as np
import pytest
from worlds import RIG, WALK, frames, pose_at, scattered

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.config import PixelNoiseConfig
from coclo_vio.backend.window.factors import ObservationFactors, ordered
from coclo_vio.backend.window.solver import Minimum, minimise
from coclo_vio.backend.window.stereo_model import StereoModel
from coclo_vio.geometry import se3
from coclo_vio.values.errors import SmootherError

POINT_IN_CAMERA = np.array([0.2, -0.1, 3.0])
POINT = se3.apply(RIG.T_body_camera, POINT_IN_CAMERA)


def unit(size: int, sigma: float) -> gtsam.noiseModel.Isotropic:
    return gtsam.noiseModel.Isotropic.Sigma(size, sigma)


def graph_of(*terms: object) -> gtsam.NonlinearFactorGraph:
    graph = gtsam.NonlinearFactorGraph()
    for term in terms:
        graph.push_back(term)
    return graph


def vectors(*values: float) -> gtsam.Values:
    holds = gtsam.Values()
    for key, value in enumerate(values):
        holds.insert(key, np.array([value]))
    return holds


def test_the_minimum_of_a_chain_is_the_one_by_hand() -> None:
    """x0 = 0 +- 1, x1 - x0 = 10 +- 2, x1 = 13 +- 2: x1 = (10/5 + 13/4) / (1/5 + 1/4), P = 20/9."""
    graph = graph_of(
        gtsam.PriorFactorVector(0, np.array([0.0]), unit(1, 1.0)),
        gtsam.BetweenFactorVector(0, 1, np.array([10.0]), unit(1, 2.0)),
        gtsam.PriorFactorVector(1, np.array([13.0]), unit(1, 2.0)),
    )
    found = minimise(graph, vectors(-50.0, 70.0), [0, 1], 1, most_iterations=10, tolerance=1e-9)
    assert found.values.atVector(1)[0] == pytest.approx((10 / 5 + 13 / 4) / (1 / 5 + 1 / 4))
    assert found.covariance[0, 0] == pytest.approx(20 / 9)
    assert found.iterations == 1  # linear: the first step reaches it, as predicted


def poses_problem(disturbed: float) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values, list[int], list[np.ndarray]]:
    """Three frames of the walk and their observations, with the initial values off by about ``disturbed``."""
    world, observations = scattered(), ObservationFactors(RIG, PixelNoiseConfig(huber=50.0))
    stamps = [3_000_000_000, 3_300_000_000, 3_600_000_000]
    truth = [pose_at(WALK, stamp) for stamp in stamps]
    tracked = frames(WALK, stamps, world)
    common = sorted(set.intersection(*({*tracks.track_ids.tolist()} for tracks in tracked)))[:40]
    random = np.random.default_rng(8)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.push_back(factors.pose_prior(0, truth[0], np.eye(6) * 1e-6).factor)
    for number, tracks in enumerate(tracked):
        off = se3.exp(disturbed * random.standard_normal(6)) if number else np.eye(4)
        values.insert(factors.pose_key(number), gtsam.Pose3(truth[number] @ off))
        for row in np.flatnonzero(np.isin(tracks.track_ids, common)):
            observation = np.array([*tracks.left_px[row], tracks.right_px[row, 0]])
            graph.push_back(
                observations.make(number, int(tracks.track_ids[row]), observation, is_first=number == 0).factor
            )
    for each in common:
        values.insert(factors.landmark_key(each), world.points[each] + disturbed * random.standard_normal(3))
    keys = [factors.landmark_key(each) for each in common] + [factors.pose_key(number) for number in range(3)]
    return graph, values, keys, truth


def one_point(times: float) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values, list[int]]:
    """A point 3 m ahead in one stereo pair, whose initial value is ``times`` as far."""
    observation = StereoModel(RIG, PixelNoiseConfig()).project(np.eye(4), POINT[None])[0]
    graph = graph_of(
        factors.pose_prior(0, np.eye(4), np.eye(6) * 1e-4).factor,
        ObservationFactors(RIG, PixelNoiseConfig(huber=50.0)).make(0, 0, observation, is_first=True).factor,
    )
    values = gtsam.Values()
    values.insert(factors.pose_key(0), gtsam.Pose3())
    values.insert(factors.landmark_key(0), se3.apply(RIG.T_body_camera, times * POINT_IN_CAMERA))
    return graph, values, [factors.landmark_key(0), factors.pose_key(0)]


def pose_errors(found: Minimum, truth: list[np.ndarray]) -> float:
    return max(
        np.abs(se3.log(se3.inverse(each) @ found.values.atPose3(factors.pose_key(number)).matrix())).max()
        for number, each in enumerate(truth)
    )


def test_covariances_are_those_of_gtsam() -> None:
    graph, values, keys, _ = poses_problem(0.02)
    found = minimise(graph, values, keys, 2, most_iterations=20, tolerance=0.0)
    marginals = gtsam.Marginals(graph, found.values)
    joint = marginals.jointMarginalCovariance(gtsam.KeyVector(keys[-2:])).fullMatrix()
    assert found.covariance.shape == (12, 12)
    np.testing.assert_allclose(found.covariance, joint, rtol=1e-6, atol=1e-9 * np.abs(joint).max())


def test_exact_observations_are_fitted_to_the_last_digits() -> None:
    graph, values, keys, truth = poses_problem(0.02)
    found = minimise(graph, values, keys, 1, most_iterations=20, tolerance=0.0)
    assert pose_errors(found, truth) < 1e-9


@pytest.mark.parametrize("times", [3.0, 30.0], ids=["a shorter step", "damping"])
def test_from_initial_values_where_full_steps_fail_the_minimum_is_reached(times: float) -> None:
    """The initial value is several times too far: by its disparity the first step ends behind the camera."""
    graph, values, keys = one_point(times)
    linear = graph.linearize(values)
    step = linear.eliminateSequential(ordered(keys)).optimize()
    assert graph.error(values.retract(step)) > graph.error(values)
    if times > 3.0:
        assert graph.error(values.retract(step.scale(0.05))) > graph.error(values)
    found = minimise(graph, values, keys, 1, most_iterations=60, tolerance=0.0)
    np.testing.assert_allclose(found.values.atPoint3(keys[0]), POINT, atol=1e-6)
    np.testing.assert_allclose(found.covariance, 1e-4 * np.eye(6), rtol=1e-6, atol=1e-10)


def test_a_problem_that_does_not_determine_its_variables_is_an_error_of_the_smoother() -> None:
    graph = graph_of(gtsam.BetweenFactorVector(0, 1, np.array([1.0]), unit(1, 1.0)))
    with pytest.raises(SmootherError, match="1 factors"):
        minimise(graph, vectors(0.0, 0.0), [0, 1], 1, most_iterations=5, tolerance=1e-4)


def test_a_point_behind_the_camera_without_another_factor_is_an_error_of_the_smoother() -> None:
    graph, values, keys = one_point(-1.0)
    with pytest.raises(SmootherError):
        minimise(graph, values, keys, 1, most_iterations=5, tolerance=1e-4)


def test_values_that_are_not_finite_are_an_error_of_the_smoother() -> None:
    graph = graph_of(gtsam.PriorFactorVector(0, np.array([np.nan]), unit(1, 1.0)))
    with pytest.raises(SmootherError):
        minimise(graph, vectors(0.0), [0], 1, most_iterations=5, tolerance=1e-4)


def test_iterations_are_bounded() -> None:
    graph, values, keys, _ = poses_problem(0.1)
    found = minimise(graph, values, keys, 1, most_iterations=2, tolerance=0.0)
    assert found.iterations <= 2
    assert graph.error(found.values) < graph.error(values)


def test_the_initial_values_are_not_changed() -> None:
    graph, values, keys, _ = poses_problem(0.02)
    before = gtsam.Values(values)
    minimise(graph, values, keys, 1, most_iterations=5, tolerance=1e-4)
    assert values.equals(before, 0.0)


def test_the_covariance_is_of_the_last_keys_where_the_variables_share_no_factor() -> None:
    """Elimination of three variables that share no factor comes out in any order."""
    sigmas = (0.1, 0.2, 0.3)
    graph = graph_of(*(gtsam.PriorFactorVector(key, np.array([0.0]), unit(1, sigmas[key])) for key in (2, 0, 1)))
    found = minimise(graph, vectors(1.0, 1.0, 1.0), [0, 1, 2], 2, most_iterations=3, tolerance=1e-9)
    np.testing.assert_allclose(found.covariance, np.diag(np.square(sigmas[1:])))


def test_the_message_on_an_indeterminate_problem_is_one_line() -> None:
    key = factors.pose_key(0)
    loose = gtsam.BetweenFactorVector(key, factors.pose_key(1), np.zeros(2), gtsam.noiseModel.Isotropic.Sigma(2, 1.0))
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.push_back(loose)
    for each in (key, factors.pose_key(1)):
        values.insert(each, np.zeros(2))
    with pytest.raises(SmootherError, match="Indeterminate linear system") as caught:
        minimise(graph, values, [key, factors.pose_key(1)], 1, most_iterations=3, tolerance=1e-6)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 200

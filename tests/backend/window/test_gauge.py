# SPDX-License-Identifier: BSD-3-Clause
"""The prior of the window holds no information on the position in the world, and the window does not drift."""

import gtsam
import numpy as np
import pytest

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.gauge import GlobalGauge, GravityGauge, HeldGauge
from coclo_vio.backend.window.marginalisation import removing_terms
from coclo_vio.backend.window.smoother import SlidingWindowSmoother
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.measurements import StereoTracks


def _turned(rng: np.random.Generator, scale: float) -> Array:
    return se3.exp(scale * rng.standard_normal(6))


def _spread(rng: np.random.Generator) -> Array:
    root = rng.standard_normal((6, 6))
    return np.asarray(0.01 * (root @ root.T + np.eye(6)))


def _linear(terms: list[factors.Term], values: gtsam.Values) -> gtsam.GaussianFactorGraph:
    graph = gtsam.GaussianFactorGraph()
    for term in terms:
        graph.push_back(term.factor.linearize(values))
    return graph


@pytest.mark.parametrize("directions", [6, 4])
def test_removed_information_leaves_the_rest_as_it_is_relative_to_the_pose(directions: int) -> None:
    rng = np.random.default_rng(3)
    poses = [_turned(rng, 0.5), _turned(rng, 0.5)]
    values = gtsam.Values()
    for number, pose in enumerate(poses):
        values.insert(factors.pose_key(number), gtsam.Pose3(pose))
    prior = [
        factors.pose_prior(0, poses[0] @ _turned(rng, 0.1), _spread(rng)),
        factors.pose_prior(1, poses[1] @ _turned(rng, 0.1), _spread(rng)),
        factors.relative_pose(0, 1, se3.inverse(poses[0]) @ poses[1] @ _turned(rng, 0.1), _spread(rng)),
    ]
    free = np.linalg.qr(rng.standard_normal((6, 6)))[0][:, :directions]

    graph = _linear([*prior, *removing_terms(prior, factors.pose_key(0), free, values)], values)

    keys = gtsam.Ordering()
    for key in (factors.pose_key(1), factors.pose_key(0)):
        keys.push_back(key)
    before, vector_before = _linear(prior, values).hessian(keys)
    after, vector_after = graph.hessian(keys)
    across = np.eye(12)
    across[6:, 6:] = np.eye(6) - free @ free.T
    np.testing.assert_allclose(across @ after @ across, across @ before @ across, atol=1e-6)
    np.testing.assert_allclose(across @ vector_after, across @ vector_before, atol=1e-6)
    others = np.linalg.qr(free, mode="complete")[0][:, directions:]
    turn = np.zeros((12, 12))
    turn[:6, :6], turn[6:, 6:] = np.eye(6), np.column_stack((others, free))
    after, vector_after, size = turn.T @ after @ turn, turn.T @ vector_after, 12 - directions
    gain = np.linalg.solve(after[:size, :size], np.column_stack((after[:size, size:], vector_after[:size])))
    np.testing.assert_allclose(after[size:, size:], after[size:, :size] @ gain[:, :-1], atol=1e-4)
    np.testing.assert_allclose(vector_after[size:], after[size:, :size] @ gain[:, -1], atol=1e-4)


def test_of_a_prior_on_the_pose_alone_all_information_is_removed() -> None:
    """Nothing else stays in the window: there is no rest to solve for."""
    values = gtsam.Values()
    values.insert(factors.pose_key(0), gtsam.Pose3())
    prior = [factors.pose_prior(0, np.eye(4), np.eye(6))]
    terms = removing_terms(prior, factors.pose_key(0), np.eye(6), values)
    keys = gtsam.Ordering()
    keys.push_back(factors.pose_key(0))
    np.testing.assert_allclose(_linear([*prior, *terms], values).hessian(keys)[0], np.zeros((6, 6)), atol=1e-12)


def test_nothing_is_removed_from_a_prior_without_the_pose() -> None:
    values = gtsam.Values()
    values.insert(factors.pose_key(1), gtsam.Pose3())
    prior = [factors.pose_prior(1, np.eye(4), np.eye(6))]
    assert removing_terms(prior, factors.pose_key(0), np.eye(6), values) == []


def _drive(frames: int, rng: np.random.Generator) -> list[StereoTracks]:
    """Tracks of a drive along a far facade on one side; each disparity has a constant error."""
    T_body_camera = np.eye(4)
    T_body_camera[:3, :3] = [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    rig = RectifiedStereo((700.0, 700.0), (600.0, 180.0), 0.5, T_body_camera)
    count = 1500
    points = np.column_stack(
        (rng.uniform(0.0, frames + 60.0, count), rng.uniform(-16.0, -12.0, count), rng.uniform(0.0, 8.0, count))
    )
    bias = rng.standard_normal(count)
    tracks = []
    for number in range(frames):
        T_world_body = np.eye(4)
        T_world_body[0, 3] = number
        camera = se3.apply(se3.inverse(T_world_body @ T_body_camera), points)
        ahead = camera[:, 2] > 5.0
        left, disparity = rig.pixels(np.where(ahead[:, None], camera, [0.0, 0.0, 1.0]))
        inside = (camera[:, 2] < 60.0) & (left[:, 0] < 1200.0) & (left[:, 1] > 0.0)
        ids = np.flatnonzero(ahead & inside)[:60]
        left_px = left[ids] + 0.4 * rng.standard_normal((len(ids), 2))
        right_px = left_px - np.column_stack((disparity[ids] + bias[ids], np.zeros(len(ids))))
        tracks.append(StereoTracks(number * 100_000_000, ids, left_px, right_px))
    return tracks


def _smoother() -> SlidingWindowSmoother:
    T_body_camera = np.eye(4)
    T_body_camera[:3, :3] = [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    rig = RectifiedStereo((700.0, 700.0), (600.0, 180.0), 0.5, T_body_camera)
    config = SmootherConfig(noise={"track_px": 0.4, "disparity_px": 1.0, "repeated_disparity_px": 3.0})
    return SlidingWindowSmoother(rig, config)


def test_the_prior_holds_no_information_on_the_oldest_keyframe() -> None:
    smoother = _smoother()
    for frame in _drive(40, np.random.default_rng(1)):
        smoother.push_tracks(frame)
    window = smoother._updater.window
    assert window is not None
    values = gtsam.Values(window.values)
    for landmark_id, landmark in window.landmarks.items():
        if landmark.is_in_prior:
            values.insert(factors.landmark_key(landmark_id), landmark.point_world)
    oldest = factors.pose_key(window.keyframes[0].number)
    keys = gtsam.Ordering()
    for key in [*sorted({key for term in window.prior for key in term.keys} - {oldest}), oldest]:
        keys.push_back(key)
    information, _ = _linear(window.prior, values).hessian(keys)
    cross = information[-6:, :-6]
    alone = information[-6:, -6:] - cross @ np.linalg.pinv(information[:-6, :-6], hermitian=True) @ cross.T
    np.testing.assert_allclose(alone, np.zeros((6, 6)), atol=1.0)  # 1 rad and 1 m at the least


def test_the_reported_uncertainty_grows_along_the_path() -> None:
    smoother = _smoother()
    sizes = []
    for frame in _drive(90, np.random.default_rng(2)):
        estimate = smoother.push_tracks(frame).estimate
        assert estimate is not None
        sizes.append(float(np.trace(estimate.covariance[3:6, 3:6])))
    assert min(sizes[70:]) > 1.5 * min(sizes[20:40])


POSE_AT = se3.exp(np.array([0.1, -0.2, 0.7, 1.0, 2.0, 0.3]))
COVARIANCE = np.diag(np.square([0.01, 0.02, 0.03, 0.1, 0.2, 0.3]))


def _values(number: int) -> gtsam.Values:
    values = gtsam.Values()
    values.insert(factors.pose_key(number), gtsam.Pose3(POSE_AT))
    return values


def _information(terms: list[factors.Term]) -> Array:
    return sum((term.factor.linearize(_values(3)).information() for term in terms), np.zeros((6, 6)))


def test_without_gravity_the_whole_pose_is_held() -> None:
    gauge = HeldGauge()
    prior, free = gauge.begin(3, POSE_AT, COVARIANCE)
    assert prior == []
    np.testing.assert_array_equal(free, np.zeros((6, 6)))
    np.testing.assert_allclose(gauge.covariance_at(POSE_AT, POSE_AT), COVARIANCE, atol=1e-15)
    assert gauge.term is not None
    np.testing.assert_allclose(_information([gauge.term]) / 1e8, np.eye(6), atol=1e-9)


def test_with_gravity_place_and_heading_are_held_and_the_tilt_has_a_prior() -> None:
    gauge = GravityGauge()
    prior, free = gauge.begin(3, POSE_AT, COVARIANCE)
    heading = POSE_AT[2, :3]
    assert gauge.term is not None
    held, known = _information([gauge.term]), _information(prior)
    assert heading @ held[:3, :3] @ heading == pytest.approx(1e8, rel=1e-3)
    np.testing.assert_allclose(held[3:, 3:] / 1e8, np.eye(3), atol=1e-9)
    across = np.linalg.svd(heading[None])[2][1:]
    assert np.abs(across @ held[:3, :3] @ across.T).max() < 1.0
    np.testing.assert_allclose(
        np.linalg.inv(across @ known[:3, :3] @ across.T), across @ COVARIANCE[:3, :3] @ across.T, rtol=1e-6
    )
    np.testing.assert_allclose(free + gauge.covariance, COVARIANCE, atol=1e-15)


def test_of_a_given_start_nothing_is_held() -> None:
    gauge = GlobalGauge()
    prior, free = gauge.begin(3, POSE_AT, COVARIANCE)
    np.testing.assert_allclose(np.linalg.inv(_information(prior)), COVARIANCE, rtol=1e-9, atol=1e-15)
    np.testing.assert_array_equal(free, COVARIANCE)
    assert gauge.term is None
    assert gauge.pass_on(3, POSE_AT, COVARIANCE, prior, _values(3)) == []
    assert not gauge.covariance_at(POSE_AT, np.eye(4)).any()


@pytest.mark.parametrize("policy", [HeldGauge, GravityGauge, GlobalGauge])
def test_a_keyframe_whose_past_is_dropped_keeps_its_uncertainty(
    policy: type[HeldGauge] | type[GlobalGauge],
) -> None:
    gauge = policy()
    prior = gauge.replace(3, POSE_AT, 4.0 * COVARIANCE * (policy is not GlobalGauge), COVARIANCE)
    if policy is GlobalGauge:
        np.testing.assert_allclose(np.linalg.inv(_information(prior)), COVARIANCE, rtol=1e-9, atol=1e-15)
    else:
        np.testing.assert_allclose(gauge.covariance_at(POSE_AT, POSE_AT)[3:, 3:], 5.0 * COVARIANCE[3:, 3:], atol=1e-12)

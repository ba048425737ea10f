# SPDX-License-Identifier: BSD-3-Clause
"""Marginals and evidence of keyframes, and a window with a given start."""

from itertools import pairwise

import gtsam
import numpy as np
import pytest
import worlds

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.config import PixelNoiseConfig, SmootherConfig
from coclo_vio.backend.window.keyframe_marginals import newest_marginal, pair_evidence
from coclo_vio.backend.window.smoother import SlidingWindowSmoother
from coclo_vio.backend.window.window import Window
from coclo_vio.geometry import se3
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.keyframes import KeyframeResult, OdometryDelta, PoseMarginal

WALK = BodyMotionConfig(rest_s=0.0, walk_s=12.0, stop_s=0.0, speed_mps=0.4, curvature_per_m=0.2)
ODOMETRY = np.diag([2e-3] * 3 + [4e-3] * 3) ** 2
START = PoseMarginal(100_000_000, worlds.pose_at(WALK, 100_000_000), np.zeros((6, 6)))


def walked(seconds: float, *, has_start: bool = True) -> tuple[SlidingWindowSmoother, list[KeyframeResult]]:
    """A smoother after a walk of exact odometry and noisy tracks, and the results of its keyframes."""
    smoother = SlidingWindowSmoother(worlds.RIG, SmootherConfig(noise=PixelNoiseConfig(is_learnt=False)))
    if has_start:
        smoother.start_from(START)
    results: list[KeyframeResult] = []
    for stamp_ns in worlds.stamps_ns(0.1, seconds, worlds.FRAME_NS):
        before_ns = smoother.keyframe_ns
        tracks = worlds.scattered().observed_from(stamp_ns, worlds.pose_at(WALK, stamp_ns), noise_px=0.5)
        result = smoother.push_tracks(tracks, None if before_ns is None else odometry(before_ns, stamp_ns))
        assert (result.keyframe is not None) == (has_start and smoother.keyframe_ns != before_ns)
        if result.keyframe is not None:
            assert result.keyframe.marginal.stamp_ns == stamp_ns
            results.append(result.keyframe)
    return smoother, results


def odometry(start_ns: int, end_ns: int) -> OdometryDelta:
    T = se3.inverse(worlds.pose_at(WALK, start_ns)) @ worlds.pose_at(WALK, end_ns)
    return OdometryDelta(start_ns, end_ns, T, ODOMETRY)


def window_of(smoother: SlidingWindowSmoother) -> Window:
    return smoother._updater.started_window


def marginal_of_end(information: Array) -> Array:
    return np.asarray(np.linalg.inv(information)[6:, 6:])


def test_evidence_leaves_out_the_factors_of_the_odometry_and_nothing_else() -> None:
    smoother, _ = walked(2.5)
    window = window_of(smoother)
    assert 3 <= len(window.keyframes) < 10, "no keyframe has left the window yet"
    odometry_terms = window.newest.terms
    assert [type(term.factor).__name__ for term in odometry_terms] == ["BetweenFactorPose3"]
    without, with_odometry = pair_evidence(window, odometry_terms), pair_evidence(window, ())
    before, newest = (window.pose(each.number) for each in window.keyframes[-2:])
    jacobian = np.concatenate((-se3.adjoint(se3.inverse(newest) @ before), np.eye(6)), axis=1)
    information = jacobian.T @ np.linalg.inv(ODOMETRY) @ jacobian
    np.testing.assert_allclose(
        with_odometry.information - without.information, information, rtol=2e-2, atol=1e-3 * information.max()
    )


def test_the_marginal_of_a_keyframe_is_that_of_the_evidence_of_the_pair() -> None:
    window = window_of(walked(2.5)[0])
    pair = pair_evidence(window, ())
    np.testing.assert_allclose(newest_marginal(window).covariance, marginal_of_end(pair.information), rtol=1e-6)


def test_each_keyframe_but_the_first_has_evidence_of_itself_and_the_one_before() -> None:
    _, results = walked(4.0)
    assert results[0].evidence is None
    for before, result in pairwise(results):
        assert result.evidence is not None
        assert (result.evidence.start_ns, result.evidence.end_ns) == (
            before.marginal.stamp_ns,
            result.marginal.stamp_ns,
        )


def test_a_window_with_a_given_start_is_consistent_with_it() -> None:
    marginals = [result.marginal for result in walked(11.5)[1]]
    assert len(marginals) > 25, "most keyframes have left the window"
    sizes = [float(np.sqrt(np.trace(each.covariance[3:, 3:]))) for each in marginals]
    assert sizes[-1] > 1.2 * sizes[5]
    errors = [se3.log(se3.inverse(worlds.pose_at(WALK, each.stamp_ns)) @ each.T_world_body) for each in marginals[1:]]
    squared = [
        error @ np.linalg.solve(each.covariance, error) for error, each in zip(errors, marginals[1:], strict=True)
    ]
    assert np.mean(squared) < 2.0 * 6
    assert np.linalg.norm(errors[-1][3:]) < 0.05


def test_evidence_of_other_times_is_refused_with_its_odometry() -> None:
    smoother, results = walked(2.5)
    stamp_ns = round(2.5e9)
    tracks = worlds.scattered().observed_from(stamp_ns, worlds.pose_at(WALK, stamp_ns))
    smoother.push_tracks(tracks, odometry(results[-2].marginal.stamp_ns, stamp_ns), results[-1].evidence)
    assert smoother.counts["odometry_refused"] == 1


def test_without_odometry_a_keyframe_has_a_marginal_and_no_evidence() -> None:
    smoother = SlidingWindowSmoother(worlds.RIG)
    smoother.start_from(START)
    results = []
    for stamp_ns in worlds.stamps_ns(0.1, 2.0, worlds.FRAME_NS):
        tracks = worlds.scattered().observed_from(stamp_ns, worlds.pose_at(WALK, stamp_ns))
        results.append(smoother.push_tracks(tracks).keyframe)
    keyframes = [result for result in results if result is not None]
    assert 1 < len(keyframes) < len(results)
    assert all(result.evidence is None for result in keyframes)


@pytest.mark.parametrize("has_start", [True, False])
def test_the_oldest_keyframe_is_fixed_only_where_no_start_was_given(*, has_start: bool) -> None:
    window = window_of(walked(6.0, has_start=has_start)[0])
    on_oldest = [
        term for term in window.problem([]).terms if term.keys == (factors.pose_key(window.keyframes[0].number),)
    ]
    sigma = 1e-4
    is_fixed = any(
        np.allclose(np.diag(term.factor.linearize(window.values).information()), sigma**-2, rtol=0.5)
        for term in on_oldest
        if type(term.factor).__name__ == "PriorFactorPose3"
    )
    assert is_fixed != has_start


def test_a_restart_is_as_uncertain_as_the_last_keyframe_and_the_motion_since(monkeypatch: pytest.MonkeyPatch) -> None:
    smoother, results = walked(3.0)
    last = results[-1].marginal

    def diverges(window: Window) -> None:
        window.values.update(factors.pose_key(window.newest.number), gtsam.Pose3(se3.exp(np.full(6, 50.0))))
        raise SmootherError("not determined")

    monkeypatch.setattr(Window, "solve", diverges)
    for stamp_ns in worlds.stamps_ns(3.0, 4.0, worlds.FRAME_NS):
        tracks = worlds.scattered().observed_from(stamp_ns, worlds.pose_at(WALK, stamp_ns), noise_px=0.5)
        result = smoother.push_tracks(tracks, odometry(last.stamp_ns, stamp_ns))
        if result.keyframe is not None:
            break
    assert [event.kind for event in result.events] == ["solver_failed", "window_restart"]
    assert result.keyframe is not None
    assert result.keyframe.evidence is None
    marginal = result.keyframe.marginal
    own, motion = np.trace(last.covariance[3:, 3:]), np.trace(ODOMETRY[3:, 3:])
    assert motion < np.trace(marginal.covariance[3:, 3:]) < 2.0 * (own + motion)
    error = se3.log(se3.inverse(worlds.pose_at(WALK, marginal.stamp_ns)) @ marginal.T_world_body)
    assert np.linalg.norm(error[3:]) < 0.05

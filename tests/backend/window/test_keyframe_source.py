# SPDX-License-Identifier: BSD-3-Clause
"""A source from outside: a variable of its own through a whole run; several sources at once; body twists."""

from collections.abc import Mapping, Sequence
from typing import Any

import gtsam
import numpy as np
import pytest
from worlds import (
    CHEAP_IMU,
    FRAME_NS,
    IMU,
    NS_PER_S,
    RIG,
    WALK,
    frames,
    in_order,
    play,
    pose_at,
    readings,
    scattered,
    stamps_ns,
)

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.factors import Term
from coclo_vio.backend.window.inertial_source import InertialSource
from coclo_vio.backend.window.keyframe_source import FirstKeyframe, KeyframeSource, KeyframeState, Ties
from coclo_vio.backend.window.motion_model import ConstantVelocityModel, PredictedMotion
from coclo_vio.backend.window.odometry_source import TwistSource
from coclo_vio.backend.window.smoother import SlidingWindowSmoother
from coclo_vio.backend.window.source_set import ExternalOdometry, SourceSet
from coclo_vio.backend.window.twist_odometry import TwistOdometry
from coclo_vio.backend.window.variables import POSE, VELOCITY, KeyframeVariables, Variable
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.keyframes import OdometryDelta
from coclo_vio.values.measurements import BodyTwistSample

LEG_SCALE = Variable("leg scale", "s", 1)
STEP, START_SIGMA, READ_SIGMA, TRUE_SCALE = 1e-3, 0.05, 0.02, 1.03
WORLD = scattered(count=600)


class ScaleSource(KeyframeSource):
    """Measures a scale at each keyframe, and nothing else; it hardly changes between keyframes."""

    def __init__(self) -> None:
        self.scale, self.sigma = 1.0, START_SIGMA

    @property
    def variables(self) -> Sequence[Variable]:
        return (LEG_SCALE,)

    def begin(self, number: int, stamp_ns: int, velocity_world: Array, velocity_sigma_mps: float) -> FirstKeyframe:
        value, variance = np.array([self.scale]), np.array([[self.sigma**2]])
        return FirstKeyframe({LEG_SCALE: value}, {LEG_SCALE: variance}, [self._prior(number, self.scale, self.sigma)])

    def ties(self, newest: KeyframeState, stamp_ns: int, motion: PredictedMotion) -> Ties:
        keys = LEG_SCALE.key(newest.number), LEG_SCALE.key(newest.number + 1)
        same = gtsam.BetweenFactorVector(*keys, np.zeros(1), gtsam.noiseModel.Isotropic.Sigma(1, STEP))
        return Ties([Term(same, keys), self._prior(newest.number + 1, TRUE_SCALE, READ_SIGMA)])

    def initial(self, motion: PredictedMotion) -> Mapping[Variable, Any]:
        return {LEG_SCALE: np.array([self.scale])}

    def update(self, newest: KeyframeState) -> None:
        self.scale, self.sigma = (
            float(newest.value(LEG_SCALE)[0]),
            float(np.sqrt(newest.covariance_of(LEG_SCALE)[0, 0])),
        )

    def priors(self, keyframe: KeyframeState) -> Sequence[Term]:
        return [self._prior(keyframe.number, self.scale, self.sigma)]

    @staticmethod
    def _prior(number: int, scale: float, sigma: float) -> Term:
        key = LEG_SCALE.key(number)
        noise = gtsam.noiseModel.Isotropic.Sigma(1, sigma)
        return Term(gtsam.PriorFactorVector(key, np.array([scale]), noise), (key,))


@pytest.mark.parametrize("has_imu", [True, False], ids=["vins", "stereo"])
def test_a_variable_of_a_new_source_needs_its_declaration_alone(has_imu: bool) -> None:
    """It is estimated as by a Kalman filter of its own, past marginalisation too, and changes no pose."""
    stamps, config = stamps_ns(0.0, 6.0, FRAME_NS), SmootherConfig(tolerance=0.0, iterations=10)
    inertial = readings(WALK, stamps_ns(-0.5, 6.0, 5_000_000), errors=CHEAP_IMU) if has_imu else ()
    measurements = in_order(frames(WALK, stamps, WORLD, noise_px=0.3), inertial)
    others = [InertialSource(IMU, config) for _ in range(2)] if has_imu else []
    source = ScaleSource()
    alone = play(SlidingWindowSmoother(RIG, config, IMU, others[:1]), measurements)
    smoother = SlidingWindowSmoother(RIG, config, IMU, [*others[1:], source])
    both = play(smoother, measurements)
    assert both.counts == alone.counts
    assert both.counts["keyframes"] > 1.5 * config.keyframes
    mean, variance = 1.0, START_SIGMA**2
    for _ in range(both.counts["keyframes"]):
        variance += STEP**2
        gain = variance / (variance + READ_SIGMA**2)
        mean, variance = mean + gain * (TRUE_SCALE - mean), (1.0 - gain) * variance
    assert source.scale == pytest.approx(mean, abs=1e-6)
    assert source.sigma == pytest.approx(np.sqrt(variance), rel=1e-3)
    for stamp, estimate in alone.estimates.items():
        other = both.estimates[stamp]
        assert (other is None) == (estimate is None)
        if estimate is not None and other is not None:
            np.testing.assert_allclose(other.nav.T_world_body, estimate.nav.T_world_body, atol=1e-7)
            assert other.covariance.shape == (9, 9)


class FixedMotion(KeyframeSource):
    """Measures, or does not measure, one motion."""

    def __init__(self, x_m: float | None) -> None:
        self.x_m = x_m

    def expect(self, newest: KeyframeState, stamp_ns: int, steady: PredictedMotion) -> PredictedMotion | None:
        if self.x_m is None:
            return None
        T = newest.T_world_body @ se3.exp(np.array([0.0, 0.0, 0.0, self.x_m, 0.0, 0.0]))
        return PredictedMotion(T, np.zeros(3), np.eye(6), np.zeros((3, 3)), is_measured=True)

    def ties(self, newest: KeyframeState, stamp_ns: int, motion: PredictedMotion) -> Ties:
        return Ties() if self.x_m is None else Ties([Term(None, (newest.number,))], has_motion=True)


def state_at_origin() -> KeyframeState:
    values = gtsam.Values()
    values.insert(POSE.key(0), gtsam.Pose3())
    return KeyframeState(0, 0, values, np.eye(9), KeyframeVariables())


@pytest.mark.parametrize(
    ("first", "second", "expected", "ties"),
    [(1.0, 2.0, 1.0, 2), (None, 2.0, 2.0, 1), (None, None, 0.0, 1)],
    ids=["both", "the second one", "none: steady motion"],
)
def test_the_first_source_that_measures_the_frame_predicts_it_and_all_tie(
    first: float | None, second: float | None, expected: float, ties: int
) -> None:
    model = ConstantVelocityModel(SmootherConfig().motion, 10.0)
    model.restart(0, np.eye(4))
    sources = SourceSet([FixedMotion(first), FixedMotion(second)], model)
    motion = sources.expect(state_at_origin(), FRAME_NS, ExternalOdometry())
    assert motion.T_world_body[0, 3] == pytest.approx(expected)
    assert len(sources.ties(state_at_origin(), FRAME_NS, motion).terms) == ties
    delta = OdometryDelta(0, FRAME_NS, se3.exp(np.array([0.0, 0.0, 0.0, 5.0, 0.0, 0.0])), np.eye(6))
    motion = sources.expect(state_at_origin(), FRAME_NS, ExternalOdometry(delta))
    assert motion.T_world_body[0, 3] == pytest.approx(5.0)
    assert VELOCITY not in sources.variables


def test_body_twists_predict_frames_and_tie_keyframes() -> None:
    """The same as where the motion of the same twists comes with each frame from outside."""
    stamps = stamps_ns(0.0, 4.0, FRAME_NS)
    tracks, config = frames(WALK, stamps, WORLD, noise_px=0.3), SmootherConfig()
    smoother = SlidingWindowSmoother(RIG, config, None, [TwistSource(TwistOdometry(config.twist))])
    outside, odometry = SlidingWindowSmoother(RIG, config), TwistOdometry(config.twist)
    for frame in tracks:
        twist = se3.log(se3.inverse(pose_at(WALK, frame.stamp_ns)) @ pose_at(WALK, frame.stamp_ns + FRAME_NS))
        twist *= NS_PER_S / FRAME_NS
        sample = BodyTwistSample(frame.stamp_ns, twist[3:], twist[:3])
        smoother.push_twist(sample)
        odometry.push(sample)
        before = outside.keyframe_ns
        expected = outside.push_tracks(frame, odometry.delta_until(frame.stamp_ns)).estimate
        if outside.keyframe_ns != before and outside.keyframe_ns is not None:
            odometry.restart(outside.keyframe_ns)
        estimate = smoother.push_tracks(frame).estimate
        assert estimate is not None
        assert expected is not None
        np.testing.assert_array_equal(estimate.nav.T_world_body, expected.nav.T_world_body)
    assert smoother.counts == outside.counts
    assert smoother.counts["keyframes"] > 5

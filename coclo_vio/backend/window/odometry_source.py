# SPDX-License-Identifier: BSD-3-Clause
"""Odometry as a source: motion that another sensor or estimator measured, and body twists."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.keyframe_source import FirstKeyframe, KeyframeSource, KeyframeState, Ties
from coclo_vio.backend.window.motion_model import PredictedMotion
from coclo_vio.backend.window.start import FIXED_SIGMA
from coclo_vio.backend.window.twist_odometry import TwistOdometry
from coclo_vio.values.arrays import Array
from coclo_vio.values.keyframes import OdometryDelta, PoseEvidence
from coclo_vio.values.measurements import BodyTwistSample


@dataclass(frozen=True, slots=True, eq=False)
class ExternalOdometry:
    """What another sensor or estimator measured between the last keyframe and a frame.

    Attributes:
        delta: the motion from the last keyframe to the frame.
        evidence: of the poses at both times; where the frame becomes a keyframe, it replaces the motion, whose
            information it contains.
    """

    delta: OdometryDelta | None = None
    evidence: PoseEvidence | None = None


class OdometrySource(KeyframeSource):
    """Motion that comes with a frame from outside.

    Attributes:
        external: of the present frame.
    """

    def __init__(self) -> None:
        self.external = ExternalOdometry()

    def expect(self, newest: KeyframeState, stamp_ns: int, steady: PredictedMotion) -> PredictedMotion | None:
        """By the motion since the keyframe, where it came with the frame; the velocity is that of steady motion."""
        return _expected(newest, self.external.delta, steady)

    def ties(self, newest: KeyframeState, stamp_ns: int, motion: PredictedMotion) -> Ties:
        """The evidence of both poses, or else the motion."""
        start, end, delta = newest.number, newest.number + 1, self.external.delta
        evidence = None if self.external.evidence is None else factors.evidence(start, end, self.external.evidence)
        if evidence is not None:
            return Ties([evidence], has_motion=delta is not None)
        return Ties() if delta is None else _tied(newest, delta)


class TwistSource(KeyframeSource):
    """Integrated twists of the body."""

    def __init__(self, odometry: TwistOdometry) -> None:
        self._odometry = odometry

    def push(self, sample: BodyTwistSample) -> None:
        """Take a twist."""
        self._odometry.push(sample)

    def begin(self, number: int, stamp_ns: int, velocity_world: Array, velocity_sigma_mps: float) -> FirstKeyframe:
        """Integrate from this keyframe on."""
        self._odometry.restart(stamp_ns)
        return FirstKeyframe()

    def expect(self, newest: KeyframeState, stamp_ns: int, steady: PredictedMotion) -> PredictedMotion | None:
        """By the twists since the keyframe; None without any."""
        return _expected(newest, self._odometry.delta_until(stamp_ns), steady)

    def ties(self, newest: KeyframeState, stamp_ns: int, motion: PredictedMotion) -> Ties:
        """The motion by the twists."""
        delta = self._odometry.delta_until(stamp_ns)
        return Ties() if delta is None else _tied(newest, delta)

    def restart(self, newest: KeyframeState) -> None:
        """Integrate from this keyframe on."""
        self._odometry.restart(newest.stamp_ns)


def _expected(newest: KeyframeState, delta: OdometryDelta | None, steady: PredictedMotion) -> PredictedMotion | None:
    if delta is None:
        return None
    T_world_body = newest.T_world_body @ delta.T_start_end
    covariance = delta.covariance + np.eye(6) * FIXED_SIGMA**2
    return PredictedMotion(T_world_body, steady.velocity_world, covariance, np.zeros((3, 3)), is_measured=True)


def _tied(newest: KeyframeState, delta: OdometryDelta) -> Ties:
    term = factors.relative_pose(newest.number, newest.number + 1, delta.T_start_end, delta.covariance)
    return Ties([term], has_motion=True)

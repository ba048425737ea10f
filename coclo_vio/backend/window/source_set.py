# SPDX-License-Identifier: BSD-3-Clause
"""All sources of motion of a window as one: the first one that measures a frame predicts it, and all tie keyframes."""

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.factors import Term
from coclo_vio.backend.window.keyframe_source import FirstKeyframe, KeyframeSource, KeyframeState, Ties
from coclo_vio.backend.window.motion_model import ConstantVelocityModel, PredictedMotion
from coclo_vio.backend.window.odometry_source import ExternalOdometry, OdometrySource
from coclo_vio.backend.window.variables import KeyframeVariables, Variable
from coclo_vio.values.arrays import Array
from coclo_vio.values.units import NS_PER_S


class SteadyMotionSource(KeyframeSource):
    """The motion before continues."""

    def __init__(self, model: ConstantVelocityModel) -> None:
        self._model = model

    def expect(self, newest: KeyframeState, stamp_ns: int, steady: PredictedMotion) -> PredictedMotion | None:
        """At constant velocity."""
        return steady

    def ties(self, newest: KeyframeState, stamp_ns: int, motion: PredictedMotion) -> Ties:
        """The motion at constant velocity, with no frame after the keyframe."""
        T_start_end, covariance = self._model.since_keyframe((stamp_ns - newest.stamp_ns) / NS_PER_S)
        term = factors.relative_pose(newest.number, newest.number + 1, T_start_end, covariance)
        return Ties([term], has_motion=True)


class SourceSet:
    """Odometry that comes with a frame, then the sources of the window in their order; steady motion without them.

    Attributes:
        variables: that a keyframe has for all of them.
        measures_gravity: whether one of them does.
    """

    def __init__(self, sources: Sequence[KeyframeSource], velocity_model: ConstantVelocityModel) -> None:
        self._velocity_model = velocity_model
        self._external, self._steady = OdometrySource(), SteadyMotionSource(velocity_model)
        self._all: list[KeyframeSource] = [self._external, *sources]
        self.variables = KeyframeVariables(chain.from_iterable(source.variables for source in self._all))
        self.measures_gravity = any(source.measures_gravity for source in self._all)

    def begin(self, number: int, stamp_ns: int, velocity_world: Array, velocity_sigma_mps: float) -> FirstKeyframe:
        """A window begins with this keyframe, at this velocity, m/s, (3,)."""
        each = [source.begin(number, stamp_ns, velocity_world, velocity_sigma_mps) for source in self._all]
        return FirstKeyframe(
            values={variable: value for first in each for variable, value in first.values.items()},
            covariances={variable: value for first in each for variable, value in first.covariances.items()},
            terms=[term for first in each for term in first.terms],
        )

    def expect(self, newest: KeyframeState, stamp_ns: int, external: ExternalOdometry) -> PredictedMotion:
        """Where the body should be in a frame, which odometry may come with."""
        self._external.external = external
        steady = self._velocity_model.at(stamp_ns)
        expected = [source.expect(newest, stamp_ns, steady) for source in self._all]
        return next((motion for motion in expected if motion is not None), steady)

    def ties(self, newest: KeyframeState, stamp_ns: int, motion: PredictedMotion) -> Ties:
        """Those of all sources; steady motion ties keyframes only where no other source does."""
        each = [source.ties(newest, stamp_ns, motion) for source in self._all]
        if not any(ties.has_motion for ties in each):
            each.append(self._steady.ties(newest, stamp_ns, motion))
        gaps = [ties.gap for ties in each if ties.gap is not None]
        terms = [term for ties in each for term in ties.terms]
        return Ties(terms, has_motion=True, gap="; ".join(gaps) or None)

    def initial(self, motion: PredictedMotion) -> Mapping[Variable, Any]:
        """First values of all variables but the pose."""
        return {variable: value for source in self._all for variable, value in source.initial(motion).items()}

    def update(self, newest: KeyframeState) -> None:
        """The window was solved."""
        for source in self._all:
            source.update(newest)

    def restart(self, newest: KeyframeState) -> None:
        """From now on motion is measured from this keyframe."""
        for source in self._all:
            source.restart(newest)

    def priors(self, keyframe: KeyframeState) -> list[Term]:
        """On all variables but the pose of a keyframe whose past is dropped."""
        return [term for source in self._all for term in source.priors(keyframe)]

    def rest(self, number: int, rate: Array, rate_sigma_radps: float, speed_sigma_mps: float) -> list[Term]:
        """On variables of a keyframe at rest, where a gyroscope at rest reads ``rate``, rad/s, imu frame, (3,)."""
        return [term for source in self._all for term in source.rest(number, rate, rate_sigma_radps, speed_sigma_mps)]

    def stay(self, stamp_ns: int) -> None:
        """The body is still at rest at the newest keyframe."""
        for source in self._all:
            source.stay(stamp_ns)

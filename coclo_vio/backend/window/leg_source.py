# SPDX-License-Identifier: BSD-3-Clause
"""Legs as a source: their states are variables of the keyframes, and what was measured between two keyframes ties them.

Leg odometry hands over its state at a keyframe and its motion to each frame (``values.leg_motion``). The state of the
newest keyframe, once the window was solved, is what leg odometry goes on from: it passes nothing of its own on.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import gtsam
import numpy as np

from coclo_vio.backend.window.factors import Term
from coclo_vio.backend.window.keyframe_source import FirstKeyframe, KeyframeSource, KeyframeState, Ties
from coclo_vio.backend.window.motion_model import PredictedMotion
from coclo_vio.backend.window.start import FIXED_SIGMA
from coclo_vio.backend.window.variables import POSE, Variable
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.leg_motion import LegMotion, LegState


class LegSource(KeyframeSource):
    """Leg odometry's states at keyframes, and its motion between them.

    Attributes:
        legs: the variable of a keyframe for them.
        newest: state of the newest keyframe by everything in the window, with its covariance.
    """

    def __init__(self, state: LegState) -> None:
        """Take leg odometry's state at the first keyframe, prior included."""
        self.legs = Variable("leg odometry", "f", len(state.legs))
        self.newest = state
        self._motion: LegMotion | None = None

    @property
    def variables(self) -> Sequence[Variable]:
        """The legs' states."""
        return (self.legs,)

    def take(self, motion: LegMotion) -> None:
        """The motion from the newest keyframe to the frame that follows."""
        self._motion = motion

    def begin(self, number: int, stamp_ns: int, velocity_world: Array, velocity_sigma_mps: float) -> FirstKeyframe:
        """Leg odometry's state at that time; the prior is on the legs given the pose, which the window fixes itself."""
        motion, self._motion = self._motion, None
        if motion is not None:
            self.newest = motion.end
        state = self.newest
        if state.stamp_ns != stamp_ns:
            raise SmootherError(
                f"a window begins at {stamp_ns} ns, leg odometry gave its state at {state.stamp_ns} ns; give that of "
                "the frame before its tracks"
            )
        return FirstKeyframe(
            values={self.legs: state.legs},
            covariances={self.legs: state.covariance[6:, 6:]},
            terms=[_given_pose(number, state, self.legs)],
        )

    def expect(self, newest: KeyframeState, stamp_ns: int, steady: PredictedMotion) -> PredictedMotion | None:
        """By the motion since the keyframe; None where there is none for this frame."""
        motion = self._motion_to(newest, stamp_ns)
        if motion is None:
            return None
        covariance = motion.covariance + np.eye(6) * FIXED_SIGMA**2
        T_world_body, velocity = motion.end.T_world_body, motion.velocity_world
        return PredictedMotion(T_world_body, velocity, covariance, np.zeros((3, 3)), is_measured=True)

    def ties(self, newest: KeyframeState, stamp_ns: int, motion: PredictedMotion) -> Ties:
        """What was measured of the states of both; without it, a prior on the next one's."""
        measured = self._motion_to(newest, stamp_ns)
        if measured is None:
            state = self.newest
            gap = "there is no motion by leg odometry since the last keyframe; this keyframe gets no factor of it"
            return Ties([_prior(newest.number + 1, state.legs, state.covariance[6:, 6:], self.legs)], gap=gap)
        return Ties([_tie(newest.number, measured, self.legs)], has_motion=True)

    def initial(self, motion: PredictedMotion) -> Mapping[Variable, Any]:
        """The state that leg odometry gave with the frame."""
        return {self.legs: self.newest.legs if self._motion is None else self._motion.end.legs}

    def restart(self, newest: KeyframeState) -> None:
        """Leg odometry goes on from this keyframe as the window has estimated it."""
        covariance = newest.covariance_of(POSE, self.legs)
        self.newest = LegState(newest.stamp_ns, newest.T_world_body, newest.value(self.legs), covariance)
        self._motion = None

    def priors(self, keyframe: KeyframeState) -> Sequence[Term]:
        """On the legs' states."""
        return (_prior(keyframe.number, keyframe.value(self.legs), keyframe.covariance_of(self.legs), self.legs),)

    def _motion_to(self, newest: KeyframeState, stamp_ns: int) -> LegMotion | None:
        motion = self._motion
        is_between = motion is not None and (motion.start.stamp_ns, motion.end.stamp_ns) == (newest.stamp_ns, stamp_ns)
        return motion if is_between else None


def _tie(start: int, motion: LegMotion, legs: Variable) -> Term:
    """The factor of a motion, linear at its own states."""
    states = (start, motion.start), (start + 1, motion.end)
    keys = tuple(key for number, _ in states for key in (POSE.key(number), legs.key(number)))
    width = len(motion.start.covariance)
    columns = np.split(motion.rows, [6, width, width + 6], axis=1)
    return _linear(keys, columns, motion.measured, [state for _, state in states])


def _given_pose(number: int, state: LegState, legs: Variable) -> Term:
    """The prior of a state without that of its pose: legs given the pose."""
    pose, cross, own = state.covariance[:6, :6], state.covariance[6:, :6], state.covariance[6:, 6:]
    gain = np.linalg.solve(pose, cross.T).T
    rows = np.linalg.inv(np.linalg.cholesky(own - gain @ cross.T))
    keys = (POSE.key(number), legs.key(number))
    return _linear(keys, [-rows @ gain, rows], np.zeros(len(rows)), [state])


def _prior(number: int, mean: Array, covariance: Array, legs: Variable) -> Term:
    key = legs.key(number)
    return Term(gtsam.PriorFactorVector(key, mean, gtsam.noiseModel.Gaussian.Covariance(covariance)), (key,))


def _linear(keys: Sequence[int], columns: Sequence[Array], measured: Array, at: Sequence[LegState]) -> Term:
    """``sum(columns @ errors) = measured + N(0, 1)`` of [pose, legs] of each state, linear there."""
    linearised_at = gtsam.Values()
    for (pose, legs), state in zip(zip(keys[::2], keys[1::2], strict=True), at, strict=True):
        linearised_at.insert(pose, gtsam.Pose3(state.T_world_body))
        linearised_at.insert(legs, np.array(state.legs))
    unit = gtsam.noiseModel.Unit.Create(len(measured))
    blocks = [(key, np.asfortranarray(each)) for key, each in zip(keys, columns, strict=True)]
    rows = gtsam.GaussianConditional(blocks, 1, measured, unit)  # a factor's own constructor takes three keys at most
    return Term(gtsam.LinearContainerFactor(gtsam.JacobianFactor(rows), linearised_at), tuple(keys))

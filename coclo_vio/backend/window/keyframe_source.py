# SPDX-License-Identifier: BSD-3-Clause
"""What a source of motion between keyframes gives the window: variables, expectations, ties, and restarts.

A source measures, or assumes, how the body moves from one keyframe to the next: an IMU, odometry from outside, a body
twist, steady motion. A window has any number of them at once.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import gtsam
import numpy as np

from coclo_vio.backend.window.factors import Term
from coclo_vio.backend.window.motion_model import PredictedMotion
from coclo_vio.backend.window.variables import POSE, KeyframeVariables, Variable
from coclo_vio.values.arrays import Array


@dataclass(frozen=True, slots=True, eq=False)
class KeyframeState:
    """A keyframe as it is estimated.

    Attributes:
        number: of the keyframe.
        stamp_ns: its time, ns.
        values: of its variables, among others.
        covariance: of its state, in the layout of ``variables``, (S, S).
        variables: that a keyframe has.
    """

    number: int
    stamp_ns: int
    values: gtsam.Values
    covariance: Array
    variables: KeyframeVariables

    @property
    def T_world_body(self) -> Array:
        """The pose, (4, 4)."""
        return np.asarray(self.value(POSE).matrix())

    def value(self, variable: Variable) -> Any:
        """The estimate of a variable."""
        return variable.value(self.values, self.number)

    def covariance_of(self, *variables: Variable) -> Array:
        """The joint covariance of some variables, in this order, (N, N)."""
        rows = [row for each in variables for row in range(self.covariance.shape[0])[self.variables.rows(each)]]
        return self.covariance[rows][:, rows]


@dataclass(frozen=True, slots=True, eq=False)
class FirstKeyframe:
    """What a source knows of its variables at the first keyframe of a window.

    Attributes:
        values: to start from.
        covariances: of those.
        terms: the same as priors.
    """

    values: Mapping[Variable, Any] = field(default_factory=dict)
    covariances: Mapping[Variable, Array] = field(default_factory=dict)
    terms: Sequence[Term] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Ties:
    """What connects the newest keyframe with the next one.

    Attributes:
        terms: factors of the two, or priors on variables of the next one that nothing else measures.
        has_motion: whether they determine the motion between the two poses.
        gap: what is missing, for an event; None where nothing is.
    """

    terms: Sequence[Term] = ()
    has_motion: bool = False
    gap: str | None = None


class KeyframeSource:
    """A source of motion between keyframes; what a source does not have stays as it is here."""

    @property
    def variables(self) -> Sequence[Variable]:
        """That each keyframe has for this source, besides its pose."""
        return ()

    @property
    def measures_gravity(self) -> bool:
        """Whether it measures roll and pitch."""
        return False

    def begin(self, number: int, stamp_ns: int, velocity_world: Array, velocity_sigma_mps: float) -> FirstKeyframe:
        """A window begins with this keyframe, at this velocity, m/s, (3,)."""
        return FirstKeyframe()

    def expect(self, newest: KeyframeState, stamp_ns: int, steady: PredictedMotion) -> PredictedMotion | None:
        """Where the body should be in a frame; None where the source does not measure it.

        Args:
            newest: the newest keyframe, from which the motion starts.
            stamp_ns: of the frame.
            steady: the same by steady motion.
        """
        return None

    def ties(self, newest: KeyframeState, stamp_ns: int, motion: PredictedMotion) -> Ties:
        """What connects the newest keyframe with the next one, number + 1, at ``stamp_ns``, which was expected so."""
        return Ties()

    def initial(self, motion: PredictedMotion) -> Mapping[Variable, Any]:
        """First values of its variables at a keyframe that was expected so."""
        return {}

    def update(self, newest: KeyframeState) -> None:
        """The window was solved."""

    def restart(self, newest: KeyframeState) -> None:
        """From now on motion is measured from this keyframe."""

    def priors(self, keyframe: KeyframeState) -> Sequence[Term]:
        """On its variables at a keyframe whose past is dropped; the covariance may be a later keyframe's."""
        return ()

    def rest(self, number: int, rate: Array, rate_sigma_radps: float, speed_sigma_mps: float) -> Sequence[Term]:
        """On its variables at a keyframe at rest, where a gyroscope at rest reads ``rate``, rad/s, imu frame, (3,)."""
        return ()

    def stay(self, stamp_ns: int) -> None:
        """The body is still at rest at the newest keyframe."""

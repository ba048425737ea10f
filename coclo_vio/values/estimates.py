# SPDX-License-Identifier: BSD-3-Clause
"""What the estimators say: state, covariance and relative pose, as frozen values."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from coclo_vio.values.arrays import Array, BoolArray, checked, frozen
from coclo_vio.values.measurements import Measurement


@dataclass(frozen=True, slots=True, eq=False)
class NavState:
    """Pose, velocity, rate and biases of the body at one time.

    Attributes:
        T_world_body: maps body coordinates to world, (4, 4).
        velocity_world: of the body origin, m/s, world frame, (3,).
        angular_velocity_body: true rate without bias, rad/s, body frame, (3,).
        gyroscope_bias: rad/s, body frame, (3,).
        accelerometer_bias: m/s^2, body frame, (3,).
    """

    T_world_body: Array
    velocity_world: Array
    angular_velocity_body: Array
    gyroscope_bias: Array
    accelerometer_bias: Array

    def __post_init__(self) -> None:
        frozen(self, "T_world_body", checked("NavState.T_world_body", self.T_world_body, (4, 4)))
        for name in ("velocity_world", "angular_velocity_body", "gyroscope_bias", "accelerometer_bias"):
            frozen(self, name, checked(f"NavState.{name}", getattr(self, name), (3,)))


@dataclass(frozen=True, slots=True, eq=False)
class FootState:
    """Where the feet are and whether they stand, in the order of the robot's legs.

    Attributes:
        position_world: foot centres, m, world frame, (legs, 3).
        contact_probability: in 0..1, (legs,).
        is_stance: the feet that hold the body in this estimate, (legs,).
    """

    position_world: Array
    contact_probability: Array
    is_stance: BoolArray

    def __post_init__(self) -> None:
        frozen(self, "position_world", checked("FootState.position_world", self.position_world, (None, 3)))
        legs = (len(self.position_world),)
        probability = checked("FootState.contact_probability", self.contact_probability, legs)
        frozen(self, "contact_probability", probability)
        is_stance = np.array(self.is_stance, dtype=np.bool_)
        if is_stance.shape != legs:
            raise ValueError(f"FootState.is_stance must have shape {legs}, got {is_stance.shape}")
        is_stance.flags.writeable = False
        frozen(self, "is_stance", is_stance)


@dataclass(frozen=True, slots=True, eq=False)
class StateEstimate:
    """An estimator's answer at one time.

    Attributes:
        stamp_ns: time in nanoseconds.
        nav: the mean.
        covariance: of the error [rotation (rad, body), position (m, body), velocity (m/s, world)], (9, 9).
            Rotation and position are right/local: ``T = T_mean exp([rotation, position])``.
        feet: the feet, where the estimator knows any.
    """

    stamp_ns: int
    nav: NavState
    covariance: Array
    feet: FootState | None = None

    def __post_init__(self) -> None:
        frozen(self, "covariance", checked("StateEstimate.covariance", self.covariance, (9, 9)))


@dataclass(frozen=True, slots=True, eq=False)
class OdometryDelta:
    """Relative motion between two times, what ties two keyframes together.

    Attributes:
        start_ns: time of the earlier pose in nanoseconds.
        end_ns: time of the later pose in nanoseconds.
        T_start_end: maps end coordinates to start, (4, 4).
        covariance: of the right/local error ``T = T_mean exp([rotation rad, translation m])``, (6, 6).

    Raises:
        ValueError: a wrong shape, or an end before the start.
    """

    start_ns: int
    end_ns: int
    T_start_end: Array
    covariance: Array

    def __post_init__(self) -> None:
        if self.end_ns < self.start_ns:
            raise ValueError(f"OdometryDelta ends at {self.end_ns} ns before it starts at {self.start_ns} ns")
        frozen(self, "T_start_end", checked("OdometryDelta.T_start_end", self.T_start_end, (4, 4)))
        frozen(self, "covariance", checked("OdometryDelta.covariance", self.covariance, (6, 6)))


@dataclass(frozen=True, slots=True, eq=False)
class PoseBelief:
    """Where the body was at one time, as somebody believes.

    Attributes:
        stamp_ns: time in nanoseconds.
        T_world_body: the mean, (4, 4).
        covariance: of the right/local error [rotation rad, position m], (6, 6).
    """

    stamp_ns: int
    T_world_body: Array
    covariance: Array

    def __post_init__(self) -> None:
        frozen(self, "T_world_body", checked("PoseBelief.T_world_body", self.T_world_body, (4, 4)))
        frozen(self, "covariance", checked("PoseBelief.covariance", self.covariance, (6, 6)))


@dataclass(frozen=True, slots=True, eq=False)
class PosePair:
    """Where the body was at two times, as somebody believes, and how the two errors hang together.

    Attributes:
        start_ns: time of the earlier pose in nanoseconds.
        end_ns: time of the later pose in nanoseconds.
        T_world_start: mean of the earlier pose, (4, 4).
        T_world_end: mean of the later pose, (4, 4).
        covariance: of both right/local errors, the earlier one first, each [rotation rad, position m], (12, 12).
    """

    start_ns: int
    end_ns: int
    T_world_start: Array
    T_world_end: Array
    covariance: Array

    def __post_init__(self) -> None:
        for name in ("T_world_start", "T_world_end"):
            frozen(self, name, checked(f"PosePair.{name}", getattr(self, name), (4, 4)))
        frozen(self, "covariance", checked("PosePair.covariance", self.covariance, (12, 12)))

    @property
    def end(self) -> PoseBelief:
        """The later pose alone."""
        return PoseBelief(self.end_ns, self.T_world_end, self.covariance[6:, 6:])


@dataclass(frozen=True, slots=True, eq=False)
class PoseEvidence:
    """What something says of the poses at two times, as a log-likelihood that may leave directions open.

    ``-x^T information x / 2 + vector^T x`` of the right/local errors ``x`` (12,) of both poses about the given ones,
    the earlier one first. Evidence of independent things adds up.

    Attributes:
        start_ns: time of the earlier pose in nanoseconds.
        end_ns: time of the later pose in nanoseconds.
        T_world_start: where the errors of the earlier pose are counted from, (4, 4).
        T_world_end: the same of the later pose, (4, 4).
        information: positive semi-definite, (12, 12).
        vector: (12,).
    """

    start_ns: int
    end_ns: int
    T_world_start: Array
    T_world_end: Array
    information: Array
    vector: Array

    def __post_init__(self) -> None:
        for name in ("T_world_start", "T_world_end"):
            frozen(self, name, checked(f"PoseEvidence.{name}", getattr(self, name), (4, 4)))
        frozen(self, "information", checked("PoseEvidence.information", self.information, (12, 12)))
        frozen(self, "vector", checked("PoseEvidence.vector", self.vector, (12,)))

    def rows(self, least: float = 1e-9) -> tuple[Array, Array]:
        """The same as independent measurements of unit noise: ``H x = z + N(0, 1)``, (r, 12) and (r,).

        Directions of which less than ``least`` of the strongest information is known are left out.
        """
        values, axes = np.linalg.eigh(0.5 * (self.information + self.information.T))
        kept = values > least * max(float(values[-1]), 0.0)
        root = np.sqrt(values[kept])
        return root[:, None] * axes[:, kept].T, (axes[:, kept].T @ self.vector) / root


class Estimator(Protocol):
    """Anything that turns measurements into estimates, one at a time, online."""

    def push(self, measurement: Measurement) -> StateEstimate | None:
        """Take one measurement; the new estimate where this one completes a step, otherwise None."""

    @property
    def counts(self) -> Mapping[str, int]:
        """How often each unusual thing happened: samples refused, legs left out, gaps, rejections, standstills."""


@dataclass(frozen=True, slots=True)
class Event:
    """Something out of the ordinary that an estimator lived through.

    Attributes:
        stamp_ns: when, in nanoseconds.
        kind: one word for its sort, such as ``blind`` or ``restart``.
        detail: a sentence: what was seen, and what was done.
    """

    stamp_ns: int
    kind: str
    detail: str


@dataclass(frozen=True, slots=True)
class KeyframeHealth:
    """How the smoother fared at one keyframe.

    Attributes:
        stamp_ns: of the keyframe, in nanoseconds.
        keyframes: in the window.
        tracks: points of the frame that were matched to landmarks.
        landmarks: in the window.
        factors: of the whole problem.
        reprojection_px: root mean square of what is left of the window's stereo residuals, px.
        iterations: of the solver.
        compute_s: processor time of this keyframe, s.
        condition: of the newest keyframe's pose covariance: longest by shortest axis, in the solver's units.
    """

    stamp_ns: int
    keyframes: int
    tracks: int
    landmarks: int
    factors: int
    reprojection_px: float
    iterations: int
    compute_s: float
    condition: float


@runtime_checkable
class SelfReporting(Protocol):
    """An estimator that keeps a diary; what is taken from it is forgotten, so memory stays flat."""

    def take_events(self) -> tuple[Event, ...]:
        """What happened since the last call."""

    def take_health(self) -> tuple[KeyframeHealth, ...]:
        """The keyframes since the last call."""


@runtime_checkable
class Several(Protocol):
    """An estimator with more than one answer: what ``push`` gives has a name of its own, the others have theirs."""

    @property
    def name(self) -> str:
        """Of what ``push`` gives."""

    @property
    def other_names(self) -> tuple[str, ...]:
        """Of the others."""

    def take_others(self) -> tuple[tuple[str, StateEstimate], ...]:
        """The others' estimates since the last call, with their names."""

# SPDX-License-Identifier: BSD-3-Clause
"""Values that leg odometry and the sliding window exchange at keyframes: relative motion, marginals, evidence."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array, checked, frozen
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.outputs import Event, KeyframeHealth, WindowSnapshot


@dataclass(frozen=True, slots=True, eq=False)
class OdometryDelta:
    """Relative motion between two times, for a factor between two keyframes.

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
class PoseMarginal:
    """Marginal of the body's pose at one time.

    Attributes:
        stamp_ns: time in nanoseconds.
        T_world_body: the mean, (4, 4).
        covariance: of the right/local error [rotation rad, position m], (6, 6).
    """

    stamp_ns: int
    T_world_body: Array
    covariance: Array

    def __post_init__(self) -> None:
        frozen(self, "T_world_body", checked("PoseMarginal.T_world_body", self.T_world_body, (4, 4)))
        frozen(self, "covariance", checked("PoseMarginal.covariance", self.covariance, (6, 6)))


@dataclass(frozen=True, slots=True, eq=False)
class PosePair:
    """Joint marginal of the body's poses at two times.

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
    def end(self) -> PoseMarginal:
        """The later pose alone."""
        return PoseMarginal(self.end_ns, self.T_world_end, self.covariance[6:, 6:])


def relative_motion(pair: PosePair, floor_m: float) -> OdometryDelta:
    """The motion between two poses with the covariance of its right/local error.

    Args:
        pair: the poses.
        floor_m: one sigma of independent noise that is added, so that the covariance is positive definite, m and rad.
    """
    T_start_end = se3.inverse(pair.T_world_start) @ pair.T_world_end
    jacobian = np.concatenate((-se3.adjoint(se3.inverse(T_start_end)), np.eye(6)), axis=1)
    covariance = jacobian @ pair.covariance @ jacobian.T + np.eye(6) * floor_m**2
    return OdometryDelta(pair.start_ns, pair.end_ns, T_start_end, covariance)


@dataclass(frozen=True, slots=True, eq=False)
class PoseEvidence:
    """Evidence on the poses at two times, as a log-likelihood; it may be singular.

    ``-x^T information x / 2 + vector^T x`` of the right/local errors ``x`` (12,) of both poses about their
    linearisation points, the earlier one first. Independent evidence adds up.

    Attributes:
        start_ns: time of the earlier pose in nanoseconds.
        end_ns: time of the later pose in nanoseconds.
        T_world_start: linearisation point of the earlier pose, (4, 4).
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

        Directions with less than ``least`` of the largest eigenvalue of the information are left out.
        """
        values, axes = np.linalg.eigh(0.5 * (self.information + self.information.T))
        kept = values > least * max(float(values[-1]), 0.0)
        root = np.sqrt(values[kept])
        return root[:, None] * axes[:, kept].T, (axes[:, kept].T @ self.vector) / root


@dataclass(frozen=True, slots=True, eq=False)
class KeyframeResult:
    """Result of the window for a new keyframe.

    Attributes:
        marginal: of the keyframe's pose, from all factors.
        evidence: on this keyframe and the one before it from landmarks and the window alone, without the odometry
            factor between the two; None if the keyframe is the first of its window or the two are not determined.
    """

    marginal: PoseMarginal
    evidence: PoseEvidence | None


@dataclass(frozen=True, slots=True, eq=False)
class FrameResult:
    """Result of a smoother for one frame.

    Attributes:
        estimate: of the frame; None before the start.
        keyframe: None if the frame is not a keyframe, or results of keyframes were not requested.
        events: since the last frame.
        health: of the window, one per solve.
        snapshots: of the window, one per keyframe where they were requested.
    """

    estimate: StateEstimate | None = None
    keyframe: KeyframeResult | None = None
    events: tuple[Event, ...] = ()
    health: tuple[KeyframeHealth, ...] = ()
    snapshots: tuple[WindowSnapshot, ...] = ()

# SPDX-License-Identifier: BSD-3-Clause
"""Leg odometry between two keyframes as one factor of an estimator that holds the legs' states at both.

The state of a keyframe is the body's pose at its stamp, and a vector of everything else that leg odometry estimates,
in body axes: rates, velocity, feet relative to the body, biases, slip. Nothing of it is a summary: with the state the
past is known to be irrelevant (Markov), so factors of consecutive pairs of keyframes are independent.
"""

from dataclasses import dataclass

from coclo_vio.values.arrays import Array, checked, frozen


@dataclass(frozen=True, slots=True, eq=False)
class LegState:
    """The state of leg odometry at one time.

    Attributes:
        stamp_ns: time in nanoseconds.
        T_world_body: the pose, (4, 4).
        legs: everything else, as leg odometry orders it, (m,).
        covariance: of [right/local pose error, error of ``legs``], (6 + m, 6 + m).
    """

    stamp_ns: int
    T_world_body: Array
    legs: Array
    covariance: Array

    def __post_init__(self) -> None:
        frozen(self, "T_world_body", checked("LegState.T_world_body", self.T_world_body, (4, 4)))
        frozen(self, "legs", checked("LegState.legs", self.legs, (None,)))
        size = 6 + len(self.legs)
        frozen(self, "covariance", checked("LegState.covariance", self.covariance, (size, size)))


@dataclass(frozen=True, slots=True, eq=False)
class LegMotion:
    """What joints, contacts and IMU between two times measured of the states at both, without any prior.

    ``rows @ [start error, end error] = measured + N(0, 1)``, with the errors about ``start`` and ``end``, each
    [right/local pose error, error of ``legs``].

    Attributes:
        start: the linearisation point at the earlier time; its covariance is that of the prior, which is not contained.
        end: the linearisation point at the later time, with its marginal covariance, prior included.
        rows: (r, 2 (6 + m)).
        measured: (r,).
        velocity_world: at the later time, m/s, (3,).
        covariance: of the right/local error of the motion from the earlier to the later pose, (6, 6).
    """

    start: LegState
    end: LegState
    rows: Array
    measured: Array
    velocity_world: Array
    covariance: Array

    def __post_init__(self) -> None:
        width = len(self.start.covariance) + len(self.end.covariance)
        frozen(self, "rows", checked("LegMotion.rows", self.rows, (None, width)))
        frozen(self, "measured", checked("LegMotion.measured", self.measured, (len(self.rows),)))
        frozen(self, "velocity_world", checked("LegMotion.velocity_world", self.velocity_world, (3,)))
        frozen(self, "covariance", checked("LegMotion.covariance", self.covariance, (6, 6)))

# SPDX-License-Identifier: BSD-3-Clause
"""States of an estimator and their covariance, as frozen values."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from coclo_vio.values.arrays import Array, BoolArray, checked, frozen


class _OwnArrays:
    """A value that an estimator can make from arrays of its own without a copy and a check of each."""

    __slots__ = ()

    @classmethod
    def of_own(cls, **fields: Any) -> Self:
        """The value of arrays that have the right shapes, are finite, and that nobody else writes to.

        They are read only from then on. All fields are given.
        """
        value = object.__new__(cls)
        for name, field in fields.items():
            if isinstance(field, np.ndarray):
                field.setflags(write=False)
            frozen(value, name, field)
        return value


@dataclass(frozen=True, slots=True, eq=False)
class NavState(_OwnArrays):
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
class FootState(_OwnArrays):
    """Positions and contacts of the feet, in the order of the robot's legs.

    Attributes:
        position_world: foot centres, m, world frame, (legs, 3).
        contact_probability: in 0..1, (legs,).
        is_stance: the feet that the estimate treats as stance, (legs,).
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
class StateEstimate(_OwnArrays):
    """The state of the body at one time, with its uncertainty.

    Attributes:
        stamp_ns: time in nanoseconds.
        nav: the mean.
        covariance: of the error [rotation (rad, body), position (m, body), velocity (m/s, world)], (9, 9).
            Rotation and position are right/local: ``T = T_mean exp([rotation, position])``.
        feet: None for an estimator without legs.
    """

    stamp_ns: int
    nav: NavState
    covariance: Array
    feet: FootState | None = None

    def __post_init__(self) -> None:
        frozen(self, "covariance", checked("StateEstimate.covariance", self.covariance, (9, 9)))

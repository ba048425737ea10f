# SPDX-License-Identifier: BSD-3-Clause
"""The reference of the trunk: a point that moves along the path, at a height and a tilt that follow the ground."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.simulation.trot.ground import TrotGround
from coclo_vio.simulation.trot.trot_gait import TrotGaitConfig
from coclo_vio.values.arrays import Array

_PULL_PER_S = 1.5  # from an error of position to a velocity
_MAX_PULL_MPS = 0.2
_WAIT_M = 0.35  # the reference waits for a trunk that is so far behind
_TURN_PER_S = 4.0  # from an error of heading to a rate
_MAX_TURN_RADPS = 0.5
_SETTLE_S = 0.7  # trotting at the end of the path, without advancing
_SMOOTH_S = 0.12  # time constant of height and slope
_JITTER_S = 1.5  # time constant of the slow jitter of speed
_ARRIVED_M = 0.02
_LEAST_MPS = 0.03
_SPAN_M = np.array([[x, y] for x in np.linspace(-0.35, 0.35, 7) for y in (-0.14, 0.0, 0.14)])  # sampled ground
_PLANE = np.linalg.pinv(np.hstack((np.ones((len(_SPAN_M), 1)), _SPAN_M)))


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Where the trunk is to be, world.

    Attributes:
        position: m, (3,).
        rotation: ``R_world_body`` (3, 3).
        velocity: m/s, (3,).
        rate: rad/s, (3,).
    """

    position: Array
    rotation: Array
    velocity: Array
    rate: Array


class ReferenceTracker:
    """Moves the reference, one call of ``step`` a control period.

    Args:
        ground: and its path.
        gait: speeds.
        height_m: of the trunk over the ground.
        generator: of the slow jitter of the speed.
    """

    def __init__(
        self, ground: TrotGround, gait: TrotGaitConfig, height_m: float, generator: np.random.Generator
    ) -> None:
        self.gait = gait
        self.travelled_m = 0.0
        self._ground = ground
        self.height_m = height_m
        self._generator = generator
        self._speed = self._jitter = self._settled_s = 0.0
        self._plane: Array | None = None

    @property
    def is_done(self) -> bool:
        """Whether the end of the path is reached and the robot has come to rest."""
        return self._settled_s > _SETTLE_S

    def step(self, dt_s: float, position: Array, rotation: Array, *, is_moving: bool) -> Reference:
        """The reference of this control period for a trunk at ``position`` (3,) with ``rotation`` (3, 3)."""
        point = self._ground.path.at(self.travelled_m)
        ahead = np.array([np.cos(point.heading_rad), np.sin(point.heading_rad)])
        error = point.position - position[:2]
        if is_moving:
            self._advance(dt_s, float(ahead @ error), point.curvature)
        level = self._speed * ahead + _limited(_PULL_PER_S * error, _MAX_PULL_MPS)
        height, along, across = self._followed_plane(dt_s, position, rotation)
        R = _on_plane(ahead, along, across)
        sine = rotation[0, 0] * ahead[1] - rotation[1, 0] * ahead[0]  # of the heading's error, nearly
        rate = point.curvature * self._speed + float(_limited(_TURN_PER_S * sine, _MAX_TURN_RADPS))
        return Reference(
            np.append(point.position, height + self.height_m),
            R,
            np.append(level, along * self._speed),
            np.array([0.0, 0.0, rate]),
        )

    def _advance(self, dt_s: float, lag_m: float, curvature: float) -> None:
        gait, left_m = self.gait, self._ground.path.length_m - self.travelled_m
        if left_m < _ARRIVED_M:
            self._speed = 0.0
            self._settled_s += dt_s
            return
        keep = np.exp(-dt_s / _JITTER_S)
        noise = float(self._generator.standard_normal()) * np.sqrt(1.0 - keep**2)
        self._jitter = keep * self._jitter + noise * gait.speed_jitter
        wanted = gait.speed_mps * (1.0 + self._jitter)
        if curvature > 0.0:
            wanted = min(wanted, gait.turn_rate_radps / curvature)
        wanted = min(wanted, np.sqrt(2.0 * gait.acceleration_mps2 * left_m))
        wanted *= max(0.0, min(1.0, 1.5 - lag_m / _WAIT_M))
        change = gait.acceleration_mps2 * dt_s
        self._speed = max(self._speed - 2.0 * change, min(self._speed + change, wanted), _LEAST_MPS)
        self.travelled_m += self._speed * dt_s

    def _followed_plane(self, dt_s: float, position: Array, rotation: Array) -> Array:
        """Height, slope along and slope across of the ground below the trunk, smoothed, (3,)."""
        ahead = rotation[:2, 0] / np.hypot(rotation[0, 0], rotation[1, 0])
        turn = np.array([[ahead[0], ahead[1]], [-ahead[1], ahead[0]]])
        plane = _PLANE @ self._ground.map.heights(position[:2] + _SPAN_M @ turn)
        if self._plane is None:
            self._plane = plane
        self._plane = self._plane + min(dt_s / _SMOOTH_S, 1.0) * (plane - self._plane)
        return self._plane


def _on_plane(ahead: Array, along: float, across: float) -> Array:
    """``R_world_body`` (3, 3) of a trunk that looks to ``ahead`` (2,) on a plane of these slopes."""
    x = np.array([ahead[0], ahead[1], along]) / np.sqrt(1.0 + along**2)
    left = np.array([-ahead[1], ahead[0], across])
    z = np.array([x[1] * left[2] - x[2] * left[1], x[2] * left[0] - x[0] * left[2], x[0] * left[1] - x[1] * left[0]])
    z /= np.sqrt(z @ z)
    y = np.array([z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]])
    return np.column_stack((x, y, z))


def _limited(value: Array | float, limit: float) -> Array:
    return np.asarray(np.minimum(np.maximum(value, -limit), limit))

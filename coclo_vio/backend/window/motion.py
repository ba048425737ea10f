# SPDX-License-Identifier: BSD-3-Clause
"""Where the body is expected before it is seen: as the IMU felt, as an odometry says, or as it went on before."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from coclo_vio.arrays import Array
from coclo_vio.backend.window.config import MotionPriorConfig
from coclo_vio.geometry import se3

_NS_PER_S = 1_000_000_000
_LEAST_SPAN_NS = 80_000_000  # over which a velocity is told from two poses
_FLOOR = 1e-4  # rad and m: nothing is expected better than this


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """What is expected of a frame.

    Attributes:
        T_world_body: (4, 4).
        velocity_world: m/s, (3,).
        covariance: of the right/local error of the pose since the last frame or keyframe, (6, 6).
        velocity_gain: m/s that the velocity is off for each metre that the position is, world frame, (3, 3).
        is_measured: whether an IMU or an odometry says so; otherwise it is a belief.
    """

    T_world_body: Array
    velocity_world: Array
    covariance: Array
    velocity_gain: Array
    is_measured: bool


class SteadyMotion:
    """The belief that motion goes on: the twist between the last poses, less and less of it while nothing is seen."""

    def __init__(self, config: MotionPriorConfig, unknown_speed_mps: float) -> None:
        self._config, self._unknown_speed = config, unknown_speed_mps
        self._path: deque[tuple[int, Array]] = deque()  # as it was seen step by step, free of corrections
        self._last = np.eye(4)
        self._seen_ns = 0

    def restart(self, stamp_ns: int, T_world_body: Array) -> None:  # noqa: N803 -- a transform is T
        """Know one pose and nothing of its velocity."""
        self._path = deque([(stamp_ns, np.eye(4))])
        self._last, self._seen_ns = T_world_body, stamp_ns

    def add(self, stamp_ns: int, T_seen: Array, T_world_body: Array, *, is_seen: bool) -> None:  # noqa: N803
        """Take a frame.

        Args:
            stamp_ns: its time.
            T_seen: its pose in the world of the frame before it: what the motion is told from, (4, 4).
            T_world_body: its pose once the window has been solved; a correction is no motion, (4, 4).
            is_seen: whether it was seen; otherwise it only carries the last twist on.
        """
        self._seen_ns = stamp_ns if is_seen else self._seen_ns
        self._path.append((stamp_ns, self._path[-1][1] @ se3.inverse(self._last) @ T_seen))
        self._last = T_world_body
        while len(self._path) > 2 and stamp_ns - self._path[1][0] >= _LEAST_SPAN_NS:
            self._path.popleft()

    @property
    def twist(self) -> Array:
        """Rotation rad/s and translation m/s in the body frame, (6,); zero as long as one pose is known."""
        (first_ns, first), (last_ns, last) = self._path[0], self._path[-1]
        if last_ns <= first_ns:
            return np.zeros(6)
        return se3.log(se3.inverse(first) @ last) * (_NS_PER_S / (last_ns - first_ns))

    def at(self, stamp_ns: int) -> Motion:
        """What is expected at ``stamp_ns``, from the last pose on."""
        last_ns, last = self._path[-1][0], self._last
        dt_s = (stamp_ns - last_ns) / _NS_PER_S
        blind_s = (stamp_ns - self._seen_ns) / _NS_PER_S
        fading = float(np.exp(-max(0.0, blind_s - dt_s) / self._config.memory_s))
        step = self.twist * dt_s * fading
        T = last @ se3.exp(step)
        covariance = self.covariance(dt_s, max(dt_s, blind_s))
        if len(self._path) < 2:
            shift, turn = self._unknown_speed * dt_s, 0.2 * self._unknown_speed * dt_s
            covariance = np.diag(np.square(np.repeat([turn + _FLOOR, shift + _FLOOR], 3)))
        return Motion(T, last[:3, :3] @ self.twist[3:] * fading, covariance, np.zeros((3, 3)), is_measured=False)

    def covariance(self, dt_s: float, reach_s: float | None = None) -> Array:
        """How far motion is from steady over ``dt_s``, the twist being ``reach_s`` old at its end, (6, 6)."""
        config, reach_s = self._config, dt_s if reach_s is None else reach_s
        turn = (config.turn_acceleration_radps2 * reach_s + config.rate_radps) * dt_s
        shift = (config.acceleration_mps2 * reach_s + config.velocity_mps) * dt_s
        return np.diag(np.square(np.repeat([turn + _FLOOR, shift + _FLOOR], 3)))

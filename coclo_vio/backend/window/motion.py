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
        is_measured: whether an IMU or an odometry says so; otherwise it is a belief.
    """

    T_world_body: Array
    velocity_world: Array
    covariance: Array
    is_measured: bool


class SteadyMotion:
    """The belief that motion goes on: the twist between the last poses, less and less of it while nothing is seen."""

    def __init__(self, config: MotionPriorConfig, unknown_speed_mps: float) -> None:
        self._config, self._unknown_speed = config, unknown_speed_mps
        self._poses: deque[tuple[int, Array]] = deque()
        self._seen_ns = 0

    def restart(self, stamp_ns: int, T_world_body: Array) -> None:  # noqa: N803 -- a transform is T
        """Know one pose and nothing of its velocity."""
        self._poses = deque([(stamp_ns, T_world_body)])
        self._seen_ns = stamp_ns

    def add(self, stamp_ns: int, T_world_body: Array, *, is_seen: bool) -> None:  # noqa: N803
        """Take the pose of a frame; one that was not seen only carries the last twist on."""
        if is_seen:
            self._seen_ns = stamp_ns
        self._poses.append((stamp_ns, T_world_body))
        while len(self._poses) > 2 and stamp_ns - self._poses[1][0] >= _LEAST_SPAN_NS:
            self._poses.popleft()

    @property
    def twist(self) -> Array:
        """Rotation rad/s and translation m/s in the body frame, (6,); zero as long as one pose is known."""
        (first_ns, first), (last_ns, last) = self._poses[0], self._poses[-1]
        if last_ns <= first_ns:
            return np.zeros(6)
        return se3.log(se3.inverse(first) @ last) * (_NS_PER_S / (last_ns - first_ns))

    def at(self, stamp_ns: int) -> Motion:
        """What is expected at ``stamp_ns``, from the last pose on."""
        last_ns, last = self._poses[-1]
        dt_s = (stamp_ns - last_ns) / _NS_PER_S
        blind_s = (stamp_ns - self._seen_ns) / _NS_PER_S
        fading = float(np.exp(-max(0.0, blind_s - dt_s) / self._config.memory_s))
        step = self.twist * dt_s * fading
        T = last @ se3.exp(step)
        reach_s = max(dt_s, blind_s)
        turn = (self._config.turn_acceleration_radps2 * reach_s + self._config.rate_radps) * dt_s
        shift = (self._config.acceleration_mps2 * reach_s + self._config.velocity_mps) * dt_s
        if len(self._poses) < 2:
            shift, turn = self._unknown_speed * dt_s, 0.2 * self._unknown_speed * dt_s
        covariance = np.diag(np.square(np.repeat([turn + _FLOOR, shift + _FLOOR], 3)))
        return Motion(T, last[:3, :3] @ self.twist[3:] * fading, covariance, is_measured=False)

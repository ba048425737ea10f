# SPDX-License-Identifier: BSD-3-Clause
"""Where the body is expected before it is seen: as the IMU felt, as an odometry says, or as it went on before."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from coclo_vio.backend.window.config import MotionPriorConfig
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.units import NS_PER_S

_BEAT_NS = 100_000_000  # between twists that habits are first believed of
_BEATS_BELIEVED = 20  # how many of those the first belief is worth
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
        self._habit = Habit(config, self._believed(_BEAT_NS / NS_PER_S, _BEAT_NS / NS_PER_S))
        self._beat: tuple[int, Array, Array] | None = None  # when it began, the path then, the twist before it
        self._path: deque[tuple[int, Array]] = deque()  # as it was seen step by step, free of corrections
        self._keyframe_twist: Array | None = None  # None: unknown
        self._last = np.eye(4)
        self._seen_ns, self._seen_twist = 0, np.zeros(6)

    def restart(self, stamp_ns: int, T_world_body: Array) -> None:
        """Know one pose and nothing of its velocity."""
        self._path = deque([(stamp_ns, np.eye(4))])
        self._last, self._seen_ns, self._seen_twist = T_world_body, stamp_ns, np.zeros(6)
        self._beat = self._keyframe_twist = None

    def add(
        self,
        stamp_ns: int,
        T_seen: Array,
        T_world_body: Array,
        covariance: Array | None,
        *,
        is_keyframe: bool,
    ) -> None:
        """Take a frame.

        Args:
            stamp_ns: its time.
            T_seen: its pose in the world of the frame before it: what the motion is told from, (4, 4).
            T_world_body: its pose once the window has been solved; a correction is no motion, (4, 4).
            covariance: of the pose as it was seen, (6, 6); None: not seen, it only carries the last twist on.
            is_keyframe: whether ``since_keyframe`` starts from it.
        """
        self._path.append((stamp_ns, self._path[-1][1] @ se3.inverse(self._last) @ T_seen))
        self._last = T_world_body
        self._learn(stamp_ns, covariance)
        while len(self._path) > 2 and stamp_ns - self._path[1][0] >= _LEAST_SPAN_NS:
            self._path.popleft()
        if covariance is not None:
            self._seen_ns, self._seen_twist = stamp_ns, self.twist
        if is_keyframe:
            self._keyframe_twist = self.twist

    def _learn(self, stamp_ns: int, covariance: Array | None) -> None:
        """Hold the twist of a beat against the one of the beat before; what was not seen teaches nothing."""
        if covariance is None:
            self._beat = None
            return
        path = self._path[-1][1]
        if self._beat is None:
            self._beat = (stamp_ns, path, np.full(6, np.nan))
            return
        began_ns, at_begin, before = self._beat
        dt_s = (stamp_ns - began_ns) / NS_PER_S
        if stamp_ns - began_ns < _LEAST_SPAN_NS:
            return
        now = se3.log(se3.inverse(at_begin) @ path) / dt_s
        if not np.isnan(before).any():
            self._habit.learn(before, now, np.diag(covariance) / dt_s**2, dt_s)
        self._beat = (stamp_ns, path, now)

    @property
    def twist(self) -> Array:
        """Rotation rad/s and translation m/s in the body frame, (6,); zero as long as one pose is known."""
        (first_ns, first), (last_ns, last) = self._path[0], self._path[-1]
        if last_ns <= first_ns:
            return np.zeros(6)
        return se3.log(se3.inverse(first) @ last) * (NS_PER_S / (last_ns - first_ns))

    def at(self, stamp_ns: int) -> Motion:
        """What is expected at ``stamp_ns``, from the last pose on."""
        last_ns, last = self._path[-1][0], self._last
        dt_s = (stamp_ns - last_ns) / NS_PER_S
        blind_s = (stamp_ns - self._seen_ns) / NS_PER_S
        fading = float(np.exp(-max(0.0, blind_s - dt_s) / self._config.memory_s))
        kept = self._habit.kept(max(dt_s, blind_s)) * fading
        twist = self._seen_twist * kept
        T = last @ se3.exp(twist * dt_s)
        covariance = self.covariance(dt_s, max(dt_s, blind_s))
        if len(self._path) < 2:
            covariance = self._unknown(dt_s)
        return Motion(T, last[:3, :3] @ twist[3:], covariance, np.zeros((3, 3)), is_measured=False)

    def since_keyframe(self, dt_s: float) -> tuple[Array, Array]:
        """The motion (4, 4) over ``dt_s`` from the last keyframe on, and its covariance (6, 6).

        It is told from nothing that was seen after that keyframe, which counts by itself.
        """
        if self._keyframe_twist is None:
            return np.eye(4), self._unknown(dt_s)
        return se3.exp(self._keyframe_twist * self._habit.kept(dt_s) * dt_s), self.covariance(dt_s)

    def _unknown(self, dt_s: float) -> Array:
        """The covariance (6, 6) of a motion that nothing is known of."""
        shift, turn = self._unknown_speed * dt_s, 0.2 * self._unknown_speed * dt_s
        return np.diag(np.square(np.repeat([turn + _FLOOR, shift + _FLOOR], 3)))

    def covariance(self, dt_s: float, reach_s: float | None = None) -> Array:
        """How far motion is from steady over ``dt_s``, the twist being ``reach_s`` old at its end, (6, 6)."""
        reach_s = dt_s if reach_s is None else reach_s
        sigmas = np.minimum(self._habit.sigmas(reach_s), self._believed(dt_s, reach_s)) * dt_s
        return np.diag(np.square(sigmas + _FLOOR))

    def _believed(self, dt_s: float, reach_s: float) -> Array:
        """How far twists are from steady at most, one sigma, (6,)."""
        config = self._config
        turn = config.turn_acceleration_radps2 * reach_s + config.rate_radps
        shift = config.acceleration_mps2 * reach_s + config.velocity_mps
        return np.repeat([turn, shift], 3)


class Habit:
    """How steadily a body moves, learnt axis by axis from its own motion: a first-order autoregression of its twist.

    A twist that comes next is ``kept * twist`` give or take its innovation, both from the moments of pairs of twists
    that follow one another (Yule and Walker's equations), which forget with a time constant. What the poses are
    uncertain by counts as innovation: an axis that is badly seen does not look steady for it.
    """

    def __init__(self, config: MotionPriorConfig, sigmas: Array) -> None:
        self._memory_s, self._caution = config.habit_s, config.habit_caution
        self._beat_s = _BEAT_NS / NS_PER_S
        self._before = self._both = np.square(sigmas)
        self._now = self._before + np.square(sigmas)
        self._learnt_s = 0.0

    def learn(self, before: Array, now: Array, variance: Array, dt_s: float) -> None:
        """Take two twists (6,) that follow each other after ``dt_s``, and the variance (6,) of the later one."""
        self._learnt_s = min(self._memory_s, self._learnt_s + dt_s)
        gain = dt_s / (self._learnt_s + _BEATS_BELIEVED * self._beat_s)
        self._beat_s += gain * (dt_s - self._beat_s)
        self._before = self._before + gain * (before**2 - self._before)
        self._both = self._both + gain * (before * now - self._both)
        self._now = self._now + gain * (now**2 + variance - self._now)

    def kept(self, reach_s: float) -> Array:
        """The share of a twist that is left after ``reach_s``, by axis, (6,)."""
        return np.asarray(self._share ** (reach_s / self._beat_s))

    def sigmas(self, reach_s: float) -> Array:
        """How far a twist may be from what is left of it after ``reach_s``, one sigma, (6,)."""
        share = self._share
        innovation = self._now - 2.0 * share * self._both + share**2 * self._before
        return np.asarray(self._caution * np.sqrt(np.maximum(innovation, 0.0) * max(1.0, reach_s / self._beat_s)))

    @property
    def _share(self) -> Array:
        return np.clip(self._both / np.maximum(self._before, 1e-12), 0.0, 1.0)

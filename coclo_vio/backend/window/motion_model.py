# SPDX-License-Identifier: BSD-3-Clause
"""The constant-velocity model: motion predicted from the motion before, where neither IMU nor odometry measures it."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from coclo_vio.backend.window.config import MotionPriorConfig
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.units import NS_PER_S

_STEP_NS = 100_000_000  # expected interval of the twists that the autoregression learns from
_PRIOR_STEPS = 20  # weight of the configured moments, in learnt steps
_LEAST_SPAN_NS = 80_000_000  # over which a velocity is derived from two poses
_FLOOR = 1e-4  # rad and m: no prediction is more certain than this


@dataclass(frozen=True, slots=True, eq=False)
class PredictedMotion:
    """Prediction of a frame.

    Attributes:
        T_world_body: (4, 4).
        velocity_world: m/s, (3,).
        covariance: of the right/local error of the pose since the last frame or keyframe, (6, 6).
        velocity_gain: error of the velocity, m/s, for each metre of position error, world frame, (3, 3).
        is_measured: whether an IMU or odometry measured the motion; otherwise it is assumed to continue.
    """

    T_world_body: Array
    velocity_world: Array
    covariance: Array
    velocity_gain: Array
    is_measured: bool


class ConstantVelocityModel:
    """The twist between the last poses continues; it decays exponentially while there is no vision."""

    def __init__(self, config: MotionPriorConfig, unknown_speed_mps: float) -> None:
        self._config, self._unknown_speed = config, unknown_speed_mps
        self._autoregression = TwistAutoregression(
            config, self._configured_sigmas(_STEP_NS / NS_PER_S, _STEP_NS / NS_PER_S)
        )
        self._step: tuple[int, Array, Array] | None = None  # its begin, the path at that time, the twist before it
        self._path: deque[tuple[int, Array]] = deque()  # motions from frame to frame, without corrections
        self._keyframe_twist: Array | None = None  # None: unknown
        self._last = np.eye(4)
        self._vision_ns, self._vision_twist = 0, np.zeros(6)  # of the last frame with vision

    def restart(self, stamp_ns: int, T_world_body: Array) -> None:
        """Start from one pose with unknown velocity."""
        self._path = deque([(stamp_ns, np.eye(4))])
        self._last, self._vision_ns, self._vision_twist = T_world_body, stamp_ns, np.zeros(6)
        self._step = self._keyframe_twist = None

    def add(
        self,
        stamp_ns: int,
        T_measured: Array,
        T_world_body: Array,
        covariance: Array | None,
        *,
        is_keyframe: bool,
    ) -> None:
        """Add a frame.

        Args:
            stamp_ns: time of the frame.
            T_measured: its pose in the world of the frame before it, from which the twist is computed, (4, 4).
            T_world_body: its pose once the window has been solved; a correction is not a motion, (4, 4).
            covariance: of the measured pose, (6, 6); None where it is a prediction without vision.
            is_keyframe: whether ``since_keyframe`` starts from it.
        """
        self._path.append((stamp_ns, self._path[-1][1] @ se3.inverse(self._last) @ T_measured))
        self._last = T_world_body
        self._learn(stamp_ns, covariance)
        while len(self._path) > 2 and stamp_ns - self._path[1][0] >= _LEAST_SPAN_NS:
            self._path.popleft()
        if covariance is not None:
            self._vision_ns, self._vision_twist = stamp_ns, self.twist
        if is_keyframe:
            self._keyframe_twist = self.twist

    def _learn(self, stamp_ns: int, covariance: Array | None) -> None:
        """Give the autoregression the twists of two successive steps; predicted frames are left out."""
        if covariance is None:
            self._step = None
            return
        path = self._path[-1][1]
        if self._step is None:
            self._step = (stamp_ns, path, np.full(6, np.nan))
            return
        began_ns, at_begin, before = self._step
        dt_s = (stamp_ns - began_ns) / NS_PER_S
        if stamp_ns - began_ns < _LEAST_SPAN_NS:
            return
        now = se3.log(se3.inverse(at_begin) @ path) / dt_s
        if not np.isnan(before).any():
            self._autoregression.learn(before, now, np.diag(covariance) / dt_s**2, dt_s)
        self._step = (stamp_ns, path, now)

    @property
    def twist(self) -> Array:
        """Rotation rad/s and translation m/s in the body frame, (6,); zero as long as one pose is known."""
        (first_ns, first), (last_ns, last) = self._path[0], self._path[-1]
        if last_ns <= first_ns:
            return np.zeros(6)
        return se3.log(se3.inverse(first) @ last) * (NS_PER_S / (last_ns - first_ns))

    def at(self, stamp_ns: int) -> PredictedMotion:
        """The prediction at ``stamp_ns``, from the last pose on."""
        last_ns, last = self._path[-1][0], self._last
        dt_s = (stamp_ns - last_ns) / NS_PER_S
        without_vision_s = (stamp_ns - self._vision_ns) / NS_PER_S
        decay = float(np.exp(-max(0.0, without_vision_s - dt_s) / self._config.decay_s))
        kept = self._autoregression.kept(max(dt_s, without_vision_s)) * decay
        twist = self._vision_twist * kept
        T = last @ se3.exp(twist * dt_s)
        covariance = self.covariance(dt_s, max(dt_s, without_vision_s))
        if len(self._path) < 2:
            covariance = self._unknown(dt_s)
        return PredictedMotion(T, last[:3, :3] @ twist[3:], covariance, np.zeros((3, 3)), is_measured=False)

    def since_keyframe(self, dt_s: float) -> tuple[Array, Array]:
        """The motion (4, 4) over ``dt_s`` from the last keyframe on, and its covariance (6, 6).

        It uses no frame after that keyframe: their observations enter the window by themselves.
        """
        if self._keyframe_twist is None:
            return np.eye(4), self._unknown(dt_s)
        return se3.exp(self._keyframe_twist * self._autoregression.kept(dt_s) * dt_s), self.covariance(dt_s)

    def _unknown(self, dt_s: float) -> Array:
        """The covariance (6, 6) of a motion of unknown velocity."""
        translation, rotation = self._unknown_speed * dt_s, 0.2 * self._unknown_speed * dt_s
        return np.diag(np.square(np.repeat([rotation + _FLOOR, translation + _FLOOR], 3)))

    def covariance(self, dt_s: float, age_s: float | None = None) -> Array:
        """Covariance of the predicted motion over ``dt_s``, whose twist is ``age_s`` old at its end, (6, 6)."""
        age_s = dt_s if age_s is None else age_s
        sigmas = np.minimum(self._autoregression.sigmas(age_s), self._configured_sigmas(dt_s, age_s)) * dt_s
        return np.diag(np.square(sigmas + _FLOOR))

    def _configured_sigmas(self, dt_s: float, age_s: float) -> Array:
        """Largest deviation from a constant twist, one sigma, (6,)."""
        config = self._config
        rotation = config.turn_acceleration_radps2 * age_s + config.rate_radps
        translation = config.acceleration_mps2 * age_s + config.velocity_mps
        return np.repeat([rotation, translation], 3)


class TwistAutoregression:
    """How constant a body's twist is, axis by axis: a first-order autoregression learnt from its own motion.

    The next twist is ``kept * twist`` plus an innovation, both from the moments of successive twists (Yule and Walker's
    equations), which forget with a time constant. The uncertainty of the poses counts as innovation, so that an axis
    that is badly observed does not look constant.
    """

    def __init__(self, config: MotionPriorConfig, sigmas: Array) -> None:
        self._memory_s, self._inflation = config.learning_s, config.learnt_sigma_inflation
        self._step_s = _STEP_NS / NS_PER_S
        self._before = self._both = np.square(sigmas)
        self._now = self._before + np.square(sigmas)
        self._learnt_s = 0.0
        self._share = self._share_now()  # of a twist that is left after a step

    def learn(self, before: Array, now: Array, variance: Array, dt_s: float) -> None:
        """Add two twists (6,) that follow each other after ``dt_s``, and the variance (6,) of the later one."""
        self._learnt_s = min(self._memory_s, self._learnt_s + dt_s)
        gain = dt_s / (self._learnt_s + _PRIOR_STEPS * self._step_s)
        self._step_s += gain * (dt_s - self._step_s)
        self._before = self._before + gain * (before**2 - self._before)
        self._both = self._both + gain * (before * now - self._both)
        self._now = self._now + gain * (now**2 + variance - self._now)
        self._share = self._share_now()

    def kept(self, age_s: float) -> Array:
        """The share of a twist that is left after ``age_s``, by axis, (6,)."""
        return np.asarray(self._share ** (age_s / self._step_s))

    def sigmas(self, age_s: float) -> Array:
        """Deviation of a twist from what is left of it after ``age_s``, one sigma, inflated, (6,)."""
        share = self._share
        innovation = self._now - 2.0 * share * self._both + share**2 * self._before
        return np.asarray(self._inflation * np.sqrt(np.maximum(innovation, 0.0) * max(1.0, age_s / self._step_s)))

    def _share_now(self) -> Array:
        return np.clip(self._both / np.maximum(self._before, 1e-12), 0.0, 1.0)

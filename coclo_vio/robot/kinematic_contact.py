# SPDX-License-Identifier: BSD-3-Clause
"""Contact from joint positions, joint velocities and the IMU alone: which feet stand, as a probability.

Each foot gives the velocity that the body has if this foot stands (``foot_motion``). A Bayes filter runs over all sets
of standing feet, 2^n of them: every foot swings or stands, and changes at a constant rate, the faster the stronger the
accelerometer jumps (an impact). A set is likely where

* its feet agree with each other on the body's velocity, and with the velocity that the accelerometer predicts since
  the last sample; feet that swing have any velocity, of the size that feet have in this recording;
* its feet are at one depth below the body along gravity, and the others above.

The predicted velocity and depth are this filter's own, one Gaussian each for all sets (a generalised pseudo-Bayesian
filter of first order: Bar-Shalom, Li and Kirubarajan, "Estimation with applications to tracking and navigation", 11.6).
Of the leg odometry's estimate it takes the direction of gravity only. Errors of velocities last for some samples, so a
sample counts as its share of ``velocity_memory_s``: probabilities do not become certain by repetition.
"""

from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from coclo_vio.geometry.compiled import IS_COMPILED
from coclo_vio.robot import kinematic_kernel
from coclo_vio.robot.foot_motion import FootMotion
from coclo_vio.robot.kinematic_kernel import FootEvidence, Scales
from coclo_vio.values.arrays import Array
from coclo_vio.values.config import StageConfig
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.units import GRAVITY_MPS2, NS_PER_S

MOST_LEGS = 8
_LONGEST_STEP_S = 0.05  # a longer step is a gap: the accelerometer does not bridge it
_GAP_ACCELERATION = 3.0  # m/s^2, of a body in a gap, or without an accelerometer
_REST_SIGMA_MPS = 0.02
_SPEED_MEMORY_S = 3.0  # of the speed of the feet
_JERK_MEMORY_S = 1.0
_USUAL_JERK = 2.0  # times the mean jump of the accelerometer, up to which it is none
_DEPTH_WALK = 0.3  # of the ground below the body, m/sqrt(s): the body rises and falls
_LEAST_SIGMA_M = 0.003
_LIMIT = 1e-6  # the least probability of a set


class KinematicContactConfig(StageConfig):
    """Contact by the motion of the feet."""

    velocity_sigma_mps: Annotated[
        float, Field(gt=0, le=2, description="velocity of a standing foot (bending, slip, touch-down), m/s")
    ] = 0.08
    vertical_factor: Annotated[
        float, Field(ge=1, le=10, description="how much smaller that velocity is along the vertical: feet do not rise")
    ] = 2.0
    velocity_memory_s: Annotated[
        float, Field(gt=0, le=0.5, description="velocities within this time count as one measurement, s")
    ] = 0.01
    least_swing_mps: Annotated[
        float, Field(gt=0, le=5, description="least one sigma of the velocity of swing feet, m/s")
    ] = 0.5
    phase_s: Annotated[float, Field(gt=0, le=10, description="mean length of a stance and of a swing, s")] = 0.25
    acceleration_density: Annotated[
        float, Field(gt=0, le=10, description="random walk of the velocity by the accelerometer, m/s/sqrt(s)")
    ] = 0.3
    height_sigma_m: Annotated[float, Field(gt=0, le=1, description="unevenness of the ground between feet, m")] = 0.03
    clearance_m: Annotated[float, Field(gt=0, le=1, description="mean height of a swing foot, m")] = 0.05
    height_memory_s: Annotated[
        float, Field(gt=0, le=5, description="heights within this time count as one measurement, s")
    ] = 0.05
    impact_gain: Annotated[
        float, Field(ge=0, le=100, description="factor on the rate of touch-downs by a jump of the accelerometer")
    ] = 5.0
    on_probability: Annotated[float, Field(gt=0, lt=1, description="from which a swing foot is in stance")] = 0.9
    off_probability: Annotated[float, Field(gt=0, lt=1, description="below which a stance foot swings")] = 0.5
    load_limit: Annotated[
        float, Field(ge=0, le=10, description="most that a load may say, in logarithms of odds (kinematic_load)")
    ] = 2.0

    @model_validator(mode="after")
    def _probabilities_are_in_order(self) -> Self:
        if self.off_probability > self.on_probability:
            raise ValueError(
                f"off_probability = {self.off_probability} must not lie above on_probability = {self.on_probability}"
            )
        return self


@dataclass(slots=True)
class _Body:
    """Predicted velocity (m/s, body axes, (3,)) and depth of the ground below the body (m), with their variances."""

    velocity: Array
    variance: float
    depth_m: float
    depth_variance: float


def weigh(chances: Array, feet: FootEvidence, scales: Scales) -> Array:
    """Multiply the chances of all sets of standing feet by their likelihoods, in place.

    With ``d_i`` and ``r_i`` velocity and variance of foot i relative to the prediction, whose variance is p, and
    ``W = 1/p + sum_S 1/r_i``, the logarithm of the likelihood of a set S is, but for constants,

        -1/2 (sum_S |d_i|^2/r_i - |sum_S d_i/r_i|^2/W) - 3/2 (log(p W) + sum_S log r_i) + swing feet by N(0, q + p),

    and alike for depths.

    Args:
        chances: of each set, (2^n,); bit i of the index says that foot i stands.
        feet: of the sample.
        scales: numbers of the step.

    Returns:
        Correction of the body's velocity (3,) and its variance after it, of the depth of the ground and its variance.
    """
    known = feet.is_known
    stands = (((np.arange(len(chances))[:, None] >> np.arange(len(known))) & 1) == 1)[:, known]
    velocity, odds = feet.velocity[known], feet.odds[known]
    swing = scales.swing_variance + scales.velocity_variance
    variance = np.where(stands, feet.variance[known], swing)
    squares = np.sum(velocity**2, axis=1)
    weight = 1.0 / scales.velocity_variance + np.sum(stands / variance, axis=1)
    total = (stands / variance) @ velocity
    log_velocity = -0.5 * (squares / variance + 3.0 * np.log(variance)).sum(axis=1)
    log_velocity += 0.5 * np.sum(total**2, axis=1) / weight - 1.5 * np.log(weight * scales.velocity_variance)
    error = feet.depth_m[known] + np.where(stands, 0.0, scales.clearance_m)
    height_variance = np.where(stands, scales.height_variance, scales.clearance_m**2)
    depth_weight = 1.0 / scales.depth_variance + (1.0 / height_variance).sum(axis=1)
    log_height = -0.5 * (error**2 / height_variance + np.log(height_variance)).sum(axis=1)
    log_height += 0.5 * (error / height_variance).sum(axis=1) ** 2 / depth_weight
    log_height -= 0.5 * np.log(depth_weight * scales.depth_variance)
    log = np.log(chances + 1e-12) + scales.share * log_velocity + scales.height_share * log_height + stands @ odds
    chances[:] = np.exp(log - log.max())
    chances /= chances.sum()
    after = 1.0 / scales.velocity_variance + scales.share * np.sum(stands / variance, axis=1)
    means = scales.share * total / after[:, None]
    mean = chances @ means
    spread = chances @ (1.0 / after + np.sum(means**2, axis=1) / 3.0) - mean @ mean / 3.0
    depth_after = 1.0 / scales.depth_variance + scales.height_share * (1.0 / height_variance).sum(axis=1)
    depths = scales.height_share * (error / height_variance).sum(axis=1) / depth_after
    depth = float(chances @ depths)
    return np.array([*mean, spread, depth, chances @ (1.0 / depth_after + depths**2) - depth**2])


class KinematicContact:
    """Probability that each foot stands, from one ``FootMotion`` after the other.

    Raises:
        ConfigError: a robot with more than ``MOST_LEGS`` legs.
    """

    def __init__(self, config: KinematicContactConfig, legs: int, *, is_compiled: bool = IS_COMPILED) -> None:
        """Take parameters.

        Args:
            config: parameters.
            legs: how many.
            is_compiled: by kernels, or by NumPy.
        """
        if legs > MOST_LEGS:
            raise ConfigError(
                f"contact by kinematics follows all sets of standing feet, and {legs} legs are more than {MOST_LEGS}; "
                "set contact.source to torque or force_sensor"
            )
        self._config, self._legs = config, legs
        self._weigh = kinematic_kernel.weigh if is_compiled else weigh
        self._sets = (np.arange(2**legs)[:, None] >> np.arange(legs) & 1).astype(np.float64)
        self._chances: Array = np.full(2**legs, 0.5**legs)
        self._body: _Body | None = None
        self._turning: Array = np.zeros(3)
        self._stamp_ns = 0
        self._force: Array | None = None
        self._mean_jerk: float = 1.0
        self._mean_square = 1.0

    @property
    def body_velocity(self) -> Array | None:
        """Velocity of the body origin, m/s, body axes, (3,); None before the first sample."""
        return None if self._body is None else self._body.velocity

    @property
    def velocity_variance(self) -> float:
        """Variance of ``body_velocity``, each axis, m^2/s^2."""
        return 1.0 if self._body is None else self._body.variance

    def update(self, motion: FootMotion, odds: Array | None = None) -> Array:
        """Probability of stance of each foot, (n,); 0 where its kinematics are unknown.

        Args:
            motion: of the feet, newer than the last one.
            odds: logarithms of the odds of stance by another source, such as the load, (n,).
        """
        config = self._config
        known = np.isfinite(motion.body_velocity[:, 0])
        if self._body is None:
            depth_m = float(motion.depth_m[known].max()) if known.any() else 0.0
            self._body, dt_s = _Body(np.zeros(3), 1.0, depth_m, 0.01), config.velocity_memory_s
        else:
            dt_s = (motion.stamp_ns - self._stamp_ns) / NS_PER_S
        body = self._body
        self._predict(body, motion, dt_s)
        share = min(1.0, dt_s / config.velocity_memory_s)
        self._exchange(motion, dt_s)
        up, factor = motion.up_body, config.vertical_factor
        feet = FootEvidence(
            np.where(known[:, None], _stretched(motion.body_velocity - body.velocity, up, factor), 0.0),
            config.velocity_sigma_mps**2 + motion.velocity_variance,
            np.where(known, motion.depth_m - body.depth_m, 0.0),
            np.zeros(self._legs) if odds is None else share * odds,
            known,
        )
        found = self._weigh(self._chances, feet, self._scales(body, motion, known, dt_s, share))
        self._chances = np.maximum(self._chances, _LIMIT)
        self._chances /= self._chances.sum()
        body.velocity = body.velocity + _stretched(found[:3], up, 1.0 / factor)
        body.variance = max(float(found[3]), _REST_SIGMA_MPS**2)
        body.depth_m += float(found[4])
        body.depth_variance = max(float(found[5]), _LEAST_SIGMA_M**2)
        if motion.is_stationary:
            body.velocity, body.variance = np.zeros(3), _REST_SIGMA_MPS**2
        self._stamp_ns, self._turning = motion.stamp_ns, motion.imu_turning
        return np.where(known, self._chances @ self._sets, 0.0)

    def _scales(self, body: _Body, motion: FootMotion, known: Array, dt_s: float, share: float) -> Scales:
        config = self._config
        if known.any():
            speeds = motion.foot_speed[known]
            self._mean_square += min(1.0, dt_s / _SPEED_MEMORY_S) * (
                float(speeds @ speeds) / len(speeds) - self._mean_square
            )
        return Scales(
            body.variance,
            max(config.least_swing_mps**2, 4.0 / 3.0 * self._mean_square),
            body.depth_variance,
            config.height_sigma_m**2,
            config.clearance_m,
            share,
            min(1.0, dt_s / config.height_memory_s),
        )

    def _predict(self, body: _Body, motion: FootMotion, dt_s: float) -> None:
        """By the accelerometer: ``v' = v + (f - g - w x v) dt`` at the IMU, which moves by ``w x lever`` beside."""
        force, config = motion.specific_force, self._config
        if force is None or dt_s > _LONGEST_STEP_S:
            body.variance += (_GAP_ACCELERATION * dt_s) ** 2
        else:
            velocity = body.velocity + self._turning
            gravity = GRAVITY_MPS2 * motion.up_body
            velocity = velocity + dt_s * (force - gravity - _cross(motion.angular_velocity, velocity))
            body.velocity = velocity - motion.imu_turning
        body.variance = min(body.variance + config.acceleration_density**2 * dt_s, 4.0)
        body.depth_variance = min(body.depth_variance + _DEPTH_WALK**2 * dt_s, 1.0)

    def _exchange(self, motion: FootMotion, dt_s: float) -> None:
        """Feet lift off and touch down."""
        rate, boost = 1.0 / self._config.phase_s, 1.0
        if motion.specific_force is not None and self._force is not None:
            jerk = float(np.linalg.norm(motion.specific_force - self._force))
            boost += self._config.impact_gain * max(0.0, jerk / max(self._mean_jerk, 1e-3) - _USUAL_JERK)
            self._mean_jerk += min(1.0, dt_s / _JERK_MEMORY_S) * (jerk - self._mean_jerk)
        self._force = motion.specific_force
        falling = 0.5 * -np.expm1(-2.0 * rate * dt_s)
        rising = 0.5 * -np.expm1(-2.0 * rate * boost * dt_s)
        kinematic_kernel.exchange(self._chances, np.full(self._legs, rising), float(falling))


def _stretched(vectors: Array, up_body: Array, factor: float) -> Array:
    """Vectors (n, 3) or (3,) with their vertical part multiplied."""
    along = vectors @ up_body
    return vectors + (factor - 1.0) * along[..., None] * up_body


def _cross(a: Array, b: Array) -> Array:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])

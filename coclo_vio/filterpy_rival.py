# SPDX-License-Identifier: BSD-3-Clause
"""The robust profile's models on filterpy's ``UnscentedKalmanFilter``, for comparing speeds.

The state is a plain vector of the same length in the same order, rotation as a rotation vector of ``R_world_body``;
process and measurement take one sigma point at a time, as filterpy wants it, in as few NumPy calls as they allow. What
does not depend on the state is worked out beforehand and not timed. No gate, no standstill. filterpy is a development
tool, imported here only and only when asked for.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from time import process_time
from typing import Any

import numpy as np

from coclo_vio.arrays import Array, IntArray
from coclo_vio.filter import process
from coclo_vio.filter.config import RobustConfig
from coclo_vio.filter.stance import Footholds, FootMotion, Reading
from coclo_vio.filter.state import (
    ACCELEROMETER_BIAS,
    GYROSCOPE_BIAS,
    LEG_SCALE,
    POSITION,
    RATE,
    ROTATION,
    VELOCITY,
    State,
)
from coclo_vio.geometry import so3
from coclo_vio.robot.foot_load import GRAVITY_MPS2
from coclo_vio.robot.model import RobotModel

_LEAST_VARIANCE = 1e-8  # of every state at the start: filterpy's Cholesky needs a definite covariance
_NS_PER_S = 1_000_000_000


def has_filterpy() -> bool:
    """Whether filterpy is installed (``pip install coclo-vio[dev]``)."""
    try:
        import filterpy.kalman  # noqa: F401, PLC0415
    except ImportError:
        return False
    return True


@dataclass(frozen=True, slots=True, eq=False)
class _Inputs:
    """All of one cycle that depends on no state: the step, the feet, the measured values and their noise."""

    dt_s: float
    motion: FootMotion
    foot_noise: Array
    legs: IntArray
    sees_gravity: bool
    levers_cross: Array
    rolling: Array
    measured: Array
    noise: Array


class FilterpyRival:
    """filterpy's filter with our models; ``start`` as ours starts, from a mean and a covariance of its errors."""

    def __init__(self, robot: RobotModel, config: RobustConfig, mean: State, covariance: Array) -> None:
        from filterpy.kalman import JulierSigmaPoints, UnscentedKalmanFilter  # noqa: PLC0415

        self._robot, self._config, self._mean = robot, config, mean
        self._radii_m, self._hips = robot.foot_radii_m, robot.hip_position_body
        length = mean.layout.dimension
        points = JulierSigmaPoints(length, kappa=0.0)
        self.ukf: Any = UnscentedKalmanFilter(length, 3, 0.01, self._observe, self._move, points)
        self.ukf.x = mean.vector.copy()
        self.ukf.x[ROTATION] = so3.log(mean.rotation)
        self.ukf.P = covariance + _LEAST_VARIANCE * np.eye(length)

    @property
    def position(self) -> Array:
        """Where the body is, m, world, (3,)."""
        return np.array(self.ukf.x[POSITION])

    def run(self, readings: Sequence[Reading], gyroscope_noise_density: float) -> float:
        """Take the readings after the first; returns the seconds of processor time in predict and update."""
        footholds = Footholds(readings[0])
        taken_s = 0.0
        for before, reading in pairwise(readings):
            dt_s = (reading.stamp_ns - before.stamp_ns) / _NS_PER_S
            inputs = self._inputs(reading, footholds, dt_s, gyroscope_noise_density / math.sqrt(dt_s))
            self.ukf.Q = self._process_noise(inputs)
            started_s = process_time()
            self.ukf.predict(dt_s, inputs=inputs)
            self.ukf.update(inputs.measured, R=inputs.noise, inputs=inputs)
            taken_s += process_time() - started_s
        return taken_s

    def _move(self, x: Array, dt_s: float, inputs: _Inputs) -> Array:
        """``process.predict`` for one state."""
        motion, moved = inputs.motion, x.copy()
        rotation = _rotation(x[ROTATION])
        turn = x[RATE] * dt_s
        rotated = rotation @ _rotation(turn)
        moved[ROTATION] = _rotation_vector(rotated)
        position = x[POSITION] + x[VELOCITY] * dt_s
        moved[POSITION] = position
        foot_turn = turn + motion.turn_body - 0.5 * np.cross(motion.turn_body, turn)
        feet = x[self._mean.layout.feet].reshape(-1, 3)
        turned = foot_turn @ rotation.T
        rolled = feet.copy()
        rolled[:, 0] += self._radii_m * turned[:, 1]
        rolled[:, 1] -= self._radii_m * turned[:, 0]
        legs = motion.position_body.copy()
        legs[:, :2] += x[LEG_SCALE] * (legs - self._hips)[:, :2]
        carried = position + legs @ rotated.T
        moved[self._mean.layout.feet] = np.where(motion.holds[:, None], rolled, carried).ravel()
        return moved

    def _observe(self, x: Array, inputs: _Inputs) -> Array:
        """The blocks of ``observation`` for one state."""
        rotation = _rotation(x[ROTATION])
        scale, legs = x[LEG_SCALE], inputs.legs
        velocity = x[VELOCITY] @ rotation + x[RATE] @ inputs.levers_cross
        velocity[:, :2] -= scale * (velocity - inputs.rolling)[:, :2]
        held = legs[inputs.motion.holds[legs]]
        position = (x[self._mean.layout.feet].reshape(-1, 3)[held] - x[POSITION]) @ rotation
        position[:, :2] -= scale * (inputs.motion.position_body - self._hips)[held, :2]
        rows = [x[RATE] + x[GYROSCOPE_BIAS], velocity.ravel(), position.ravel()]
        if inputs.sees_gravity:
            rows.append(GRAVITY_MPS2 * rotation[2] + x[ACCELEROMETER_BIAS])
        return np.concatenate(rows)

    def _inputs(self, reading: Reading, footholds: Footholds, dt_s: float, gyroscope_noise: float) -> _Inputs:
        config, robot = self._config, self._robot.description
        motion, feet = footholds.advance(reading, is_gap=False), reading.feet
        linear = feet.jacobian[:, 3:]
        encoders = linear @ np.swapaxes(linear, 1, 2) * robot.encoder_noise_rad**2
        position_noise = encoders + config.foot_position_noise_m**2 * np.eye(3)
        arms = self._radii_m[:, None] * _rotation(self.ukf.x[ROTATION])[2]
        contact = linear + so3.hat(arms) @ feet.jacobian[:, :3]
        velocity_noise = contact @ np.swapaxes(contact, 1, 2) * robot.joint_velocity_noise_radps**2
        velocity_noise += config.foot_velocity_noise_mps**2 * np.eye(3)
        legs = np.flatnonzero(reading.is_stance)
        held = legs[motion.holds[legs]]
        rolling = np.cross(feet.angular_velocity_body, arms)[legs]
        rate, force = reading.angular_velocity, reading.specific_force
        assert rate is not None, "an analytic trial has a gyroscope reading at every joint sample"
        sees_gravity = force is not None and bool(reading.is_stance.all())
        measured = [rate, (rolling - feet.velocity_body[legs]).ravel(), feet.position_body[held].ravel()]
        noises = [gyroscope_noise**2 * np.eye(3), *velocity_noise[legs], *position_noise[held]]
        if force is not None and sees_gravity:
            measured.append(force)
            noises.append(config.gravity_noise_mps2**2 * np.eye(3))
        noise = np.zeros((3 * len(noises), 3 * len(noises)))
        for number, block in enumerate(noises):
            noise[3 * number : 3 * number + 3, 3 * number : 3 * number + 3] = block
        return _Inputs(
            dt_s,
            motion,
            np.asarray(np.linalg.cholesky(position_noise)),
            legs,
            sees_gravity,
            so3.hat((feet.position_body - arms)[legs]),
            rolling,
            np.concatenate(measured),
            noise,
        )

    def _process_noise(self, inputs: _Inputs) -> Array:
        """Q of ``process.noise_rows``, led from errors that turn the world to plain ones."""
        mean = replace(self._mean, rotation=_rotation(self.ukf.x[ROTATION]), vector=self.ukf.x)
        rows = process.noise_rows(
            mean,
            inputs.dt_s,
            inputs.motion,
            radii_m=self._radii_m,
            foot_noise=inputs.foot_noise,
            config=self._config,
            imu=self._robot.description.imu,
        )
        world = mean.layout.world
        turned = np.einsum("nij,rj->rni", -so3.hat(mean.vector[world].reshape(-1, 3)), rows[:, ROTATION])
        rows[:, world] += turned.reshape(len(rows), -1)
        return np.asarray(rows.T @ rows)


def _rotation(rotation_vector: Array) -> Array:
    """``so3.exp`` of one vector, in scalars."""
    x, y, z = rotation_vector.tolist()
    squared = x * x + y * y + z * z
    angle = math.sqrt(squared)
    sinc = math.sin(angle) / angle if angle > 1e-9 else 1.0
    half = (1.0 - math.cos(angle)) / squared if angle > 1e-5 else 0.5
    return np.array(
        (
            (1.0 - half * (y * y + z * z), half * x * y - sinc * z, half * x * z + sinc * y),
            (half * x * y + sinc * z, 1.0 - half * (x * x + z * z), half * y * z - sinc * x),
            (half * x * z - sinc * y, half * y * z + sinc * x, 1.0 - half * (x * x + y * y)),
        )
    )


def _rotation_vector(rotation: Array) -> tuple[float, float, float]:
    """``so3.log_below_pi`` of one matrix, in scalars."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    x, y, z = 0.5 * (h - f), 0.5 * (c - g), 0.5 * (d - b)
    sine = math.sqrt(x * x + y * y + z * z)
    scale = math.atan2(sine, 0.5 * (a + e + i - 1.0)) / sine if sine > 1e-9 else 1.0
    return scale * x, scale * y, scale * z

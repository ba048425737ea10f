# SPDX-License-Identifier: BSD-3-Clause
"""The robust profile's models on filterpy's ``UnscentedKalmanFilter``, for comparing speeds.

The state is a plain vector of the same length in the same order, rotation as a rotation vector of ``R_world_body``;
process and measurement take one sigma point at a time, as filterpy requires, in as few NumPy calls as they allow. What
does not depend on the state is worked out beforehand and not timed. A window of gravity is an update of its own, as it
is in ours. No gate, no standstill. filterpy is a development tool, imported here only, inside the functions.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from time import process_time
from typing import Any

import numpy as np

from coclo_vio.filter import process_model
from coclo_vio.filter.config import RobustConfig
from coclo_vio.filter.foot_weights import unweighed
from coclo_vio.filter.gravity import GravityReading, GravityWindow
from coclo_vio.filter.stance import Footholds, FootMotion, Reading
from coclo_vio.filter.state import (
    ACCELEROMETER_BIAS,
    GYROSCOPE_BIAS,
    LEG_COMPLIANCE,
    LEG_SCALE,
    LOAD_SLIP,
    POSITION,
    RATE,
    ROTATION,
    SLIP,
    SLIP_TURN,
    VELOCITY,
    State,
)
from coclo_vio.geometry import so3
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.units import GRAVITY_MPS2, NS_PER_S

_LEAST_VARIANCE = 1e-8  # of every state at the start: filterpy's Cholesky needs a definite covariance


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
    levers_cross: Array
    rolling: Array
    compliance_velocity: Array
    compliance_axes: Array
    measured: Array
    noise: Array
    speed_mps: float


class FilterpyRival:
    """filterpy's filter with our models; starts as ours does, from a mean and a factor of its errors' covariance."""

    def __init__(self, robot: RobotModel, config: RobustConfig, mean: State, factor: Array) -> None:
        from filterpy.kalman import JulierSigmaPoints, UnscentedKalmanFilter  # noqa: PLC0415

        self._robot, self._config, self._mean = robot, config, mean
        self._radii_m, self._hips = robot.foot_radii_m, robot.hip_position_body
        self._gravity = GravityWindow(config.gravity_dwell_s, config.gravity_window_s)
        length = mean.layout.dimension
        points = JulierSigmaPoints(length, kappa=0.0)
        self.ukf: Any = UnscentedKalmanFilter(length, 3, 0.01, self._observe, self._move, points)
        self.ukf.x = mean.vector.copy()
        self.ukf.x[ROTATION] = so3.log(mean.rotation)
        rows = _plain(mean, factor.T.copy())
        self.ukf.P = rows.T @ rows + _LEAST_VARIANCE * np.eye(length)

    @property
    def position(self) -> Array:
        """Where the body is, m, world, (3,)."""
        return np.array(self.ukf.x[POSITION])

    def run(self, readings: Sequence[Reading], gyroscope_noise_density: float) -> float:
        """Take the readings after the first; returns the seconds of processor time in predict and update."""
        footholds = Footholds(readings[0], self._robot.description.contact.on_force)
        taken_s = 0.0
        for before, reading in pairwise(readings):
            dt_s = (reading.stamp_ns - before.stamp_ns) / NS_PER_S
            inputs = self._inputs(reading, footholds, dt_s, gyroscope_noise_density / math.sqrt(dt_s))
            self.ukf.Q = self._process_noise(inputs)
            started_s = process_time()
            self.ukf.predict(dt_s, inputs=inputs)
            self.ukf.update(inputs.measured, R=inputs.noise, inputs=inputs)
            self._update_gravity(reading)
            taken_s += process_time() - started_s
        return taken_s

    def _move(self, x: Array, dt_s: float, inputs: _Inputs) -> Array:
        """``process_model.predict`` for one state."""
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
        slip = x[SLIP] + np.cross(x[SLIP_TURN], motion.position_body)
        slip = inputs.speed_mps * slip + motion.takeover_speed * x[LOAD_SLIP]
        rolled += slip @ rotation.T * dt_s
        moved[SLIP_TURN.start : LOAD_SLIP.stop] *= math.exp(-dt_s / self._config.slip_memory_s)
        legs = motion.position_body.copy()
        legs[:, :2] += x[LEG_SCALE] * (legs - self._hips)[:, :2]
        carried = position + legs @ rotated.T
        carried[:, 2] += x[LEG_COMPLIANCE] * motion.load_ratio
        moved[self._mean.layout.feet] = np.where(motion.holds[:, None], rolled, carried).ravel()
        return moved

    def _observe(self, x: Array, inputs: _Inputs) -> Array:
        """The blocks of ``measurement_model`` for one state."""
        rotation = _rotation(x[ROTATION])
        scale, compliance_m, legs = x[LEG_SCALE], x[LEG_COMPLIANCE], inputs.legs
        slip = inputs.speed_mps * np.stack((x[SLIP], x[SLIP_TURN]))
        slip[0] += inputs.motion.takeover_speed * x[LOAD_SLIP]
        velocity = x[VELOCITY] @ rotation - slip[0] + (x[RATE] - slip[1]) @ inputs.levers_cross
        velocity[:, :2] -= scale * (velocity - inputs.rolling)[:, :2]
        velocity += inputs.compliance_velocity
        held = legs[inputs.motion.holds[legs]]
        position = (x[self._mean.layout.feet].reshape(-1, 3)[held] - x[POSITION]) @ rotation
        position[:, :2] -= scale * (inputs.motion.position_body - self._hips)[held, :2]
        position -= compliance_m * inputs.compliance_axes
        return np.concatenate((x[RATE] + x[GYROSCOPE_BIAS], velocity.ravel(), position.ravel()))

    def _update_gravity(self, reading: Reading) -> None:
        """The windows of ``RobustProfile``; the sigma points are drawn anew, as filterpy does in ``predict`` only."""
        x, force = self.ukf.x, reading.specific_force
        gravity: GravityReading | None
        if force is None or not reading.is_stance.any():
            gravity = self._gravity.close()
        else:
            rotation, lever = _rotation(x[ROTATION]), np.array(self._robot.description.imu.position_body_m)
            velocity = x[VELOCITY] + rotation @ np.cross(x[RATE], lever)
            gravity = self._gravity.add(reading.stamp_ns, rotation @ force, velocity)
        if gravity is None:
            return
        velocity_variance = float(np.diag(self.ukf.P)[VELOCITY].mean())
        variance = self._config.gravity_noise_mps2**2 + 2.0 * velocity_variance / gravity.duration_s**2
        self.ukf.sigmas_f = self.ukf.points_fn.sigma_points(x, self.ukf.P)
        self.ukf.update(_rotation(x[ROTATION]).T @ gravity.force_world, R=variance * np.eye(3), hx=_expected_force)

    def _inputs(self, reading: Reading, footholds: Footholds, dt_s: float, gyroscope_noise: float) -> _Inputs:
        config, robot = self._config, self._robot.description
        speed_mps = float(np.linalg.norm(self.ukf.x[VELOCITY]))
        motion, feet = footholds.advance(reading, speed_mps=speed_mps, is_gap=False), reading.feet
        linear = feet.jacobian[:, 3:]
        encoders = linear @ np.swapaxes(linear, 1, 2) * robot.encoder_noise_rad**2
        position_noise = encoders + config.foot_position_noise_m**2 * np.eye(3)
        up_body = _rotation(self.ukf.x[ROTATION])[2]
        arms = self._radii_m[:, None] * up_body
        contact = linear + so3.hat(arms) @ feet.jacobian[:, :3]
        velocity_noise = contact @ np.swapaxes(contact, 1, 2) * robot.joint_velocity_noise_radps**2
        velocity_noise += config.foot_velocity_noise_mps**2 * np.eye(3)
        legs = np.flatnonzero(reading.is_stance)
        held = legs[motion.holds[legs]]
        rolling = np.cross(feet.angular_velocity_body, arms)[legs]
        rate = reading.angular_velocity
        assert rate is not None, "an analytic trial has a gyroscope reading at every joint sample"
        measured = [rate, (rolling - feet.velocity_body[legs]).ravel(), feet.position_body[held].ravel()]
        noises = [gyroscope_noise**2 * np.eye(3), *velocity_noise[legs], *position_noise[held]]
        noise = np.zeros((3 * len(noises), 3 * len(noises)))
        for number, block in enumerate(noises):
            noise[3 * number : 3 * number + 3, 3 * number : 3 * number + 3] = block
        return _Inputs(
            dt_s,
            motion,
            np.asarray(np.linalg.cholesky(position_noise)),
            legs,
            so3.hat((feet.position_body - arms)[legs]),
            rolling,
            self.ukf.x[LEG_COMPLIANCE] * motion.load_ratio_rate[legs, None] * up_body,
            motion.load_ratio[held, None] * up_body,
            np.concatenate(measured),
            noise,
            speed_mps,
        )

    def _process_noise(self, inputs: _Inputs) -> Array:
        """Q of ``process_model.noise_rows``."""
        mean = replace(self._mean, rotation=_rotation(self.ukf.x[ROTATION]), vector=self.ukf.x)
        config, legs = self._config, len(self._radii_m)
        rows = process_model.noise_rows(
            mean,
            process_model.Interval(inputs.dt_s, 0.0, config.acceleration_density, unweighed(legs, config).creep),
            inputs.motion,
            radii_m=self._radii_m,
            foot_noise=inputs.foot_noise,
            angular_acceleration=config.angular_acceleration_density,
        )
        rows = _plain(mean, rows)
        return np.asarray(rows.T @ rows)


def _plain(mean: State, rows: Array) -> Array:
    """Rows of deviations (m, L) led from errors that turn the world with the body to plain differences."""
    world = mean.layout.world
    turned = np.einsum("nij,rj->rni", -so3.hat(mean.vector[world].reshape(-1, 3)), rows[:, ROTATION])
    rows[:, world] += turned.reshape(len(rows), -1)
    return rows


def _expected_force(x: Array) -> Array:
    """``measurement_model.specific_force_at_rest`` for one state."""
    force: Array = GRAVITY_MPS2 * _rotation(x[ROTATION])[2] + x[ACCELEROMETER_BIAS]
    return force


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

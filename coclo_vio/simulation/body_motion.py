# SPDX-License-Identifier: BSD-3-Clause
"""The motion of the body in an analytic trial: closed forms for pose, velocity and acceleration at any time.

The body stands, walks along a circular arc with a smooth rise and fall of speed, and stands again; while it walks,
height, roll and pitch sway. Every derivative that an IMU measures is exact.
"""

from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.config import StageConfig
from coclo_vio.values.units import GRAVITY_MPS2


class BodyMotionConfig(StageConfig):
    """When the body stands and walks, how fast, along what curve, and how it sways."""

    rest_s: Annotated[float, Field(ge=0, le=600, description="time at rest before the walk, s")] = 1.0
    walk_s: Annotated[float, Field(ge=0, le=3600, description="time from the first motion to the last, s")] = 8.0
    stop_s: Annotated[float, Field(ge=0, le=600, description="time at rest after the walk, s")] = 1.0
    ramp_s: Annotated[float, Field(gt=0, le=10, description="time to reach full speed, and to stop, s")] = 1.0
    speed_mps: Annotated[float, Field(ge=-2, le=2, description="full speed along the curve, m/s")] = 0.18
    curvature_per_m: Annotated[float, Field(ge=-5, le=5, description="turn per metre, left positive, rad/m")] = 0.1
    sway_period_s: Annotated[float, Field(gt=0, le=60, description="period of the roll sway, s")] = 1.8
    sway_height_m: Annotated[float, Field(ge=0, le=0.1, description="amplitude of the height, m")] = 0.005
    sway_roll_rad: Annotated[float, Field(ge=0, le=0.3, description="amplitude of the roll, rad")] = 0.02
    sway_pitch_rad: Annotated[float, Field(ge=0, le=0.3, description="amplitude of the pitch, rad")] = 0.015

    @model_validator(mode="after")
    def _walk_holds_both_ramps(self) -> Self:
        if 0 < self.walk_s < 2 * self.ramp_s:
            raise ValueError(f"walk_s = {self.walk_s} must hold two ramps of ramp_s = {self.ramp_s}, or be 0")
        return self

    @property
    def duration_s(self) -> float:
        """Length of the whole motion, s."""
        return self.rest_s + self.walk_s + self.stop_s


@dataclass(frozen=True, slots=True, eq=False)
class BodyStates:
    """The body at M times.

    Attributes:
        position: body origin, m, world, (M, 3).
        velocity: m/s, world, (M, 3).
        acceleration: m/s^2, world, (M, 3).
        rotation: ``R_world_body``, (M, 3, 3).
        angular_velocity: rad/s, body, (M, 3).
        angular_acceleration: time derivative of ``angular_velocity``, rad/s^2, body, (M, 3).
    """

    position: Array
    velocity: Array
    acceleration: Array
    rotation: Array
    angular_velocity: Array
    angular_acceleration: Array

    def specific_force_at(self, point_body: Array) -> Array:
        """Specific force of an accelerometer at ``point_body`` (3,) m, body axes, m/s^2, (M, 3).

        ``R^T (a - g) + alpha x r + omega x (omega x r)``.
        """
        specific_force_world = self.acceleration + np.array([0.0, 0.0, GRAVITY_MPS2])
        force: Array = np.einsum("mji,mj->mi", self.rotation, specific_force_world)
        force = force + np.cross(self.angular_acceleration, point_body)
        return force + np.cross(self.angular_velocity, np.cross(self.angular_velocity, point_body))


Jet = tuple[Array, Array, Array]  # a scalar function of time with its first and second derivative


class BodyMotion:
    """Evaluates the motion of a ``BodyMotionConfig`` whose body stands ``height_m`` above the ground."""

    def __init__(self, config: BodyMotionConfig, height_m: float) -> None:
        self.config = config
        self._height_m = height_m

    def at(self, time_s: Array) -> BodyStates:
        """Pose and derivatives at times (M,) in seconds from the start; it stands still outside the walk."""
        config = self.config
        arc, speed, speed_rate = self._progress(time_s)
        envelope = self._envelope(time_s)
        position, velocity, acceleration = self._path(arc, speed, speed_rate)
        height = self._sway(time_s, envelope, config.sway_height_m, 0.5 * config.sway_period_s)
        position[:, 2] = self._height_m + height[0]
        velocity[:, 2], acceleration[:, 2] = height[1], height[2]
        roll = self._sway(time_s, envelope, config.sway_roll_rad, config.sway_period_s)
        pitch = self._sway(time_s, envelope, config.sway_pitch_rad, 0.5 * config.sway_period_s)
        turn = config.curvature_per_m
        rotation, rate, rate_dot = _attitude(roll, pitch, (turn * arc, turn * speed, turn * speed_rate))
        return BodyStates(position, velocity, acceleration, rotation, rate, rate_dot)

    def _ramps(self, time_s: Array) -> tuple[Array, Array]:
        config = self.config
        start = (time_s - config.rest_s) / config.ramp_s
        stop = (time_s - config.rest_s - config.walk_s + config.ramp_s) / config.ramp_s
        return start, stop

    def _progress(self, time_s: Array) -> Jet:
        """Distance along the path, speed and its derivative."""
        start, stop = self._ramps(time_s)
        speed, ramp = self.config.speed_mps * float(self.config.walk_s > 0), self.config.ramp_s
        arc = speed * ramp * (_step_integral(start) - _step_integral(stop))
        envelope = self._envelope(time_s)
        return arc, speed * envelope[0], speed * envelope[1]

    def _envelope(self, time_s: Array) -> Jet:
        """Share of full speed, 0 at rest."""
        ramp = self.config.ramp_s
        start, stop = (smooth_step(u) for u in self._ramps(time_s))
        moves = float(self.config.walk_s > 0)
        value, first, second = (moves * (a - b) for a, b in zip(start, stop, strict=True))
        return value, first / ramp, second / ramp**2

    def _path(self, arc: Array, speed: Array, speed_rate: Array) -> tuple[Array, Array, Array]:
        """Position, velocity, acceleration (M, 3) in the plane of a circular arc through the origin along x."""
        turn = self.config.curvature_per_m
        heading = turn * arc
        zero = np.zeros_like(arc)
        along = np.stack((np.cos(heading), np.sin(heading), zero), axis=1)
        across = np.stack((-np.sin(heading), np.cos(heading), zero), axis=1)
        chord = np.sinc(0.5 * heading / np.pi)  # NumPy's sinc is sin(pi x) / (pi x)
        position = np.stack((arc * np.sinc(heading / np.pi), 0.5 * heading * arc * chord**2, zero), axis=1)
        acceleration = speed_rate[:, None] * along + (turn * speed**2)[:, None] * across
        return position, speed[:, None] * along, acceleration

    def _sway(self, time_s: Array, envelope: Jet, amplitude: float, period_s: float) -> Jet:
        """``amplitude * envelope * sin(2 pi (t - rest) / period)``."""
        pulse = 2.0 * np.pi / period_s
        phase = pulse * (time_s - self.config.rest_s)
        sine, cosine = amplitude * np.sin(phase), amplitude * pulse * np.cos(phase)
        share, first, second = envelope
        return (
            share * sine,
            first * sine + share * cosine,
            second * sine + 2.0 * first * cosine - share * pulse**2 * sine,
        )


def smooth_step(u: Array) -> Jet:
    """The quintic from 0 at u = 0 to 1 at u = 1 with flat ends, constant outside, with two derivatives by u."""
    u = np.clip(u, 0.0, 1.0)
    value = u**3 * (10.0 + u * (6.0 * u - 15.0))
    return value, 30.0 * u**2 * (u - 1.0) ** 2, 60.0 * u * (2.0 * u - 1.0) * (u - 1.0)


def _step_integral(u: Array) -> Array:
    """The integral of ``smooth_step`` from 0 to u."""
    inside = np.clip(u, 0.0, 1.0)
    return inside**4 * (2.5 + inside * (inside - 3.0)) + np.maximum(u - 1.0, 0.0)


def _attitude(roll: Jet, pitch: Jet, yaw: Jet) -> tuple[Array, Array, Array]:
    """``R = Rz(yaw) Ry(pitch) Rx(roll)`` (M, 3, 3), its body rate and rate derivative (M, 3)."""
    zero = np.zeros_like(roll[0])
    about = [np.stack((roll[0], zero, zero), 1), np.stack((zero, pitch[0], zero), 1), np.stack((zero, zero, yaw[0]), 1)]
    rotation = so3.exp(about[2]) @ so3.exp(about[1]) @ so3.exp(about[0])
    sr, cr, sp, cp = np.sin(roll[0]), np.cos(roll[0]), np.sin(pitch[0]), np.cos(pitch[0])
    rate = np.stack(
        (roll[1] - sp * yaw[1], cr * pitch[1] + sr * cp * yaw[1], -sr * pitch[1] + cr * cp * yaw[1]), axis=1
    )
    cross_y = cr * cp * roll[1] - sr * sp * pitch[1]  # derivative of sr cp
    cross_z = -sr * cp * roll[1] - cr * sp * pitch[1]  # derivative of cr cp
    rate_dot = np.stack(
        (
            roll[2] - sp * yaw[2] - cp * pitch[1] * yaw[1],
            cr * pitch[2] + sr * cp * yaw[2] - sr * roll[1] * pitch[1] + cross_y * yaw[1],
            -sr * pitch[2] + cr * cp * yaw[2] - cr * roll[1] * pitch[1] + cross_z * yaw[1],
        ),
        axis=1,
    )
    return rotation, rate, rate_dot

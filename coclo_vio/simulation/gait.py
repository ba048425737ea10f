# SPDX-License-Identifier: BSD-3-Clause
"""The gait of an analytic trial: stance and swing of each foot, its load, and the path of a swing.

Lift-off and touchdown happen exactly at samples: a foot stands over an interval if it stands at both of its ends.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coclo_vio.simulation.body_motion import smooth_step
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.config import StageConfig
from coclo_vio.values.errors import ConfigError


class GaitConfig(StageConfig):
    """The order and timing of the steps."""

    order: Annotated[
        Literal["alternating", "wave"],
        Field(description="alternating: tripod of six legs, trot of four; wave: one after another (walk of four)"),
    ] = "alternating"
    cycle_s: Annotated[float, Field(gt=0.1, le=30, description="time from one lift-off of a foot to the next, s")] = 1.8
    duty: Annotated[float, Field(gt=0.5, lt=0.99, description="share of the cycle in which a foot stands")] = 0.6
    lift_m: Annotated[float, Field(ge=0, le=0.5, description="height of a step, m")] = 0.05
    load_ramp_s: Annotated[
        float,
        Field(gt=0, le=1, description="time to load a foot after touch-down, and to unload it, s"),
    ] = 0.05


@dataclass(frozen=True, slots=True)
class Swing:
    """One step: ``leg`` lifts off at sample ``start`` and touches down at sample ``end``."""

    leg: int
    start: int
    end: int


def plan_swings(config: GaitConfig, feet_xy: Array, rate_hz: float, first_s: float, last_s: float) -> list[Swing]:
    """All steps that start and end within ``first_s`` .. ``last_s``, in order of lift-off.

    Args:
        config: order and timing.
        feet_xy: where the feet stand under the body, m, body frame, (legs, 2): decides the order of the legs.
        rate_hz: samples per second.
        first_s: the walk starts, s.
        last_s: the walk ends, s.
    """
    length = max(2, round((1.0 - config.duty) * config.cycle_s * rate_hz))
    swings = []
    for leg, offset in enumerate(_offsets(config.order, feet_xy)):
        start = round((first_s + offset * config.cycle_s) * rate_hz)
        step = 0
        while (start + length) <= last_s * rate_hz:
            swings.append(Swing(leg, start, start + length))
            step += 1
            start = round((first_s + (step + offset) * config.cycle_s) * rate_hz)
    return sorted(swings, key=lambda swing: (swing.start, swing.leg))


def _offsets(order: str, feet_xy: Array) -> Array:
    """Share of the cycle by which each leg's swing starts late, (legs,)."""
    legs = len(feet_xy)
    offsets = np.zeros(legs)
    sides = [np.flatnonzero(feet_xy[:, 1] > 0), np.flatnonzero(feet_xy[:, 1] <= 0)]
    slot = 0
    for is_right, side in enumerate(sides):
        back_to_front = side[np.argsort(feet_xy[side, 0])]
        for rank, leg in enumerate(back_to_front):
            offsets[leg] = 0.5 * ((rank + is_right) % 2) if order == "alternating" else slot / legs
            slot += 1
    return offsets


def stance_of(swings: list[Swing], samples: int, legs: int) -> BoolArray:
    """Which feet touch the ground at each sample, both ends of a stance included, (samples, legs)."""
    stance: BoolArray = np.ones((samples, legs), dtype=np.bool_)
    for swing in swings:
        stance[swing.start + 1 : swing.end, swing.leg] = False
    return stance


def share_load(config: GaitConfig, swings: list[Swing], samples: int, legs: int, rate_hz: float) -> Array:
    """The share of the weight on each foot, (samples, legs): zero outside of stance, small near its ends, sum 1.

    Raises:
        ConfigError: at some sample no foot is loaded.
    """
    index = np.arange(samples)
    weight = np.ones((samples, legs))
    for swing in swings:
        away = np.maximum(swing.start - index, index - swing.end) / rate_hz
        weight[:, swing.leg] *= smooth_step(away / config.load_ramp_s)[0]
    total = weight.sum(axis=1, keepdims=True)
    if (total <= 0.0).any():
        raise ConfigError(
            f"no foot carries the robot at sample {int(np.argmin(total))}: with duty = {config.duty} all feet change "
            "at once; raise gait.duty or gait.cycle_s, or take gait.order = wave"
        )
    share: Array = weight / total
    return share


@dataclass(frozen=True, slots=True, eq=False)
class SwingCurve:
    """The path of a foot centre from lift-off to touchdown, in the world.

    Quintic with the given ends and end velocities and no end acceleration, and a bump of ``lift_m`` on top.

    Attributes:
        start_s: lift-off, s.
        end_s: touchdown, s.
        start: where it lifts off, m, (3,).
        end: where it lands, m, (3,).
        start_velocity: m/s, (3,).
        end_velocity: m/s, (3,).
        lift_m: height of the bump, m.
    """

    start_s: float
    end_s: float
    start: Array
    end: Array
    start_velocity: Array
    end_velocity: Array
    lift_m: float

    def at(self, time_s: float) -> tuple[Array, Array]:
        """Position m (3,) and velocity m/s (3,) at a time between lift-off and touchdown."""
        span = self.end_s - self.start_s
        u = (time_s - self.start_s) / span
        blend, blend_rate, _ = smooth_step(np.array(u))
        start_shape, start_rate = _velocity_shape(u)
        end_shape, end_rate = _velocity_shape(1.0 - u)
        run = self.end - self.start
        position = self.start + run * blend + span * (self.start_velocity * start_shape - self.end_velocity * end_shape)
        velocity = run * blend_rate / span + self.start_velocity * start_rate + self.end_velocity * end_rate
        position[2] += self.lift_m * 64.0 * (u * (1.0 - u)) ** 3
        velocity[2] += self.lift_m * 192.0 * (u * (1.0 - u)) ** 2 * (1.0 - 2.0 * u) / span
        return position, velocity


def _velocity_shape(u: float) -> tuple[float, float]:
    """The quintic with slope 1 at u = 0 and no other end value, slope or curvature; and its derivative."""
    return (
        u - 6.0 * u**3 + 8.0 * u**4 - 3.0 * u**5,
        1.0 - 18.0 * u**2 + 32.0 * u**3 - 15.0 * u**4,
    )

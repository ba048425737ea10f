# SPDX-License-Identifier: BSD-3-Clause
"""Simulated faults of single encoders: a wrong sign, or a zero that is off, for a stretch of time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coclo_vio.robot.description import RobotDescription
from coclo_vio.runs.fault_spans import Span
from coclo_vio.values.errors import ConfigError, listing
from coclo_vio.values.measurements import JointSample


def flipped_span(text: str) -> tuple[str, Span]:
    """Joint and span of ``JOINT:START:SECONDS``.

    Raises:
        ValueError: no joint, or no span.
    """
    joint, _, span = text.partition(":")
    if not joint or ":" not in span:
        raise ValueError(f"{text!r} is no JOINT:START:SECONDS, such as leg1_base:20:3 for three seconds")
    return joint, Span.parse(span)


def offset_span(text: str) -> tuple[str, Span, float]:
    """Joint, span and offset in degrees of ``JOINT:START:SECONDS:DEG``.

    Raises:
        ValueError: no joint, no span, or no angle that is finite and other than zero.
    """
    front, _, angle = text.rpartition(":")
    try:
        joint, span = flipped_span(front)
        offset_deg = float(angle)
    except ValueError as error:
        message = f"{text!r} is no JOINT:START:SECONDS:DEG, such as leg1_base:20:3:5 for 5 degrees over three seconds"
        raise ValueError(message) from error
    if not 0.0 < abs(offset_deg) <= 180.0:
        raise ValueError(f"{text!r}: DEG must be between -180 and 180 and not 0, such as leg1_base:20:3:5")
    return joint, span, offset_deg


@dataclass(frozen=True, slots=True)
class _WrongEncoder:
    """An encoder that reads ``sign`` times the true angle plus an offset in rad, for a span."""

    column: int
    span: Span
    sign: float
    offset_rad: float


class EncoderFaults:
    """Encoders that read another angle than the joint has. Torques are measured by other sensors and stay."""

    def __init__(self, flipped: Sequence[str], offsets: Sequence[str], robot: RobotDescription | None = None) -> None:
        """Take the faults.

        Args:
            flipped: ``JOINT:START:SECONDS`` each.
            offsets: ``JOINT:START:SECONDS:DEG`` each.
            robot: whose joints these are.

        Raises:
            ConfigError: a joint that the robot does not have, or no robot.
        """
        self._wrong: list[_WrongEncoder] = []
        for text in flipped:
            joint, span = flipped_span(text)
            column = _column("flipped_encoders", text, joint, robot)
            self._wrong.append(_WrongEncoder(column, span, -1.0, 0.0))
        for text in offsets:
            joint, span, offset_deg = offset_span(text)
            column = _column("encoder_offsets", text, joint, robot)
            self._wrong.append(_WrongEncoder(column, span, 1.0, math.radians(offset_deg)))

    def applied(self, sample: JointSample, after_ns: int) -> JointSample:
        """The sample as the wrong encoders read it; position and velocity alike."""
        active = [one for one in self._wrong if after_ns in one.span]
        if not active:
            return sample
        position, velocity = np.array(sample.position), np.array(sample.velocity)
        for one in active:
            position[one.column] = one.sign * position[one.column] + one.offset_rad
            velocity[one.column] *= one.sign
        return JointSample(sample.stamp_ns, position, velocity, sample.effort)


def _column(name: str, text: str, joint: str, robot: RobotDescription | None) -> int:
    if robot is None:
        raise ConfigError(f"faults.{name} = {text!r}: no robot is given; name it with --robot")
    if joint not in robot.joint_names:
        names = listing(robot.joint_names)
        raise ConfigError(f"faults.{name} = {text!r}: {robot.name} has no joint {joint}; its joints are: {names}")
    return robot.joint_names.index(joint)

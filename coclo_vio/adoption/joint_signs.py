# SPDX-License-Identifier: BSD-3-Clause
"""Units and signs of joint readings, from the limits of the URDF, the posture, and velocities against angles."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from coclo_vio.adoption.posture import Posture
from coclo_vio.adoption.recorded_legs import RecordedLegs
from coclo_vio.robot.model import RobotModel
from coclo_vio.robot.urdf_tree import UrdfTree
from coclo_vio.values.arrays import Array
from coclo_vio.values.units import NS_PER_S

_LARGEST_RAD = 7.0  # a leg's joint does not turn farther
_VELOCITY_UNITS = {"rad/s": 1.0, "deg/s": 180.0 / np.pi, "rpm": 30.0 / np.pi}
_CLOSE = 0.2  # by which the slope of velocity over the derivative may differ from a unit's
_LEAST_CORRELATION = 0.7
_BETTER = 0.7  # score of other signs, as a share of that of the log's own, from which they are taken
_GOOD = 0.5  # a score of readings that nothing speaks against
_PER_SIGN = 0.03
_MOST_PATTERNS = 64


@dataclass(frozen=True, slots=True, eq=False)
class JointUnits:
    """Units of a log's joint readings: ``rad`` or ``deg``; ``rad/s``, ``deg/s`` or ``rpm``.

    Attributes:
        position: of the angles.
        velocity: of the velocities.
        is_velocity_reversed: whether velocities have the sign against the derivative of the angles.
        confidence: 0..1.
    """

    position: str
    velocity: str
    is_velocity_reversed: bool
    confidence: float

    def in_si(self, recorded: RecordedLegs) -> RecordedLegs:
        """The readings in rad and rad/s."""
        position = np.radians(recorded.position) if self.position == "deg" else recorded.position
        sign = -1.0 if self.is_velocity_reversed else 1.0
        scale = sign / _VELOCITY_UNITS[self.velocity] if recorded.has_velocity else 1.0
        if not recorded.has_velocity and self.position == "deg":
            scale = np.pi / 180.0
        return replace(recorded, position=position, velocity=recorded.velocity * scale)


def joint_units(recorded: RecordedLegs) -> JointUnits:
    """Read the units off the size of the angles, and off the velocities against their derivatives."""
    largest = float(np.nanpercentile(np.abs(recorded.position), 99.0))
    position = "deg" if largest > _LARGEST_RAD else "rad"
    if not recorded.has_velocity:
        return JointUnits(position, "rad/s", False, 0.9)
    slope, correlation = _slope(recorded, np.pi / 180.0 if position == "deg" else 1.0)
    if abs(correlation) < _LEAST_CORRELATION:
        return JointUnits(position, "rad/s", False, 0.5)
    unit = min(_VELOCITY_UNITS, key=lambda name: abs(np.log(abs(slope) / _VELOCITY_UNITS[name])))
    is_close = abs(abs(slope) / _VELOCITY_UNITS[unit] - 1.0) < _CLOSE
    return JointUnits(position, unit, slope < 0.0, 0.95 if is_close else 0.5)


def _slope(recorded: RecordedLegs, scale: float) -> tuple[float, float]:
    """Slope of the velocities over the derivatives of the angles in rad, and their correlation."""
    width = max(int(0.02 * recorded.rate_hz), 1)
    times_s = (recorded.joint_ns - recorded.joint_ns[0]) / NS_PER_S
    step = (times_s[2 * width :] - times_s[: -2 * width])[:, None]
    derivative = scale * (recorded.position[2 * width :] - recorded.position[: -2 * width]) / step
    velocity = recorded.velocity[width:-width]
    known = np.isfinite(derivative) & np.isfinite(velocity)
    x, y = derivative[known], velocity[known]
    if not len(x) or not x.any() or not y.any():
        return 1.0, 0.0
    return float((x @ y) / (x @ x)), float((x @ y) / np.sqrt((x @ x) * (y @ y)))


def joint_signs(robot: RobotModel, tree: UrdfTree, recorded: RecordedLegs) -> tuple[Array, float]:
    """The sign of each joint's readings (J,), and the confidence; the log's own unless others fit far better.

    Signs differ between makers by place in the leg, and by the side of the body; those patterns are tried.
    """
    posture = Posture(robot, tree, recorded)
    plain = np.ones(len(robot.joint_names))
    own = posture.score(recorded.position, recorded.velocity)
    if own < _GOOD:
        return plain, 0.9
    best, lowest = plain, own
    for signs in _patterns(robot):
        score = posture.score(recorded.position * signs, recorded.velocity * signs)
        score += _PER_SIGN * np.count_nonzero(signs < 0.0)  # of those that fit alike the fewest
        if score < lowest:
            best, lowest = signs, score
    if lowest > _BETTER * own:
        return plain, 0.9 if own < 3.0 else 0.5
    return best, 0.8 if lowest < 3.0 else 0.4


def _patterns(robot: RobotModel) -> Iterator[Array]:
    """Signs by place in the leg, on all legs or on those of one side."""
    slices, sides = robot.leg_joint_slices, robot.hip_position_body[:, 1] > 0.0
    places = max(part.stop - part.start for part in slices)
    choices = list(product(range(4), repeat=places))  # none, all, left, right
    if len(choices) > _MOST_PATTERNS:
        choices = [tuple(kind * (at == place) for at in range(places)) for place in range(places) for kind in (1, 2, 3)]
    for choice in choices:
        signs = np.ones(len(robot.joint_names))
        for part, is_left in zip(slices, sides, strict=True):
            for place, joint in enumerate(range(part.start, part.stop)):
                kind = choice[place]
                if kind == 1 or (kind == 2 and is_left) or (kind == 3 and not is_left):
                    signs[joint] = -1.0
        yield signs

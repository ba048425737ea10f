# SPDX-License-Identifier: BSD-3-Clause
"""Which joint of an inconsistent leg is wrong: a sign, or the zero of an encoder, that explains its residuals best."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coclo_vio.filter.leg_intervals import LegInterval
from coclo_vio.filter.leg_residual_kernel import translations
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array

_EXPLAINED = 0.2  # share of the squared residuals that may be left by the best hypothesis
_RIVAL = 0.5  # a second hypothesis that leaves so much less than twice as much is named too
_MOST_HEIGHT = 0.6  # difference of a foot's height from the others', as a share of its distance from the hip
_ITERATIONS = 3  # of Gauss-Newton
_STEP_RAD = 1e-3
_MOST_RAD = 0.6


@dataclass(frozen=True, slots=True)
class JointHypothesis:
    """A fault of one encoder.

    Attributes:
        joint: its name.
        is_flipped: whether it reads with the wrong sign; else its zero is off.
        offset_rad: reading less true angle, rad; 0 of a wrong sign.
        remaining: share of the squared residuals that it leaves.
    """

    joint: str
    is_flipped: bool
    offset_rad: float
    remaining: float

    def __str__(self) -> str:
        if self.is_flipped:
            return f"joint {self.joint} reads with the wrong sign"
        return f"joint {self.joint} reads {np.degrees(self.offset_rad):+.1f} deg off"


def best_hypotheses(robot: RobotModel, leg: int, intervals: Sequence[LegInterval]) -> list[JointHypothesis]:
    """The hypothesis that explains a leg's residuals, and such that explain them nearly as well; none where none does.

    Args:
        robot: the legs.
        leg: the inconsistent one.
        intervals: recent ones in which it was compared.
    """
    if not intervals or any(one.begin.joint_position is None for one in intervals):
        return []
    before = float(np.sum(np.square([one.residual[leg] for one in intervals])))
    every = []
    for joint in robot.description.legs[leg].joints:
        column = robot.joint_names.index(joint)
        flipped = _residuals(robot, leg, intervals, (column, -1.0, 0.0))
        every.append(JointHypothesis(joint, True, 0.0, float(np.sum(flipped**2)) / before))
        offset_rad, remaining = _offset(robot, leg, intervals, column)
        every.append(JointHypothesis(joint, False, offset_rad, float(np.sum(remaining**2)) / before))
    every = [one for one in every if _is_plausible(robot, leg, intervals[-1], one)]
    every.sort(key=lambda one: one.remaining)
    if not every or every[0].remaining > _EXPLAINED:
        return []
    return [one for one in every if one.remaining * _RIVAL <= every[0].remaining]


def _is_plausible(robot: RobotModel, leg: int, interval: LegInterval, fault: JointHypothesis) -> bool:
    """Whether the foot stands about as high as the others; a leg that is mirrored upwards moves alike."""
    stood = interval.stood.copy()
    stood[leg] = False
    position = np.array(interval.end.joint_position)
    column = robot.joint_names.index(fault.joint)
    position[column] = -position[column] if fault.is_flipped else position[column] - fault.offset_rad
    foot = robot.feet(position, np.zeros(len(position))).position_body[leg]
    up = interval.turn.T @ interval.up
    others_m = float(np.median(interval.end.feet.position_body[stood] @ up))
    reach_m = float(np.linalg.norm(foot - robot.hip_position_body[leg]))
    return bool(abs(float(foot @ up) - others_m) < _MOST_HEIGHT * reach_m)


def _offset(robot: RobotModel, leg: int, intervals: Sequence[LegInterval], column: int) -> tuple[float, Array]:
    """The offset of one encoder that leaves the smallest residuals, rad, and these residuals, m, (3 k,)."""
    offset_rad = 0.0
    for _ in range(_ITERATIONS):
        now = _residuals(robot, leg, intervals, (column, 1.0, offset_rad))
        slope = (_residuals(robot, leg, intervals, (column, 1.0, offset_rad + _STEP_RAD)) - now) / _STEP_RAD
        offset_rad -= float(slope @ now / max(float(slope @ slope), 1e-12))
        offset_rad = float(np.clip(offset_rad, -_MOST_RAD, _MOST_RAD))
    return offset_rad, _residuals(robot, leg, intervals, (column, 1.0, offset_rad))


def _residuals(robot: RobotModel, leg: int, intervals: Sequence[LegInterval], fault: tuple[int, float, float]) -> Array:
    """Residuals of a leg, m, (3 k,), if an encoder (its column) reads sign times the true angle plus an offset."""
    column, sign, offset_rad = fault
    radii_m = robot.foot_radii_m[leg : leg + 1]
    residuals = []
    for one in intervals:
        feet, rotations = [], []
        for reading in (one.begin, one.end):
            position = np.array(reading.joint_position)
            position[column] = sign * (position[column] - offset_rad)
            kinematics = robot.feet(position, np.zeros(len(position)))
            feet.append(kinematics.position_body[leg : leg + 1])
            rotations.append(kinematics.rotation_body_foot[leg : leg + 1])
        moved, _ = translations((feet[0], feet[1]), (rotations[0], rotations[1]), one.turn, one.up, radii_m)
        residuals.append(moved[0] - one.predicted[leg])
    return np.concatenate(residuals)

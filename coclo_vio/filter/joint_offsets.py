# SPDX-License-Identifier: BSD-3-Clause
"""Offsets of encoders by regression: a joint whose zero is off turns the motion that its leg measures.

With ``J`` the linear Jacobian of a foot and ``R`` the rotation over an interval, an offset ``d`` of the joints makes
the residual ``(J_0 - R J_1) d``. Each joint is regressed by itself: the question is which one is wrong. The noise is
that of encoders and slip, and a share of the way that lasts over a stance, both as legs have shown them lately; legs
that fit worse than that raise it.
"""

from dataclasses import dataclass

import numpy as np

from coclo_vio.filter.leg_check_config import LegCheckConfig
from coclo_vio.filter.leg_consistency import LegConsistency
from coclo_vio.filter.leg_intervals import LegInterval
from coclo_vio.filter.leg_residual_kernel import regress
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array, BoolArray

_STANCE_M = 0.2  # way over which the error of a leg lasts
_MOST_RAD = 0.26  # beyond, a joint turns its leg by no small angle, and the regression does not apply
_MOST_SHARE = 0.35  # of the motion; a residual beyond it and some sigmas is a slip or a jump, no small angle
_MOST_SIGMAS = 3.0
_RIVAL = 0.8  # share of the best joint's statistic from which another is named too


@dataclass(frozen=True, slots=True)
class JointOffset:
    """The zero of an encoder that is off.

    Attributes:
        leg: of the joint.
        joint: its name.
        offset_rad: reading less true angle, rad.
        sigma_rad: one sigma of it, rad.
        rivals: joints of the leg that explain the residuals nearly as well.
    """

    leg: int
    joint: str
    offset_rad: float
    sigma_rad: float
    rivals: tuple[str, ...]

    def __str__(self) -> str:
        rivals = "".join(f" (or {name})" for name in self.rivals)
        offset_deg, sigma_deg = np.degrees(self.offset_rad), np.degrees(self.sigma_rad)
        return f"joint {self.joint}{rivals} reads {offset_deg:+.1f} deg off, sigma {sigma_deg:.1f} deg"


class JointOffsets:
    """Regressions of the residuals of each leg on each of its joints."""

    def __init__(self, robot: RobotModel, config: LegCheckConfig) -> None:
        """Args: the legs, and the parameters."""
        self._config, self._robot = config, robot
        names = robot.joint_names
        legs, joints = len(robot.leg_names), max(len(leg.joints) for leg in robot.description.legs)
        self._columns = np.full((legs, joints), -1, dtype=np.int64)
        for leg, each in enumerate(robot.description.legs):
            self._columns[leg, : len(each.joints)] = [names.index(joint) for joint in each.joints]
        self._is_joint = self._columns >= 0
        self._information, self._vector = np.zeros((legs, joints)), np.zeros((legs, joints))
        self._exceeds: BoolArray = np.zeros(legs, dtype=np.bool_)

    @property
    def exceeds(self) -> BoolArray:
        """Legs with an offset beyond half of the limits, (n,)."""
        return self._exceeds

    @property
    def offset_rad(self) -> Array:
        """Offset of each joint if it alone is wrong, rad, (n, joints of a leg)."""
        return np.asarray(self._vector / np.maximum(self._information, 1e-12))

    def forget(self, legs: BoolArray) -> None:
        """Begin anew for these legs (n,)."""
        self._information[legs], self._vector[legs] = 0.0, 0.0

    def push(self, interval: LegInterval, consistency: LegConsistency) -> None:
        """Take the residuals of an interval, m, with the noise as legs have shown it."""
        config, step_m = self._config, interval.step_m
        size_m = np.sqrt(np.square(interval.residual).sum(axis=1))
        is_small = size_m < _MOST_SHARE * step_m + _MOST_SIGMAS * np.sqrt(interval.variance)
        share = max(config.offset_share, consistency.lasting_share)
        variance = consistency.noise_factor * interval.variance + share**2 * _STANCE_M * step_m
        regress(
            (self._information, self._vector),
            (interval.begin.feet.jacobian, interval.end.feet.jacobian),
            interval.turn,
            self._columns,
            interval.residual,
            variance * (interval.is_compared & is_small),
            float(np.exp(-interval.duration_s / config.offset_memory_s)),
        )

    def worst(self, in_use: BoolArray) -> JointOffset | None:
        """The joint of a leg in use (n,) whose offset exceeds the limits most; None where none does.

        None too where that offset is beyond small angles: such a leg is found by its residual.
        """
        config, offset_rad = self._config, self.offset_rad
        squared = self._vector * offset_rad  # squared offset over its variance
        by_leg = squared.max(axis=1)
        if by_leg.max() < 0.25 * config.offset_sigmas**2:
            self._exceeds = np.zeros(len(by_leg), dtype=np.bool_)
            return None
        is_large = np.abs(offset_rad).max(axis=1) > config.least_offset_rad
        factors = self._factors(squared, in_use)
        limit = config.offset_sigmas**2 * factors
        self._exceeds = is_large & (by_leg > 0.25 * limit)
        found = np.flatnonzero(in_use & is_large & (by_leg > limit))
        if not len(found):
            return None
        leg = int(found[np.argmax(by_leg[found] / limit[found])])
        joint = int(np.argmax(squared[leg]))
        if abs(offset_rad[leg, joint]) > _MOST_RAD:
            return None
        sigma_rad = float(np.sqrt(factors[leg] / self._information[leg, joint]))
        near = np.flatnonzero(squared[leg] > _RIVAL * by_leg[leg])
        names = self._robot.description.legs[leg].joints
        rivals = tuple(names[each] for each in near if each != joint)
        return JointOffset(leg, names[joint], float(offset_rad[leg, joint]), sigma_rad, rivals)

    def _factors(self, squared: Array, in_use: BoolArray) -> Array:
        """Variance factor of the other legs in use, for each leg, (n,): the mean of their statistics, 1 at least."""
        counted = self._is_joint & in_use[:, None]
        counts, sums = counted.sum(axis=1), np.where(counted, squared, 0.0).sum(axis=1)
        return np.asarray(np.maximum(1.0, (sums.sum() - sums) / np.maximum(counts.sum() - counts, 1)))

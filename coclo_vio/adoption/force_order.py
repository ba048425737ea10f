# SPDX-License-Identifier: BSD-3-Clause
"""Which foot an unnamed foot force belongs to: a loaded foot is low, a lifted one is high.

A trotting robot loads diagonal feet together, so the data decide which entries are a diagonal, and less which of the
two is which; of the orders that are left the usual one of makers is taken: that of the joints, or with left and right
exchanged.
"""

from dataclasses import dataclass
from itertools import permutations

import numpy as np

from coclo_vio.adoption.recorded_legs import RecordedLegs
from coclo_vio.adoption.stance_motion import FeetMotion
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array

_ALIKE = 0.06  # difference of correlations that is not decisive
_LEAST_CORRELATION = 0.2
_MOST_LEGS = 6


@dataclass(frozen=True, slots=True)
class ForceOrder:
    """For each leg its place among the foot forces, how sure that is (0..1), and why."""

    places: tuple[int, ...]
    confidence: float
    reason: str


def force_order(robot: RobotModel, recorded: RecordedLegs, motion: FeetMotion) -> ForceOrder:
    """The order of the foot forces (N, legs) of a log against its legs."""
    legs = len(robot.leg_names)
    plain, exchanged = tuple(range(legs)), _sides_exchanged(robot)
    matrix = _correlations(recorded, motion)
    if legs > _MOST_LEGS or matrix.max() < _LEAST_CORRELATION:
        return ForceOrder(plain, 0.4, "the order of the legs in the log; no foot was lifted that would show it")
    scores = {places: float(matrix[list(plain), list(places)].mean()) for places in permutations(range(legs))}
    highest = max(scores.values())
    alike = [places for places, score in scores.items() if score >= highest - _ALIKE]
    if plain in alike:
        return ForceOrder(plain, 0.75, "the order of the legs in the log; loaded feet are the low ones")
    if exchanged in alike:
        reason = "loaded feet are the low ones with left and right exchanged, a usual order of makers: check it"
        return ForceOrder(exchanged, 0.65, reason)
    best = max(alike, key=lambda places: scores[places])
    return ForceOrder(best, 0.6 if len(alike) == 1 else 0.3, "in this order loaded feet are the low ones: check it")


def _correlations(recorded: RecordedLegs, motion: FeetMotion) -> Array:
    """Of the depth of each foot below the body (rows) with each foot force (columns), (legs, legs)."""
    known = np.isfinite(recorded.force).all(axis=1) & np.isfinite(motion.position[:, :, 2]).all(axis=1)
    depth, force = -motion.position[known, :, 2], recorded.force[known]
    depth, force = depth - depth.mean(axis=0), force - force.mean(axis=0)
    depth = depth - depth.mean(axis=1, keepdims=True)  # the body's own height moves all feet
    scale = np.linalg.norm(depth, axis=0)[:, None] * np.linalg.norm(force, axis=0)[None, :]
    return np.asarray(depth.T @ force / np.maximum(scale, 1e-12))


def _sides_exchanged(robot: RobotModel) -> tuple[int, ...]:
    """Each leg's place once it is exchanged with the leg on the other side."""
    hips = robot.hip_position_body
    mirrored = hips * np.array([1.0, -1.0, 1.0])
    return tuple(int(np.argmin(np.linalg.norm(hips - hip, axis=1))) for hip in mirrored)

# SPDX-License-Identifier: BSD-3-Clause
"""Which foot an unnamed foot force belongs to: loaded feet keep their distances, whoever carries them.

A trotting robot loads diagonal feet together, so the data decide which entries are a diagonal; of the orders that are
left the usual one of makers is taken: that of the joints, or with left and right exchanged.
"""

from dataclasses import dataclass
from itertools import permutations

import numpy as np

from coclo_vio.adoption.contact_levels import contact_levels
from coclo_vio.adoption.recorded_legs import RecordedLegs
from coclo_vio.adoption.stance_motion import FeetMotion, StandingPairs, standing_pairs
from coclo_vio.robot.model import RobotModel

_ALIKE = 1.15  # stretching within this factor is not distinguished
_MOST_LEGS = 6
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True)
class ForceOrder:
    """For each leg its place among the foot forces, how sure that is (0..1), and why."""

    places: tuple[int, ...]
    confidence: float
    reason: str


def force_order(robot: RobotModel, recorded: RecordedLegs, motion: FeetMotion) -> ForceOrder:
    """The order of the foot forces (N, legs) of a log against its legs."""
    legs = len(robot.leg_names)
    plain = tuple(range(legs))
    levels = contact_levels(recorded.force)
    if levels.separation == 0.0 or not 2 < legs <= _MOST_LEGS:
        return ForceOrder(plain, 0.4, "the order of the legs in the log; no foot was lifted that would show it")
    is_loaded = recorded.force >= levels.on
    stretch = {
        places: stretching(standing_pairs(motion, is_loaded[:, list(places)], _UP))
        for places in permutations(range(legs))
    }
    lowest = min(stretch.values())
    alike = [places for places, value in stretch.items() if value <= _ALIKE * lowest]
    exchanged = _sides_exchanged(robot)
    if plain in alike:
        return ForceOrder(plain, 0.75, "the order of the legs in the log; loaded feet keep their distances")
    if exchanged in alike:
        reason = "loaded feet keep their distances with left and right exchanged, a usual order of makers: check it"
        return ForceOrder(exchanged, 0.65, reason)
    reason = "of the orders in which loaded feet keep their distances the first: check it"
    return ForceOrder(alike[0], 0.6 if len(alike) == 1 else 0.3, reason)


def stretching(pairs: StandingPairs) -> float:
    """Median speed at which the distance of two standing feet changes, m/s: near zero where they do stand."""
    if len(pairs.sample) < 20:
        return float("inf")
    distance = np.maximum(np.linalg.norm(pairs.apart, axis=1), 1e-6)
    return float(np.median(np.abs((pairs.apart * pairs.velocity).sum(axis=1)) / distance))


def _sides_exchanged(robot: RobotModel) -> tuple[int, ...]:
    """Each leg's place once it is exchanged with the leg on the other side."""
    hips = robot.hip_position_body
    mirrored = hips * np.array([1.0, -1.0, 1.0])
    return tuple(int(np.argmin(np.linalg.norm(hips - hip, axis=1))) for hip in mirrored)

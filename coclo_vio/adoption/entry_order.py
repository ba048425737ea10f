# SPDX-License-Identifier: BSD-3-Clause
"""Which entry of a log without usable names is which joint: by limits, posture, and distances of standing feet.

Entries come leg by leg, or place by place (all hips first). Front and rear, and left and right, look alike to the
joints: where the data does not decide, the order of the names counts, then that of the URDF.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from coclo_vio.adoption.name_matching import leg_of_name, legs_in_order
from coclo_vio.adoption.posture import Posture
from coclo_vio.adoption.recorded_legs import RecordedLegs
from coclo_vio.robot.leg_search import FoundLeg
from coclo_vio.robot.model import RobotModel
from coclo_vio.robot.urdf_tree import UrdfTree
from coclo_vio.values.arrays import Array

_ALIKE = 1.3  # scores within this factor are not distinguished
_MOST_LEGS = 6


@dataclass(frozen=True, slots=True, eq=False)
class EntryOrder:
    """An order of the entries.

    Attributes:
        entries: of each joint of the robot its entry in the log, (J,).
        legs: the legs in the order of the log.
        source: of the order of the legs: names, data or urdf.
        confidence: 0..1.
    """

    entries: tuple[int, ...]
    legs: tuple[str, ...]
    source: str
    confidence: float


def moving_entries(position: Array) -> tuple[int, ...]:
    """The entries of a log (N, E) that are no constant: placeholders of feet and unused channels are constants."""
    known = np.isfinite(position).all(axis=0)
    return tuple(int(entry) for entry in np.flatnonzero(known & (np.nanstd(position, axis=0) > 1e-9)))


def entry_order(
    robot: RobotModel, tree: UrdfTree, legs: Sequence[FoundLeg], raw: RecordedLegs, names: Sequence[str]
) -> EntryOrder | None:
    """The order of the entries of ``raw`` (N, E) for the legs of the robot; None where their number does not fit.

    Args:
        robot: the legs, in the order of ``legs``.
        tree: its URDF.
        legs: as found in the URDF.
        raw: joint readings entry by entry.
        names: those of the log, as far as it has any, for the order of the legs.
    """
    entries = moving_entries(raw.position)
    lengths = {len(leg.joints) for leg in legs}
    if len(entries) != len(robot.joint_names) or len(lengths) != 1 or len(legs) > _MOST_LEGS:
        return None
    count = lengths.pop()
    posture = Posture(robot, tree, replace(raw, position=raw.position[:, entries], velocity=raw.velocity[:, entries]))
    stated = _stated_order(legs, names)
    scores: dict[tuple[str, tuple[int, ...]], float] = {}
    for layout in ("by leg", "by place"):
        for order in permutations(range(len(legs))):
            columns = _columns(entries, order, count, layout)
            scores[layout, order] = posture.score(raw.position[:, columns], raw.velocity[:, columns])
    lowest = min(scores.values())
    alike = [key for key, score in scores.items() if score <= _ALIKE * lowest + 0.05]
    by_names = [key for key in alike if key[1] == stated]
    plain = tuple(range(len(legs)))
    if by_names:
        key, source, confidence = by_names[0], "names", 0.85
    elif len(alike) == 1:
        key, source, confidence = alike[0], "data", 0.7
    else:
        key = next((key for key in alike if key[1] == plain), alike[0])
        source, confidence = "urdf", 0.3
    columns = _columns(entries, key[1], count, key[0])
    in_log = sorted(range(len(legs)), key=lambda leg: key[1][leg])
    return EntryOrder(columns, tuple(legs[leg].name for leg in in_log), source, confidence)


def _columns(entries: Sequence[int], order: Sequence[int], count: int, layout: str) -> tuple[int, ...]:
    """The entry of each joint; ``order`` is the place of each leg in the log."""
    legs = len(order)
    if layout == "by leg":
        return tuple(entries[place * count + joint] for place in order for joint in range(count))
    return tuple(entries[joint * legs + place] for place in order for joint in range(count))


def _stated_order(legs: Sequence[FoundLeg], names: Sequence[str]) -> tuple[int, ...] | None:
    """The place in the log of each leg by the log's names; None where they do not state all legs."""
    stated = legs_in_order(names)
    own = [leg_of_name(leg.joints[0]) for leg in legs]
    if any(leg not in stated for leg in own) or len(set(own)) != len(own):
        return None
    places = [stated.index(leg) for leg in own if leg is not None]
    return tuple(sorted(places).index(place) for place in places)

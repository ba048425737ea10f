# SPDX-License-Identifier: BSD-3-Clause
"""Orders and signs that the joints of a recording may have by mistake, as hypotheses."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, permutations
from typing import Self

import numpy as np

from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array, BoolArray, IntArray
from coclo_vio.values.errors import listing

_ALL_ORDERS_UP_TO = 4  # legs, and joints a leg


@dataclass(frozen=True, slots=True, eq=False)
class Arrangement:
    """Which recorded joint is which joint of the robot.

    Attributes:
        source: for each joint the index of the recorded one whose reading it is, (J,).
        sign: what that reading is multiplied with, (J,).
    """

    source: IntArray
    sign: Array

    @classmethod
    def as_recorded(cls, robot: RobotModel) -> Self:
        """No change."""
        return cls(np.arange(len(robot.joint_names)), np.ones(len(robot.joint_names)))

    @property
    def is_as_recorded(self) -> bool:
        """Whether nothing is changed."""
        return bool((self.source == np.arange(len(self.source))).all() and (self.sign > 0).all())

    def followed_by(self, change: "Arrangement") -> "Arrangement":
        """This arrangement, and then a change of what it gives."""
        return Arrangement(self.source[change.source], self.sign[change.source] * change.sign)

    def changed_legs(self, robot: RobotModel) -> IntArray:
        """The legs any of whose joints is another or has another sign."""
        is_changed: BoolArray = (self.source != np.arange(len(self.source))) | (self.sign < 0)
        return np.flatnonzero([is_changed[inside].any() for inside in robot.leg_joint_slices])

    def settings(self, robot: RobotModel) -> tuple[str, ...]:
        """The settings that make it so."""
        names = robot.joint_names
        order = [
            f"{name}: {names[source]}" for name, source in zip(names, self.source, strict=True) if name != names[source]
        ]
        signs = [f"{name}: -1" for name, sign in zip(names, self.sign, strict=True) if sign < 0]
        found = []
        if order:
            found.append(f"dataset.corrections.joints.order={{{', '.join(order)}}}")
        if signs:
            found.append(f"dataset.corrections.joints.signs={{{', '.join(signs)}}}")
        return tuple(found)

    def described(self, robot: RobotModel) -> str:
        """What it is in words."""
        names, parts = robot.joint_names, []
        if (self.source != np.arange(len(self.source))).any():
            parts.append(self._described_order(robot))
        signs = [name for name, sign in zip(names, self.sign, strict=True) if sign < 0]
        if signs:
            parts.append(f"the sign of {'all joints' if len(signs) == len(names) else listing(signs)} changed")
        return " and ".join(parts)

    def _described_order(self, robot: RobotModel) -> str:
        slices, names = robot.leg_joint_slices, robot.joint_names
        legs = []
        for leg, inside in zip(robot.leg_names, slices, strict=True):
            sources = self.source[inside].tolist()
            whole = next((i for i, other in enumerate(slices) if list(range(other.start, other.stop)) == sources), None)
            if whole is None:
                break
            if robot.leg_names[whole] != leg:
                legs.append(f"{leg} from {robot.leg_names[whole]}")
        else:
            return f"the readings of the legs exchanged ({listing(legs)})"
        moved = [f"{name} from {names[s]}" for name, s in zip(names, self.source, strict=True) if name != names[s]]
        return f"the readings of joints exchanged ({listing(moved[:6])}{', ...' if len(moved) > 6 else ''})"


def alternatives(robot: RobotModel) -> Iterator[Arrangement]:
    """Single mistakes: signs of a joint, of a kind, of a side; legs exchanged; joints in or between legs exchanged."""
    base = Arrangement.as_recorded(robot)
    yield from _signs(robot, base)
    slices = robot.leg_joint_slices
    sizes = {inside.stop - inside.start for inside in slices}
    if len(sizes) != 1:
        return
    size = sizes.pop()
    for legs in leg_orders(robot):
        yield Arrangement(np.concatenate([base.source[slices[leg]] for leg in legs]), base.sign)
    inner = list(permutations(range(size))) if size <= _ALL_ORDERS_UP_TO else [tuple(range(size))[::-1]]
    for order in inner:
        if order == tuple(range(size)):
            continue
        yield Arrangement(np.concatenate([inside.start + np.array(order) for inside in slices]), base.sign)
        for inside in slices:
            source = base.source.copy()
            source[inside] = inside.start + np.array(order)
            yield Arrangement(source, base.sign)
    for place in range(size):
        for one, other in combinations(slices, 2):
            source = base.source.copy()
            source[[one.start + place, other.start + place]] = other.start + place, one.start + place
            yield Arrangement(source, base.sign)
    by_kind = base.source.reshape(len(slices), size).T.ravel()  # all first joints, then all second ones
    yield Arrangement(by_kind, base.sign)
    yield Arrangement(np.argsort(by_kind), base.sign)


def _signs(robot: RobotModel, base: Arrangement) -> Iterator[Arrangement]:
    groups: list[list[int]] = [[joint] for joint in range(len(robot.joint_names))]
    groups.append(list(range(len(robot.joint_names))))
    slices = robot.leg_joint_slices
    size = max(inside.stop - inside.start for inside in slices)
    is_left = robot.hip_position_body[:, 1] > 0.0
    for legs in (np.ones(len(slices), dtype=np.bool_), is_left, ~is_left):
        members = [inside for inside, is_one in zip(slices, legs, strict=True) if is_one]
        groups += [[s.start + place for s in members if s.start + place < s.stop] for place in range(size)]
        groups.append([joint for inside in members for joint in range(inside.start, inside.stop)])
    seen: set[tuple[int, ...]] = set()
    for group in groups:
        if group and tuple(group) not in seen:
            seen.add(tuple(group))
            sign = base.sign.copy()
            sign[group] = -1.0
            yield Arrangement(base.source, sign)


def leg_orders(robot: RobotModel) -> Iterator[tuple[int, ...]]:
    """Orders of the legs: all of up to four, otherwise exchanges of two, mirrors, and order by side."""
    legs = tuple(range(len(robot.leg_names)))
    if len(legs) <= _ALL_ORDERS_UP_TO:
        yield from (order for order in permutations(legs) if order != legs)
        return
    found = [_exchanged(legs, {a: b, b: a}) for a, b in combinations(legs, 2)]
    hips = robot.hip_position_body[:, :2]
    for mirror in ((1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
        distances = np.linalg.norm(hips[:, None] * np.array(mirror) - hips[None], axis=2)
        found.append(tuple(np.argmin(distances, axis=1).tolist()))
    by_side = np.argsort(hips[:, 1] < 0.0, kind="stable")
    found += [legs[::-1], tuple(by_side.tolist()), tuple(np.argsort(by_side).tolist())]
    yield from (order for order in dict.fromkeys(found) if order != legs and sorted(order) == list(legs))


def _exchanged(legs: tuple[int, ...], pairs: dict[int, int]) -> tuple[int, ...]:
    return tuple(pairs.get(leg, leg) for leg in legs)

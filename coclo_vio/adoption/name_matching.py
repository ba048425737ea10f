# SPDX-License-Identifier: BSD-3-Clause
"""The joint names of a log matched to those of a URDF: equal, or equal once case, affixes and abbreviations are undone.

A name is read as a leg and a place in it: ``FL_calf_joint``, ``front_left_knee`` and ``lf_2`` are the third joint of
the left front leg.
"""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from coclo_vio.robot.leg_search import FoundLeg

_FILLERS = {"joint", "joints", "jnt", "motor", "pos", "position", "angle", "link", "actuator", "leg", "encoder"}
_ENDS = {"f": "front", "front": "front", "fore": "front", "m": "middle", "mid": "middle", "middle": "middle"}
_ENDS |= dict.fromkeys(("h", "hind", "rear", "back", "b"), "rear")
_SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}
_PAIRS = {
    first + second: (end, side)
    for end_letters, end in (("f", "front"), ("mc", "middle"), ("hb", "rear"))
    for side_letter, side in (("l", "left"), ("r", "right"))
    for letter in end_letters
    for first, second in ((letter, side_letter), (side_letter, letter))
} | {"rl": ("rear", "left"), "lr": ("rear", "left"), "rr": ("rear", "right")}
_PLACES = (
    {"hip", "haa", "abad", "abduction", "hx", "hip x", "hip aa", "coxa", "shoulder", "hip roll", "base", "hip joint"},
    {"thigh", "hfe", "upper", "upper leg", "hip pitch", "hip fe", "hy", "hip y", "femur", "hip flexion", "arm"},
    {"calf", "kfe", "knee", "lower", "lower leg", "shank", "shin", "kn", "tibia", "knee pitch", "foot", "elbow"},
)
"""What the first, second and third joint of a leg of three joints are called."""


@dataclass(frozen=True, slots=True)
class NameMatch:
    """The name in a log of a joint of a URDF, and how it was matched, 0..1."""

    joint: str
    log_name: str
    confidence: float


def match_names(legs: Sequence[FoundLeg], log_names: Sequence[str]) -> dict[str, NameMatch]:
    """By URDF joint its name in the log; joints without a name that can only be theirs are left out."""
    matches: dict[str, NameMatch] = {}
    joints = [joint for leg in legs for joint in leg.joints]
    lowest = _lowest_number(log_names)
    has_three = all(len(leg.joints) == len(_PLACES) for leg in legs)
    passes = (
        (1.0, {joint: {joint} for joint in joints}, {name: {name} for name in log_names}),
        (0.97, {joint: {_plain(joint)} for joint in joints}, {name: {_plain(name)} for name in log_names}),
        (
            0.9,
            {joint: {_place(joint)} for joint in joints},
            {name: {_place(name)} for name in log_names},
        ),
        (0.8, _numbered(legs), {name: {_number(name, lowest, has_three)} for name in log_names}),
    )
    for confidence, of_joints, of_names in passes:
        used = {match.log_name for match in matches.values()}
        free = {name: keys for name, keys in of_names.items() if name not in used}
        counts = Counter(key for keys in free.values() for key in keys)
        named = {key: name for name, keys in free.items() for key in keys if counts[key] == 1}
        claims = Counter(key for joint, keys in of_joints.items() if joint not in matches for key in keys)
        for joint, keys in of_joints.items():
            found = {named[key] for key in keys if key is not None and key in named and claims[key] == 1}
            if joint not in matches and len(found) == 1:
                matches[joint] = NameMatch(joint, found.pop(), confidence)
    return matches


def leg_of_name(name: str) -> tuple[str, str] | None:
    """The leg that a name states: its end (front, middle, rear, or a number) and side; None where it states none."""
    return _leg_and_rest(name)[0]


def legs_in_order(names: Iterable[str]) -> list[tuple[str, str]]:
    """The legs that names state, in the order of their first appearance."""
    found = (leg_of_name(name) for name in names)
    return list(dict.fromkeys(leg for leg in found if leg is not None))


def _words(name: str) -> list[str]:
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Za-z])(?=\d)|(?<=\d)(?=[A-Za-z])", " ", name)
    return [word.lower() for word in re.split(r"[^A-Za-z0-9]+", spaced) if word]


def _plain(name: str) -> str:
    return " ".join(word for word in _words(name) if word not in _FILLERS)


def _leg_and_rest(name: str) -> tuple[tuple[str, str] | None, tuple[str, ...]]:
    words = _words(name)
    for number, word in enumerate(words):
        if word in _PAIRS:
            return _PAIRS[word], _rest(words[:number] + words[number + 1 :])
    end = next((word for word in words if word in _ENDS), None)
    side = next((word for word in words if word in _SIDES and word != end), None)
    if side is not None:
        rest = list(words)
        for used in (end, side):
            if used is not None:
                rest.remove(used)
        return (_ENDS.get(end or "", ""), _SIDES[side]), _rest(rest)
    if "leg" in words[:-1] and words[words.index("leg") + 1].isdigit():
        at = words.index("leg")
        return (words[at + 1], ""), _rest(words[:at] + words[at + 2 :])
    return None, _rest(words)


def _rest(words: Sequence[str]) -> tuple[str, ...]:
    return tuple(word for word in words if word not in _FILLERS)


def _place(name: str) -> tuple[object, ...] | None:
    """Leg and words of the joint."""
    leg, rest = _leg_and_rest(name)
    return (leg, frozenset(rest)) if leg is not None and rest else None


def _numbered(legs: Sequence[FoundLeg]) -> Mapping[str, set[tuple[object, ...] | None]]:
    """By joint its leg and its number in the leg."""
    return {
        joint: {None if leg_of_name(joint) is None else (leg_of_name(joint), number)}
        for leg in legs
        for number, joint in enumerate(leg.joints)
    }


def _number(name: str, lowest: int, has_three: bool) -> tuple[object, ...] | None:
    leg, rest = _leg_and_rest(name)
    if leg is None:
        return None
    if len(rest) == 1 and rest[0].isdigit():
        return leg, int(rest[0]) - lowest
    if not has_three:
        return None
    words = " ".join(rest)
    return next(((leg, place) for place, names in enumerate(_PLACES) if words in names), None)


def _lowest_number(names: Sequence[str]) -> int:
    numbers = [int(rest[0]) for _, rest in map(_leg_and_rest, names) if len(rest) == 1 and rest[0].isdigit()]
    return min(numbers, default=0)

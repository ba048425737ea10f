# SPDX-License-Identifier: BSD-3-Clause
"""The legs of a URDF, found in its kinematic tree: chains from the body to an end that can be a foot.

Names decide where they speak of legs or of arms; where they do not, a leg is one of several chains of equal length
whose end can be low under the body.
"""

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from coclo_vio.robot.urdf_tree import MOVING_KINDS, UrdfJoint, UrdfTree
from coclo_vio.values.arrays import Array

MIN_MASS_KG = 1e-3
"""Links below this have no mass of their own: URDFs give such masses to frames."""
_FEWEST_JOINTS, _MOST_JOINTS = 2, 7
_LEG_WORDS = re.compile(
    r"leg|foot|feet|sole|toe|ankle|calf|shank|shin|thigh|knee|hip|haa|hfe|kfe|tibia|femur|coxa|tarsus"
    r"|(?<![a-z])(?:[fhrbl][lrf]|[lr][fhmrb])(?![a-z])"
)
_ARM_WORDS = re.compile(
    r"(?<!fore)(?:arm(?!\w*leg)|hand|wrist|gripper|finger|thumb|palm|head|neck|torso|waist|chest|camera|lidar|wheel)"
)
_FOOT_WORDS = re.compile(r"sole|foot|toe|contact|tip|end(?![a-z])")
_SENSOR_WORDS = re.compile(r"sensor|skin|imu|cam|dh_frame|optical|lidar|rotor|motor|marker")
_LOW_M = 0.05  # under the body's origin: an end that cannot be lower is no foot
_POSTURES = 200  # drawn within the limits of the joints


@dataclass(frozen=True, slots=True, eq=False)
class FoundLeg:
    """A leg of a URDF.

    Attributes:
        name: what the names of its joints and its foot begin with, such as FL or leg1.
        joints: from the body to the foot.
        foot_frame: the link at the foot.
        foot_kind: ``sphere`` (one collision sphere), ``flat`` (box or several spheres), ``mesh``, or ``none``.
        foot_radius_m: of the sphere, 0 otherwise.
        foot_centre_m: centre of the sphere in the axes of the link, m.
        evidence: why it is taken for a leg.
    """

    name: str
    joints: tuple[str, ...]
    foot_frame: str
    foot_kind: str
    foot_radius_m: float
    foot_centre_m: tuple[float, float, float]
    evidence: str


@dataclass(frozen=True, slots=True, eq=False)
class FoundLegs:
    """The legs of a URDF, and what is none.

    Attributes:
        body_frame: the link with mass that the legs hang on, or None where the root serves.
        legs: in the order of the URDF.
        ignored: by the link at its end, why a chain is no leg.
    """

    body_frame: str | None
    legs: tuple[FoundLeg, ...]
    ignored: dict[str, str]


def find_legs(tree: UrdfTree) -> FoundLegs:
    """Find body, legs and feet."""
    ignored: dict[str, str] = {}
    body = body_link(tree)
    chains = _independent_chains(tree, body, ignored)
    by_name = {end: _word_of(tree, chain, end) for end, chain in chains.items()}
    lengths = Counter(len(chain) for end, chain in chains.items() if by_name[end] != "arm")
    legs = []
    for end, chain in chains.items():
        evidence = "named as legs"
        if by_name[end] == "arm":
            ignored[end] = "its names are those of an arm, a head or a sensor"
            continue
        if "wheel" in end.lower():
            ignored[end] = "it ends in a wheel"
            continue
        if lengths[len(chain)] < 2 and len(chains) > 1:
            ignored[end] = f"no other chain has {len(chain)} joints, as legs have"
            continue
        if by_name[end] == "none":
            if not _reaches_below(tree, body, chain, end):
                ignored[end] = "its end cannot be below the body"
                continue
            evidence = f"{lengths[len(chain)]} chains of {len(chain)} joints whose end can be below the body"
        legs.append(_leg(tree, chain, end, evidence))
    return FoundLegs(_frame_of(tree, body), _with_names(legs), ignored)


def body_link(tree: UrdfTree) -> str:
    """The first link with mass, counted from the root: the body."""
    links = [tree.root]
    while links:
        link = links.pop(0)
        if tree.links[link].mass_kg > MIN_MASS_KG:
            return link
        links += [joint.child for joint in tree.joints_below(link)]
    return tree.root


def _frame_of(tree: UrdfTree, body: str) -> str | None:
    """The body frame to set: none where the root is at the body's place."""
    chain = tree.chain(body)
    is_at_root = np.allclose(tree.placements()[body], np.eye(4), atol=1e-4)
    return None if is_at_root and not any(joint.is_moving for joint in chain) else body


def _independent_chains(tree: UrdfTree, body: str, ignored: dict[str, str]) -> dict[str, tuple[UrdfJoint, ...]]:
    """By the link at its end, each chain of moving joints from the body that shares no joint with another one."""
    above = {joint.name for joint in tree.chain(body)}
    chains: dict[str, tuple[UrdfJoint, ...]] = {}
    for joint in tree.joints.values():
        if joint.is_moving and not any(tree.joints[other].is_moving for other in _joints_under(tree, joint.child)):
            chains[joint.child] = tuple(one for one in tree.moving_chain(joint.child) if one.name not in above)
    uses = Counter(joint.name for chain in chains.values() for joint in chain)
    found = {}
    for end, chain in chains.items():
        if any(uses[joint.name] > 1 for joint in chain):
            ignored[end] = "its first joints carry other chains too, as a torso or a hand does"
        elif any(joint.kind not in MOVING_KINDS for joint in chain):
            ignored[end] = "a joint has more than one degree of freedom"
        elif not _FEWEST_JOINTS <= len(chain) <= _MOST_JOINTS:
            ignored[end] = f"it has {len(chain)} moving joints; a leg has {_FEWEST_JOINTS} to {_MOST_JOINTS}"
        else:
            found[end] = chain
    return found


def _joints_under(tree: UrdfTree, link: str) -> Iterable[str]:
    for joint in tree.joints_below(link):
        yield joint.name
        yield from _joints_under(tree, joint.child)


def _word_of(tree: UrdfTree, chain: tuple[UrdfJoint, ...], end: str) -> str:
    """``leg``, ``arm`` or ``none``, by the names of a chain's joints and of the links at its end."""
    names = [joint.name for joint in chain] + [joint.child for joint in chain] + list(tree.rigid_with(end))
    words = [name.lower() for name in names]
    legs = sum(bool(_LEG_WORDS.search(word)) for word in words)
    arms = sum(bool(_ARM_WORDS.search(word)) for word in words)
    if legs > arms:
        return "leg"
    return "arm" if arms else "none"


def _reaches_below(tree: UrdfTree, body: str, chain: tuple[UrdfJoint, ...], end: str) -> bool:
    rng = np.random.default_rng(0)
    bounds = [(max(joint.lower, -np.pi), min(joint.upper, np.pi)) for joint in chain]
    lowest = np.inf
    for _ in range(_POSTURES):
        angles = {joint.name: float(rng.uniform(*bound)) for joint, bound in zip(chain, bounds, strict=True)}
        placed = tree.placements(angles)
        T_body_end = np.linalg.inv(placed[body]) @ placed[_foot_link(tree, end)]
        lowest = min(lowest, float(T_body_end[2, 3]))
    return lowest < -_LOW_M


def _leg(tree: UrdfTree, chain: tuple[UrdfJoint, ...], end: str, evidence: str) -> FoundLeg:
    foot = _foot_link(tree, end)
    kind, radius, centre = foot_shape(tree, foot)
    name = _prefix([*(joint.name for joint in chain), foot]) or foot
    x, y, z = (float(value) for value in centre)
    return FoundLeg(name, tuple(joint.name for joint in chain), foot, kind, radius, (x, y, z), evidence)


def _foot_link(tree: UrdfTree, end: str) -> str:
    """Of the links at the end of a chain that of the foot: a sphere, a name, or the farthest from the last joint."""
    placed = tree.placements()
    last = placed[end][:3, 3]

    def rank(link: str) -> tuple[bool, int, int, float]:
        spheres = sum(shape.kind == "sphere" for shape in tree.links[link].shapes)
        word = _FOOT_WORDS.search(link.lower())
        is_sensor = bool(_SENSOR_WORDS.search(link.lower()))
        score = 0 if is_sensor else 4 * (word is not None and word[0] == "sole") + 2 * (word is not None)
        words = -len(re.split(r"[_.-]", link)) if word else 0  # l_sole, not l_sole_4
        return not is_sensor, score + (spheres == 1), words, round(float(np.linalg.norm(placed[link][:3, 3] - last)), 6)

    return max((end, *tree.descendants(end, only_fixed=True)), key=rank)


def foot_shape(tree: UrdfTree, foot: str) -> tuple[str, float, Array]:
    """Kind, radius in m and centre (3,) in m of the foot of a link, by its collision shapes."""
    shapes = tree.links[foot].shapes
    spheres = [shape for shape in shapes if shape.radius_m is not None]
    others = {shape.kind for shape in shapes} - {"sphere", "cylinder", "capsule"}
    if len(spheres) == 1 and not others:
        return "sphere", float(spheres[0].radius_m or 0.0), spheres[0].position_link
    if len(spheres) > 1 or "box" in others:
        return "flat", 0.0, np.zeros(3)
    if "sole" in foot.lower():
        return "flat", 0.0, np.zeros(3)
    return ("mesh" if "mesh" in others else "none"), 0.0, np.zeros(3)


def _prefix(names: list[str]) -> str:
    """What all names begin with, without regard to case, up to the end of a word."""
    first = names[0]
    length = 0
    while length < len(first) and all(name[: length + 1].lower() == first[: length + 1].lower() for name in names):
        length += 1
    if length < len(first) and first[length].isalpha() and length and first[length - 1].isalpha():
        length = max(first[:length].rfind("_"), first[:length].rfind("."), 0)
    return first[:length].strip("_-./ ")


def _with_names(legs: list[FoundLeg]) -> tuple[FoundLeg, ...]:
    """The legs, each with a name of its own: left and right in full, a number where names repeat or are a link's."""
    names = [_side_of(leg) for leg in legs]
    counts = Counter(names)
    return tuple(
        replace(leg, name=name if counts[name] == 1 else f"leg{number}")
        for number, (leg, name) in enumerate(zip(legs, names, strict=True), start=1)
    )


def _side_of(leg: FoundLeg) -> str:
    first = re.split(r"[_.-]", leg.name)[0]
    sides = {"l": "left", "r": "right", "left": "left", "right": "right"}
    return sides.get(first.lower(), leg.name) if leg.name in {first, leg.foot_frame} else leg.name

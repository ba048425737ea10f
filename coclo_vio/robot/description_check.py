# SPDX-License-Identifier: BSD-3-Clause
"""A robot's description against its URDF: what the two contradict, and what the URDF says and the description omits.

Returns findings and changes nothing; who calls it decides what is shown.
"""

import difflib
import re
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from coclo_vio.robot.description import LegDescription, RobotDescription, urdf_path
from coclo_vio.robot.description_finding import DescriptionFinding
from coclo_vio.robot.foot_check import foot_findings
from coclo_vio.robot.imu_check import imu_findings
from coclo_vio.robot.leg_search import MIN_MASS_KG, body_link, find_legs
from coclo_vio.robot.pinocchio_legs import PinocchioLegs
from coclo_vio.robot.urdf_tree import MOVING_KINDS, UrdfTree, read_urdf_tree
from coclo_vio.values.errors import RobotModelError, listing
from coclo_vio.values.units import GRAVITY_MPS2

__all__ = ["DescriptionFinding", "check_description"]

_WORLD_WORDS = {"world", "map", "odom", "ground", "base_footprint"}
_PLACE_M, _PLACE_RAD = 1e-3, 1e-3
_LIGHTEST_KG, _HEAVIEST_KG = 0.5, 500.0
_SIDE_M = 0.01
_LEFT = re.compile(r"(?i)^(?:left|l|fl|lf|rl|hl|lh|lr|bl|lb|front_left|rear_left|hind_left|back_left)(?![a-z])")
_RIGHT = re.compile(r"(?i)^(?:right|r|fr|rf|rr|hr|rh|br|rb|front_right|rear_right|hind_right|back_right)(?![a-z])")


def check_description(description: RobotDescription) -> tuple[DescriptionFinding, ...]:
    """Compare a description with its URDF, which is opened; errors first.

    A URDF that is missing or cannot be read is a finding, not an exception.
    """
    try:
        tree = read_urdf_tree(urdf_path(description))
    except RobotModelError as error:
        return (DescriptionFinding("urdf_missing", True, str(error), ("urdf",)),)
    of_root = [*_of_root(tree, description)]
    body = body_link(tree) if of_root else description.body_frame or tree.root
    findings = [*of_root, *_of_masses(tree, description)]
    for leg in description.legs:
        findings += _of_leg(tree, description, leg)
    findings += [
        *_of_sides(tree, description),
        *_of_other_legs(tree, description),
        *imu_findings(tree, description, body),
    ]
    if not any(finding.is_error for finding in findings):
        try:
            PinocchioLegs(description)
        except RobotModelError as error:
            findings.append(DescriptionFinding("urdf_refused", True, str(error), ("urdf", "legs")))
    return tuple(sorted(findings, key=lambda finding: not finding.is_error))


def _of_root(tree: UrdfTree, description: RobotDescription) -> Iterator[DescriptionFinding]:
    body = description.body_frame
    if body is not None:
        if body not in tree.links and body not in tree.joints:
            near = _near(body, tree.links)
            yield DescriptionFinding(
                "body_frame_unknown",
                True,
                f"body_frame {body!r} is no link of the URDF; its links are: {listing(tree.links)}{near}",
                (f"body_frame: {body_link(tree)}",),
            )
        return
    if tree.links[tree.root].mass_kg > MIN_MASS_KG:
        return
    first = body_link(tree)
    chain = tree.chain(first)
    place = tree.placements()[first]
    is_apart = np.abs(place[:3, 3]).max() > _PLACE_M or np.abs(place[:3, :3] - np.eye(3)).max() > _PLACE_RAD
    moving = [joint.name for joint in chain if joint.is_moving]
    if not (is_apart or moving or tree.root.lower() in _WORLD_WORDS):
        return
    by_joint = f" by the moving joint {listing(moving)}" if moving else ""
    yield DescriptionFinding(
        "root_without_mass",
        False,
        f"the URDF's root link {tree.root!r} has no mass and is taken for the body, while {first!r} hangs on it"
        f"{by_joint} and is the first link with mass; set body_frame to {first!r}",
        (f"body_frame: {first}",),
    )


def _of_leg(tree: UrdfTree, description: RobotDescription, leg: LegDescription) -> Iterator[DescriptionFinding]:
    are_known = True
    for name in leg.joints:
        finding = _of_listed_joint(tree, leg, name)
        if finding is not None:
            are_known = False
            yield finding
    if leg.foot_frame not in tree.links:
        if leg.foot_frame not in tree.joints:
            near = _near(leg.foot_frame, tree.links)
            yield DescriptionFinding(
                "foot_frame_unknown",
                True,
                f"leg {leg.name!r}: foot_frame {leg.foot_frame!r} is no link of the URDF{near}",
                (f"legs[{leg.name}].foot_frame",),
            )
        return
    if are_known:
        yield from _of_chain(tree, description, leg)
    yield from foot_findings(tree, leg)
    yield from _of_limits(tree, leg)


def _of_listed_joint(tree: UrdfTree, leg: LegDescription, name: str) -> DescriptionFinding | None:
    joint, where = tree.joints.get(name), (f"legs[{leg.name}].joints",)
    if joint is None:
        near = _near(name, tree.joints)
        text = f"leg {leg.name!r}: the URDF has no joint {name!r}{near}"
        return DescriptionFinding("joint_unknown", True, text, where)
    if not joint.is_moving:
        text = f"leg {leg.name!r}: the joint {name!r} is fixed in the URDF; take it out of the leg's joints"
        return DescriptionFinding("joint_is_fixed", True, text, where)
    if joint.kind not in MOVING_KINDS:
        text = (
            f"leg {leg.name!r}: the joint {name!r} is of the kind {joint.kind}, with more than one degree of freedom; "
            f"a leg is made of {listing(MOVING_KINDS)} joints"
        )
        return DescriptionFinding("joint_of_many_degrees", True, text, where)
    return None


def _of_chain(tree: UrdfTree, description: RobotDescription, leg: LegDescription) -> Iterator[DescriptionFinding]:
    """The leg's joints against those between body and foot."""
    where = f"legs[{leg.name}].joints"
    above_body = {joint.name for joint in tree.chain(description.body_frame or body_link(tree))}
    chain = [joint.name for joint in tree.moving_chain(leg.foot_frame) if joint.name not in above_body]
    remedy = (f"{where}: [{', '.join(chain)}]",)
    foreign = [name for name in leg.joints if name not in chain]
    if foreign:
        yield DescriptionFinding(
            "joint_of_another_chain",
            True,
            f"leg {leg.name!r}: {listing(foreign)} does not move its foot {leg.foot_frame!r}{_owner(tree, foreign)}; "
            f"the moving joints between the body and this foot are: {', '.join(chain) or 'none'}",
            remedy,
        )
    left_out = [name for name in chain if name not in leg.joints]
    if left_out:
        yield DescriptionFinding(
            "joint_in_no_leg",
            True,
            f"leg {leg.name!r}: the moving joint {listing(left_out)} lies between the body and {leg.foot_frame!r} but "
            "is none of the leg's joints, so it is held at zero; add it to the leg's joints, or make it fixed in the "
            "URDF",
            remedy,
        )
    if not foreign and not left_out and list(leg.joints) != chain:
        yield DescriptionFinding(
            "joint_order",
            False,
            f"leg {leg.name!r}: its joints are listed as {', '.join(leg.joints)}, but from the body to the foot they "
            f"are {', '.join(chain)}; list them in this order, unless a log without names has the other one",
            remedy,
        )


def _owner(tree: UrdfTree, joints: Sequence[str]) -> str:
    owners = [leg.name for leg in find_legs(tree).legs if set(joints) & set(leg.joints)]
    return f" but that of the leg {listing(owners)}" if owners else ""


def _of_limits(tree: UrdfTree, leg: LegDescription) -> Iterator[DescriptionFinding]:
    for joint in (tree.joints[name] for name in leg.joints if name in tree.joints):
        if joint.lower >= joint.upper:
            yield DescriptionFinding(
                "joint_without_range",
                joint.lower > joint.upper,
                f"leg {leg.name!r}: the limits of the joint {joint.name!r} in the URDF, {joint.lower:g} and "
                f"{joint.upper:g} rad, leave it no range; correct them",
            )


def _of_sides(tree: UrdfTree, description: RobotDescription) -> Iterator[DescriptionFinding]:
    """The sides that the legs' names state against those of their first joints, y left."""
    placed = tree.placements()
    T_body_root = np.linalg.inv(placed.get(description.body_frame or tree.root, np.eye(4)))
    sides = {}
    for leg in description.legs:
        stated = 1.0 if _LEFT.match(leg.name) else -1.0 if _RIGHT.match(leg.name) else 0.0
        joint = tree.joints.get(leg.joints[0])
        hip_y = 0.0 if joint is None else float((T_body_root @ placed[joint.child])[1, 3])
        if stated and abs(hip_y) > _SIDE_M:
            sides[leg.name] = stated * hip_y
    wrong = [name for name, side in sides.items() if side < 0.0]
    if not wrong:
        return
    if len(wrong) == len(sides) > 1:
        text = (
            f"every leg ({listing(wrong)}) has its first joint on the other side than its name states: the body frame "
            f"{description.body_frame or tree.root!r} seems to have x backwards and y to the right; take a link with x "
            "forward and y to the left as body_frame, or turn the estimates by 180 degrees"
        )
        yield DescriptionFinding("body_frame_turned", False, text, ("body_frame",))
        return
    text = (
        f"the leg {listing(wrong)} has its first joint on the other side than its name states, y to the left; correct "
        "the leg's name or its joints"
    )
    yield DescriptionFinding("leg_on_other_side", False, text, tuple(f"legs[{name}]" for name in wrong))


def _of_masses(tree: UrdfTree, description: RobotDescription) -> Iterator[DescriptionFinding]:
    mass_kg = tree.mass_kg
    negative = [name for name, link in tree.links.items() if link.mass_kg < 0.0]
    if negative:
        text = f"the URDF gives {listing(negative)} a negative mass; correct it in the URDF"
        yield DescriptionFinding("mass_negative", True, text)
    if not _LIGHTEST_KG <= mass_kg <= _HEAVIEST_KG:
        yield DescriptionFinding(
            "mass_implausible",
            mass_kg <= 0.0 and description.contact.source == "torque",
            f"the links of the URDF weigh {mass_kg:g} kg together; a walking robot weighs {_LIGHTEST_KG:g} to "
            f"{_HEAVIEST_KG:g} kg: correct the masses in the URDF, on which contact from torques depends",
        )
        return
    contact = description.contact
    if contact.source != "torque":
        return
    weightless = [leg.name for leg in description.legs if _leg_mass_kg(tree, leg) <= MIN_MASS_KG]
    if weightless and contact.compensation != "none":
        yield DescriptionFinding(
            "leg_without_mass",
            False,
            f"the links of the leg {listing(weightless)} have no mass in the URDF, so its weight cannot be subtracted "
            "from the torques; give the links their masses, or set contact.compensation to none",
            ("contact.compensation: none",),
        )
    share_n = mass_kg * GRAVITY_MPS2 / len(description.legs)
    if contact.on_force >= share_n:
        on, off = (float(f"{part * share_n:.2g}") for part in (0.6, 0.3))
        yield DescriptionFinding(
            "contact_threshold_above_weight",
            False,
            f"contact.on_force is {contact.on_force:g} N, but a leg carries {share_n:.1f} N while all stand "
            f"({mass_kg:.3g} kg by the URDF), so no foot would be in stance; set on_force and off_force below that",
            (f"contact.on_force: {on:g}", f"contact.off_force: {off:g}"),
        )


def _leg_mass_kg(tree: UrdfTree, leg: LegDescription) -> float:
    children = {tree.joints[name].child for name in leg.joints if name in tree.joints}
    links = {link for child in children for link in (child, *tree.descendants(child))}
    return sum(tree.links[link].mass_kg for link in links)


def _of_other_legs(tree: UrdfTree, description: RobotDescription) -> Iterator[DescriptionFinding]:
    described = set(description.joint_names)
    lengths = {len(leg.joints) for leg in description.legs}
    left_out = [leg for leg in find_legs(tree).legs if not described & set(leg.joints) and len(leg.joints) in lengths]
    if left_out:
        yield DescriptionFinding(
            "leg_left_out",
            False,
            f"the URDF has the leg {listing(leg.name for leg in left_out)} with the joints "
            f"{'; '.join(', '.join(leg.joints) for leg in left_out)}, which the description leaves out; add it to legs",
            ("legs",),
        )
    feet = [leg.foot_frame for leg in description.legs]
    shared = {foot for foot in feet if feet.count(foot) > 1}
    if shared:
        legs = listing(leg.name for leg in description.legs if leg.foot_frame in shared)
        text = f"the legs {legs} have one foot frame, {listing(shared)}; give each leg its own"
        yield DescriptionFinding("foot_frame_shared", True, text, ("legs",))


def _near(name: str, names: Iterable[str]) -> str:
    near = difflib.get_close_matches(name, list(names), n=1)
    return f"; did you mean {near[0]!r}?" if near else ""

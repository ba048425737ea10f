# SPDX-License-Identifier: BSD-3-Clause
"""From a URDF and a log to a robot that works: the steps in their order. Ground truth is never opened.

Legs from the tree, joints by name or by the data, units and signs, contact from the loads, the IMU from gravity and
turning.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from coclo_vio.adoption.adoption import SURE, AdoptedField, Adoption
from coclo_vio.adoption.contact_choice import ContactFound, find_contact
from coclo_vio.adoption.force_order import force_order
from coclo_vio.adoption.imu_choice import find_imu
from coclo_vio.adoption.joint_matching import MatchedJoints, match_joints
from coclo_vio.adoption.joint_signs import JointUnits, joint_signs, joint_units
from coclo_vio.adoption.read_log import ReadLog
from coclo_vio.adoption.recorded_legs import RecordedLegs, read_legs
from coclo_vio.adoption.stance_motion import feet_motion
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.robot.description import LegDescription, RobotDescription
from coclo_vio.robot.leg_search import FoundLeg, FoundLegs, find_legs
from coclo_vio.robot.model import RobotModel
from coclo_vio.robot.sole import sole_points
from coclo_vio.robot.urdf_tree import UrdfTree, read_urdf_tree
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import RobotModelError
from coclo_vio.values.units import NS_PER_S

_CORRECTIONS = "dataset.corrections.joints."
_JOINTS_WITHOUT_ANKLE = 4
_USUAL_RADIUS_M = 0.02
_NOISY_RADPS = 0.1  # an estimated velocity that errs by less needs no entry


def adopt(urdf: Path, recording: Path, config: DatasetConfig | None = None) -> Adoption:
    """Find the description of the robot that a URDF describes and a log was recorded on.

    Args:
        urdf: its URDF file.
        recording: a walk of some seconds, best with a stand and a turn in it.
        config: how the recording is read; the defaults if None.

    Raises:
        RobotModelError: the URDF cannot be read, or has no legs.
        DatasetError: the recording cannot be read, or its joints cannot be matched to those of the URDF.
    """
    config = config or DatasetConfig()
    tree = read_urdf_tree(urdf)
    found = find_legs(tree)
    if not found.legs:
        reasons = "; ".join(f"{end}: {reason}" for end, reason in found.ignored.items()) or "it has no chain of joints"
        raise RobotModelError(f"{urdf} has no legs that could be found ({reasons}); describe them in a YAML by hand")
    joints = match_joints(tree, found.legs, _description(tree, found, found.legs), recording, config)
    read = _read(tree, found, joints, recording)
    contact = find_contact(read.robot, read.recorded)
    imu, imu_fields, imu_notes = find_imu(tree, read, joints.legs, contact.is_stance)
    changes: dict[str, object] = {"contact": contact.config, "imu": imu, "joint_aliases": joints.aliases}
    fields = [
        *_leg_fields(found, joints, read.robot.description),
        *joints.fields,
        *read.fields,
        *_contact_fields(contact),
        *imu_fields,
    ]
    noise = _velocity_noise(read.recorded)
    if noise is not None:
        changes["joint_velocity_noise_radps"] = noise
        reason = "the log has no velocities; those estimated from the angles err by this much"
        fields.append(AdoptedField("joint_velocity_noise_radps", f"{noise:g}", 0.8, reason))
    values = read.robot.description.model_dump(exclude_unset=True) | changes
    return Adoption(
        description=RobotDescription.parse(values, "adoption"),
        fields=tuple(fields),
        settings=(*joints.settings, *read.settings),
        notes=(*contact.notes, *imu_notes),
        ignored=found.ignored,
        recording=recording,
    )


def _description(tree: UrdfTree, found: FoundLegs, legs: Sequence[FoundLeg]) -> RobotDescription:
    described = []
    for leg in legs:
        values: dict[str, object] = {
            "name": leg.name,
            "joints": leg.joints,
            "foot_frame": leg.foot_frame,
            "foot_radius_m": leg.foot_radius_m or _supposed_radius_m(leg),
        }
        if float(np.linalg.norm(leg.foot_centre_m)) > 1e-3:
            values["foot_centre_m"] = leg.foot_centre_m
        is_ankled = leg.foot_kind != "sphere" and len(leg.joints) > _JOINTS_WITHOUT_ANKLE
        if (leg.foot_kind == "flat" or is_ankled) and len(sole := sole_points(tree, leg.foot_frame)):
            values["contact_points_m"] = [[round(float(value), 4) + 0.0 for value in point] for point in sole]
        described.append(LegDescription.parse(values, str(tree.path)))
    frame = {} if found.body_frame is None else {"body_frame": found.body_frame}
    values = {"name": tree.name, "urdf": str(tree.path.resolve()), "legs": tuple(described), **frame}
    return RobotDescription.parse(values, str(tree.path))


def _supposed_radius_m(leg: FoundLeg) -> float:
    """Of a foot of unknown shape on a leg without an ankle: a ball, as on most small quadrupeds."""
    is_ball = leg.foot_kind in {"mesh", "none"} and len(leg.joints) <= _JOINTS_WITHOUT_ANKLE
    return _USUAL_RADIUS_M if is_ball else 0.0


def _read(tree: UrdfTree, found: FoundLegs, joints: MatchedJoints, recording: Path) -> ReadLog:
    """Read the log with the matched joints; bring units, signs and the order of the feet to those of the URDF."""
    description = _description(tree, found, joints.legs).model_copy(update={"joint_aliases": joints.aliases})
    robot = RobotModel(description)
    recorded = read_legs(recording, description, joints.config)
    units = joint_units(recorded)
    recorded = units.in_si(recorded)
    signs, confidence = joint_signs(robot, tree, recorded)
    field, settings = _of_signs(description, signs, confidence, is_bag=joints.is_bag)
    recorded = replace(
        recorded,
        position=recorded.position * signs,
        velocity=recorded.velocity * signs,
        effort=recorded.effort * signs,
    )
    motion, fields = feet_motion(robot, recorded), [field]
    if joints.foot_entries:
        order = force_order(robot, recorded, motion)
        recorded = replace(recorded, force=recorded.force[:, list(order.places)])
        placed = {leg: joints.foot_entries[place] for leg, place in zip(robot.leg_names, order.places, strict=True)}
        fields.append(AdoptedField("contact.forces", _listed(placed), order.confidence, order.reason))
        settings = (*settings, f"dataset.rosbag.foot_force_entries={{{_listed(placed)}}}")
    return ReadLog(robot, recorded, motion, tuple(fields), (*_unit_settings(units), *settings))


def _leg_fields(found: FoundLegs, joints: MatchedJoints, description: RobotDescription) -> list[AdoptedField]:
    names = ", ".join(leg.name for leg in joints.legs)
    evidence = "; ".join(dict.fromkeys(leg.evidence for leg in joints.legs))
    by_names = all(leg.evidence.startswith("named") for leg in joints.legs)
    fields = [AdoptedField("legs", names, 0.95 if by_names else 0.6, f"chains of the URDF, {evidence}")]
    if found.body_frame is not None:
        reason = "the first link with mass; x has to point forward, y left, z up"
        fields.append(AdoptedField("body_frame", found.body_frame, 0.8, reason))
    kinds = {leg.foot_kind for leg in joints.legs}
    known = dict.fromkeys(leg.foot_radius_m or _supposed_radius_m(leg) for leg in joints.legs)
    radii = ", ".join(f"{radius:g}" for radius in known)
    if kinds == {"sphere"}:
        fields.append(AdoptedField("foot_radius_m", radii, 0.9, "the collision sphere of the foot; measure it"))
    elif kinds == {"flat"}:
        fields.append(AdoptedField("foot_radius_m", radii, 0.9, "flat feet"))
    else:
        reason = "the URDF has no collision sphere at the foot: measure its radius; 0 for a flat foot"
        fields.append(AdoptedField("foot_radius_m", radii, 0.3, reason))
    if description.has_flat_feet:
        fields.append(_sole_field(description))
    return fields


def _sole_field(description: RobotDescription) -> AdoptedField:
    """Whether the corners of the soles are known, by which a foot that rocks on heel or toe is followed."""
    counts = {len(leg.contact_points_m) for leg in description.legs if leg.is_flat}
    if 0 not in counts:
        reason = "corners of the soles, by boxes, spheres or frames at the foot: measure them"
        return AdoptedField("contact_points_m", f"{min(counts)} a foot", 0.9, reason)
    reason = (
        "the URDF has no boxes, spheres or frames at the sole: give its corners in the axes of foot_frame, heel and "
        "toe; without them a foot that rocks on heel or toe is not followed"
    )
    return AdoptedField("contact_points_m", "unknown", 0.5, reason)


def _unit_settings(units: JointUnits) -> tuple[str, ...]:
    """The settings with which the readings of joints come in rad and rad/s."""
    settings = []
    if units.position != "rad":
        settings.append(f"{_CORRECTIONS}position_unit={units.position}")
    if units.is_velocity_reversed:
        settings.append(f"{_CORRECTIONS}velocity=from_position")
    elif units.position != "rad" or units.velocity != "rad/s":
        settings.append(f"{_CORRECTIONS}velocity_unit={units.velocity}")
    return tuple(settings)


def _of_signs(
    description: RobotDescription, signs: Array, confidence: float, *, is_bag: bool
) -> tuple[AdoptedField, tuple[str, ...]]:
    """The field of the signs, and the settings that correct them."""
    turned = [name for name, sign in zip(description.joint_names, signs, strict=True) if sign < 0.0]
    if not turned:
        reason = "limits of the URDF, posture, and distances of standing feet fit as they are"
        if confidence < SURE:
            reason = "posture or limits fit no choice of signs well: compare the log with the URDF joint by joint"
        return AdoptedField("joint_signs", "as in the log", confidence, reason), ()
    listed = ", ".join(turned)
    reason = "limits of the URDF and the posture fit only with these signs reversed"
    field = AdoptedField("joint_signs", f"-1 for {listed}", confidence, reason)
    key = "dataset.rosbag.joint_signs" if is_bag else f"{_CORRECTIONS}signs"
    return field, (f"{key}={{{', '.join(f'{name}: -1' for name in turned)}}}",)


def _contact_fields(contact: ContactFound) -> list[AdoptedField]:
    values = contact.config.model_dump(exclude_unset=True)
    return [
        AdoptedField("contact.source", str(values["source"]), contact.source_confidence, contact.source_reason),
        AdoptedField(
            "contact.on_force, off_force",
            f"{values['on_force']:g}, {values['off_force']:g}",
            contact.level_confidence,
            contact.level_reason,
        ),
    ]


def _listed(placed: dict[str, int]) -> str:
    return ", ".join(f'{leg}: "effort[{entry}]"' for leg, entry in placed.items())


def _velocity_noise(recorded: RecordedLegs) -> float | None:
    """Error of estimated velocities against central differences, rad/s, rounded; None where the log has velocities."""
    if recorded.has_velocity:
        return None
    times_s = (recorded.joint_ns - recorded.joint_ns[0]) / NS_PER_S
    step = (times_s[2:] - times_s[:-2])[:, None]
    central = (recorded.position[2:] - recorded.position[:-2]) / step
    error = float(np.sqrt(np.nanmean((central - recorded.velocity[1:-1]) ** 2)))
    return float(f"{error:.2g}") if error > _NOISY_RADPS else None

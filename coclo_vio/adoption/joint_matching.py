# SPDX-License-Identifier: BSD-3-Clause
"""The joints of a URDF in a log: by name, or by the data where names are absent, too few, or of another robot."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from coclo_vio.adoption.adoption import AdoptedField
from coclo_vio.adoption.entry_order import EntryOrder, entry_order
from coclo_vio.adoption.joint_signs import joint_units
from coclo_vio.adoption.log_entries import LogEntries, log_entries
from coclo_vio.adoption.name_matching import leg_of_name, match_names
from coclo_vio.adoption.recorded_legs import RecordedLegs, log_robot, read_legs
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.robot.description import RobotDescription
from coclo_vio.robot.leg_search import FoundLeg
from coclo_vio.robot.model import RobotModel
from coclo_vio.robot.urdf_tree import UrdfTree
from coclo_vio.values.config import merged, parse_settings
from coclo_vio.values.errors import DatasetError, listing


@dataclass(frozen=True, slots=True, eq=False)
class MatchedJoints:
    """Joints of a URDF matched to a log.

    Attributes:
        legs: in the order of the log.
        aliases: name in the log: URDF joint, where they differ.
        config: with which the log is read from here on.
        settings: what of that is not default, as ``--set`` takes it.
        fields: with their confidence.
        notes: what to check.
        is_bag: whether the log is a rosbag.
        foot_entries: places of unnamed foot forces among the efforts, in the order of the log; empty where none are.
    """

    legs: tuple[FoundLeg, ...]
    aliases: dict[str, str]
    config: DatasetConfig
    settings: tuple[str, ...]
    fields: tuple[AdoptedField, ...]
    notes: tuple[str, ...]
    is_bag: bool
    foot_entries: tuple[int, ...] = ()


def match_joints(
    tree: UrdfTree, legs: tuple[FoundLeg, ...], description: RobotDescription, path: Path, config: DatasetConfig
) -> MatchedJoints:
    """Match by name, otherwise by the data.

    Raises:
        DatasetError: the log has no joints, or neither names nor number of its entries fit.
    """
    entries = log_entries(path, config)
    if not entries.size:
        raise DatasetError(f"{path} has no joints; a robot is adopted from a log of its joints")
    matches = match_names(legs, entries.names) if entries.is_named else {}
    joints = [joint for leg in legs for joint in leg.joints]
    if len(matches) == len(joints):
        confidence = min(match.confidence for match in matches.values())
        aliases = {match.log_name: joint for joint, match in matches.items() if match.log_name != joint}
        ordered = _ordered(legs, [matches[leg.joints[0]].log_name for leg in legs], entries.names)
        reason = "equal names" if confidence == 1.0 else "names that differ in case, affixes or abbreviations only"
        field = AdoptedField("joints", f"{len(joints)} matched by name", confidence, reason)
        alias = [AdoptedField("joint_aliases", f"{len(aliases)} names", confidence, reason)] if aliases else []
        named = _named_after_forces(ordered, entries.force_names)
        return MatchedJoints(named, aliases, config, (), (field, *alias), (), entries.is_bag)
    return _by_data(tree, legs, description, path, config, entries)


def _by_data(
    tree: UrdfTree,
    legs: tuple[FoundLeg, ...],
    description: RobotDescription,
    path: Path,
    config: DatasetConfig,
    entries: LogEntries,
) -> MatchedJoints:
    names = entries.names if entries.is_named else tuple(f"entry_{number}" for number in range(entries.size))
    read_by = _with(config, [f"dataset.rosbag.joint_entries=[{', '.join(names)}]"]) if entries.is_bag else config
    raw = read_legs(path, log_robot(names), read_by)
    order = entry_order(RobotModel(description), tree, legs, joint_units(raw).in_si(raw), entries.names)
    if order is None:
        stated = listing(entries.names) if entries.names else "without names"
        raise DatasetError(
            f"{path} has {entries.size} joint entries ({stated}), which cannot be matched by name or by number to the "
            f"{len(description.joint_names)} joints of the legs, {listing(description.joint_names)}; name them as the "
            "URDF does, or set dataset.rosbag.joint_entries"
        )
    by_name = {leg.name: leg for leg in legs}
    ordered = tuple(by_name[name] for name in order.legs)
    aliases, settings = _named(description, order, names, entries)
    feet = _foot_entries(raw, len(legs)) if entries.is_bag else ()
    by_range = [f"dataset.rosbag.foot_force_entries=effort[{feet[0]}:{feet[-1] + 1}]"] if feet else []
    reason = {
        "names": "the log's names state the legs, their place in the leg is from limits and posture",
        "data": "limits, posture and distances of standing feet fit no other order",
        "urdf": "front and rear, left and right look alike in this log, so the order of the URDF is taken: check it",
    }[order.source]
    value = f"entries {', '.join(map(str, order.entries))}"
    fields = (AdoptedField("joints", value, order.confidence, reason),)
    named = _named_after_forces(ordered, entries.force_names)
    read_by = _with(config, [*settings, *by_range])
    return MatchedJoints(named, aliases, read_by, tuple(settings), fields, (), entries.is_bag, feet)


def _named(
    description: RobotDescription,
    order: EntryOrder,
    names: Sequence[str],
    entries: LogEntries,
) -> tuple[dict[str, str], list[str]]:
    """Aliases of the log's names, or the setting that names the entries of a bag."""
    joints = dict(zip(order.entries, description.joint_names, strict=True))
    if entries.is_named:
        return {names[entry]: joint for entry, joint in joints.items()}, []
    listed = [joints.get(entry, f"unused_{entry}") for entry in range(max(joints) + 1)]
    return {}, [f"dataset.rosbag.joint_entries=[{', '.join(listed)}]"]


def _foot_entries(raw: RecordedLegs, legs: int) -> tuple[int, ...]:
    """Foot forces among the efforts: the only entries that vary, one for each leg, never far below zero."""
    known = np.flatnonzero(np.isfinite(raw.effort).all(axis=0))
    varying = [int(entry) for entry in known if np.std(raw.effort[:, entry]) > 0.0]
    if len(varying) != legs or varying != list(range(varying[0], varying[0] + legs)):
        return ()
    values = raw.effort[:, varying]
    if float(np.percentile(values, 1.0)) < -0.1 * float(np.percentile(values, 99.0)):
        return ()
    return tuple(varying)


def _ordered(legs: tuple[FoundLeg, ...], first_names: Sequence[str], names: Sequence[str]) -> tuple[FoundLeg, ...]:
    places = {name: place for place, name in enumerate(names)}
    pairs = zip(legs, first_names, strict=True)
    return tuple(leg for leg, _ in sorted(pairs, key=lambda pair: places.get(pair[1], len(places))))


def _named_after_forces(legs: tuple[FoundLeg, ...], force_names: Sequence[str]) -> tuple[FoundLeg, ...]:
    """The legs under the names that the foot forces of a leg log have."""
    by_key = {leg_of_name(name): name for name in force_names if leg_of_name(name) is not None}
    by_name = {name.lower(): name for name in force_names}
    renamed = [by_name.get(leg.name.lower()) or by_key.get(leg_of_name(leg.name)) or leg.name for leg in legs]
    if len(set(renamed)) < len(legs):
        return legs
    return tuple(replace(leg, name=name) for leg, name in zip(legs, renamed, strict=True))


def _with(config: DatasetConfig, settings: Sequence[str]) -> DatasetConfig:
    """The configuration with settings of ``dataset.``."""
    changes = parse_settings(settings).get("dataset", {})
    return DatasetConfig.parse(merged(config.model_dump(exclude_unset=True), changes), "adoption")

# SPDX-License-Identifier: BSD-3-Clause
"""Where contact comes from, foot sensors or torques, with which thresholds, and which feet stand by them."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.adoption.contact_levels import ContactLevels, contact_levels, swing_scatter
from coclo_vio.adoption.recorded_legs import RecordedLegs
from coclo_vio.adoption.stance_motion import foot_loads
from coclo_vio.robot.contact import ContactConfig
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.units import GRAVITY_MPS2

_UP = np.array([0.0, 0.0, 1.0])
_DWELL_SAMPLES, _LONGEST_DWELL_S = 2, 0.02
_REVERSED = 0.2  # of an equal share of the weight, below zero
_QUIETER = 0.95  # scatter of feet in the air with inertia, as a share of that without, from which it is compensated


@dataclass(frozen=True, slots=True, eq=False)
class ContactFound:
    """How contact is sensed.

    Attributes:
        config: for the description.
        is_stance: which feet stand at each joint sample, (N, legs).
        source_confidence: 0..1.
        source_reason: what speaks for the source.
        level_confidence: 0..1, of the thresholds.
        level_reason: what they are from.
        notes: what to check.
    """

    config: ContactConfig
    is_stance: BoolArray
    source_confidence: float
    source_reason: str
    level_confidence: float
    level_reason: str
    notes: tuple[str, ...] = ()


def find_contact(robot: RobotModel, recorded: RecordedLegs) -> ContactFound:
    """Choose the source of the loads, and thresholds from their distribution."""
    if recorded.has_force:
        levels = contact_levels(recorded.force)
        base = ContactConfig(source="force_sensor")
        return _found(robot, recorded, recorded.force, levels, base, "the log has foot sensors")
    if recorded.has_effort:
        plain = foot_loads(robot, recorded, _UP, with_inertia=False)
        inertial = foot_loads(robot, recorded, _UP, with_inertia=True)
        levels, of_inertial = contact_levels(plain), contact_levels(inertial)
        is_better = swing_scatter(inertial, of_inertial) < _QUIETER * swing_scatter(plain, levels)
        loads, levels = (inertial, of_inertial) if is_better else (plain, levels)
        base = ContactConfig(source="torque", compensation="inertia" if is_better else "gravity")
        return _found(robot, recorded, loads, levels, base, "the log has joint torques and no foot sensors")
    note = (
        "the log has neither foot sensors nor joint torques: contact is estimated from the motion of the feet; record "
        "one of them for better contact"
    )
    return _by_weight(robot, recorded, ContactConfig(source="kinematic"), note)


def _by_weight(robot: RobotModel, recorded: RecordedLegs, base: ContactConfig, note: str) -> ContactFound:
    """Thresholds as shares of the weight where the log's loads are none; all feet are taken to stand."""
    share = robot.mass_kg * GRAVITY_MPS2 / len(robot.leg_names)
    on, off = max(float(f"{0.6 * share:.2g}"), 0.02), max(float(f"{0.3 * share:.2g}"), 0.01)
    config = ContactConfig.parse(base.model_dump(exclude_unset=True) | {"on_force": on, "off_force": off}, "adoption")
    still = np.repeat(np.isfinite(recorded.position.sum(axis=1))[:, None], len(robot.leg_names), axis=1)
    return ContactFound(config, still, 0.1, note, 0.1, "shares of the weight by the URDF", (note,))


def _found(
    robot: RobotModel,
    recorded: RecordedLegs,
    loads: Array,
    levels: ContactLevels,
    base: ContactConfig,
    reason: str,
) -> ContactFound:
    share = robot.mass_kg * GRAVITY_MPS2 / len(robot.leg_names)
    mean = float(np.nanmean(loads))
    if levels.off <= 0.0 or mean < -_REVERSED * share:
        note = (
            f"the mean load of a foot is {mean:.3g}, below zero: the sign of the torques is opposite to that of a "
            "motor's torque on its joint, or that of the foot sensors is wrong: set "
            "dataset.corrections.joints.effort_factor=-1 "
            "or foot_force.factor=-1"
        )
        return _by_weight(robot, recorded, base, note)
    ratio = levels.stance / max(share, 1e-9)
    unit = "N" if base.source == "torque" or 0.5 < ratio < 2.5 else "raw counts"
    dwell = float(f"{min(_DWELL_SAMPLES / recorded.rate_hz, _LONGEST_DWELL_S):.2g}")
    changes = {"on_force": levels.on, "off_force": levels.off, "on_dwell_s": dwell}
    config = ContactConfig.parse(base.model_dump(exclude_unset=True) | changes, "adoption")
    if levels.separation == 0.0:
        level_reason = (
            f"no foot was lifted in the log: shares of the load of a standing foot, {levels.stance:.3g} {unit}; record "
            "some steps"
        )
        is_stance = np.isfinite(loads)
    else:
        level_reason = (
            f"two kinds of load, {levels.swing:.3g} and {levels.stance:.3g} {unit}, "
            f"{levels.separation:.1f} deviations apart"
        )
        is_stance = loads >= levels.on
    notes: tuple[str, ...] = ()
    if base.source == "torque" and not 0.4 < ratio < 3.0:
        notes = (
            f"a standing foot carries {levels.stance:.3g} N by its torques, but an equal share of the weight is "
            f"{share:.3g} N: check masses, unit and sign of the torques",
        )
    confidence = levels.confidence if not notes else 0.3
    return ContactFound(config, is_stance, 0.95, reason, confidence, level_reason, notes)

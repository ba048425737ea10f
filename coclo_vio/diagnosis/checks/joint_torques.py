# SPDX-License-Identifier: BSD-3-Clause
"""Joint torques where contact is estimated from them: absent, zero, of another sign or unit than the robot's weight.

Over a walk, as over a stand, the vertical forces of the ground carry the robot's weight in the mean, whatever the gait.
Those forces are what the legs' own weight needs plus what the torques say, so that the factor follows by which the
torques have to be multiplied: one where they are in Nm and of the right sign.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from coclo_vio.diagnosis.checks.joint_order import keeps_distances
from coclo_vio.diagnosis.checks.joint_positions import is_in_degrees
from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.finding import Finding, Severity, Stage, error, warning
from coclo_vio.diagnosis.joint_series import is_stepping, thinned, up_body_at
from coclo_vio.diagnosis.records import JointRecord
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.errors import listing
from coclo_vio.values.units import GRAVITY_MPS2

_FACTOR = "dataset.corrections.joints.effort_factor="
_RATE_HZ = 10.0
_SAMPLES = 200
_SURE = (0.33, 3.0)  # the factor: loads on the back, friction and rough motor constants stay within
_USUAL = (0.6, 1.7)
_BEYOND_LIMIT = 3.0
_LEAST_SAMPLES = 20
_NEGATIVE_SHARE = -0.25  # of an equal share of the weight, in the mean


def find(evidence: Evidence) -> Iterator[Finding]:
    """Torques with which no contact can be estimated."""
    joints, robot = evidence.joints, evidence.robot
    if joints is None or robot is None or robot.description.contact.source != "torque":
        return
    if is_in_degrees(joints, robot) or len(joints.stamps_ns) < _LEAST_SAMPLES:
        return
    steps = is_stepping(evidence, robot)
    nothing = silent(joints)
    if nothing is not None:
        yield nothing if steps or nothing.kind == "torque_absent" else _not_stepping(nothing)
        return
    yield from _dead(joints, robot)
    factor = missing_factor(evidence, joints, robot)
    if factor is None:
        return
    pulling = _pulling_legs(np.nanmean(vertical_loads(evidence, joints, robot), axis=0), robot)
    if pulling is not None and _SURE[0] < factor < _SURE[1]:
        yield pulling
    elif not are_usual(factor) and steps:
        yield _wrong_factor(factor, robot, is_certain=keeps_distances(evidence))
    yield from _beyond_limits(joints, robot)


def _not_stepping(found: Finding) -> Finding:
    """The same as a warning: the motors of a robot that lies may be off."""
    return replace(found, severity=Severity.WARNING, sentence=f"{found.sentence}; in that time the legs do not step")


def missing_factor(evidence: Evidence, joints: JointRecord, robot: RobotModel) -> float | None:
    """What the torques have to be multiplied with to carry the robot's weight in the mean; None where unknown."""
    said = vertical_loads(evidence, joints, robot).sum(axis=1)
    own = vertical_loads(evidence, joints, robot, with_torques=False).sum(axis=1)
    is_known = np.isfinite(said)
    if is_known.sum() < _LEAST_SAMPLES:
        return None
    by_torques = float((said - own)[is_known].mean())
    return float((robot.mass_kg * GRAVITY_MPS2 - own[is_known].mean()) / by_torques) if by_torques else None


def are_usual(factor: float | None) -> bool:
    """Whether torques that lack this factor carry the weight about right."""
    return factor is None or _USUAL[0] < factor < _USUAL[1]


def vertical_loads(
    evidence: Evidence,
    joints: JointRecord,
    robot: RobotModel,
    rows: IntArray | None = None,
    *,
    with_torques: bool = True,
) -> Array:
    """Vertical forces on the feet by the torques, without inertia, N, (N, n), at some samples; NaN where unknown."""
    rows = thinned(joints.stamps_ns, _RATE_HZ, _SAMPLES) if rows is None else rows
    ups = up_body_at(evidence, joints, rows)
    found = []
    for row, up in zip(rows, ups, strict=True):
        position, velocity = joints.position[row], joints.velocity[row]
        effort = joints.effort[row] if with_torques else np.zeros_like(position)
        found.append(robot.foot_forces(position, velocity, effort, specific_force_body=GRAVITY_MPS2 * up) @ up)
    return np.array(found)


def silent(joints: JointRecord) -> Finding | None:
    """Torques that are absent, zero or constant; None where they say something."""
    effort = joints.effort
    has_reading = np.isfinite(effort)
    count = int(has_reading.any(axis=0).sum())
    what = f"in all {len(effort):,} samples, but contact.source is torque: no foot is ever in stance"
    cure = (
        "record torques, or set robot.contact.source=force_sensor with its thresholds where feet have sensors, or "
        "robot.contact.source=kinematic"
    )
    if count == 0:
        return error("torque_absent", Stage.JOINTS, "joints", f"the joints have no torque {what}; {cure}")
    if not effort[has_reading].any():
        return error(
            "torque_zero", Stage.JOINTS, "joints", f"the torques of all {count} joints are zero {what}; {cure}"
        )
    spans = np.ptp(np.where(has_reading, effort, np.nanmean(effort)), axis=0)
    if len(effort) > _LEAST_SAMPLES and not spans.any():
        return error(
            "torque_constant",
            Stage.JOINTS,
            "joints",
            f"the torques of all {count} joints never change in {len(effort):,} samples: they are not measured; {cure}",
        )
    return None


def _dead(joints: JointRecord, robot: RobotModel) -> Iterator[Finding]:
    effort = joints.effort
    is_known = np.isfinite(effort).all(axis=0)
    is_dead = is_known & (np.ptp(np.nan_to_num(effort), axis=0) == 0.0)
    if is_dead.any():
        names = listing(np.array(robot.joint_names)[is_dead].tolist())
        yield warning(
            "torque_dead",
            Stage.JOINTS,
            "joints",
            f"the torque of {names} is {effort[0, is_dead][0]:.3g} Nm in all {len(effort):,} samples while those of "
            "other joints change: the load on this leg is wrong; repair the sensor, or leave the leg out by "
            f"dataset.corrections.joints.left_out=[{names}]",
        )


def _wrong_factor(factor: float, robot: RobotModel, *, is_certain: bool) -> Finding:
    setting = f"{_FACTOR}{factor:.3g}"
    said = (
        f"the joint torques carry the robot's weight of {robot.mass_kg * GRAVITY_MPS2:.0f} N in the mean only if they "
        f"are multiplied by {factor:.3g}"
    )
    if -_SURE[1] < factor < -_SURE[0]:
        text = f"{said}: they have the opposite sign of the motors' torques on the joints; set {_FACTOR}-1"
        return error("torque_sign", Stage.JOINTS, "joints", text, f"{_FACTOR}-1", is_certain=is_certain)
    if _SURE[0] < factor < _SURE[1]:
        text = f"{said}: a motor constant or the masses of the URDF are off; set {setting} if it is the former"
        return warning("torque_scale", Stage.JOINTS, "joints", text)
    text = (
        f"{said} (1 expected): another unit, such as currents or Nmm, or a robot that does not stand on its feet; set "
        f"{setting} if it stands"
    )
    return error("torque_scale", Stage.JOINTS, "joints", text, setting)


def _pulling_legs(mean: Array, robot: RobotModel) -> Finding | None:
    is_negative = mean < _NEGATIVE_SHARE * robot.mass_kg * GRAVITY_MPS2 / len(mean)
    if not is_negative.any():
        return None
    legs = listing(np.array(robot.leg_names)[is_negative].tolist())
    return warning(
        "torque_leg_sign",
        Stage.JOINTS,
        "joints",
        f"by the joint torques {legs} pulls at the ground by {-mean[is_negative].min():.0f} N in the mean while "
        "the others push: the sign or the order of torques of this leg is wrong; correct it where they are recorded",
    )


def _beyond_limits(joints: JointRecord, robot: RobotModel) -> Iterator[Finding]:
    largest = np.nanquantile(np.abs(np.nan_to_num(joints.effort)), 0.99, axis=0)
    ratio = largest / robot.effort_limits
    worst = int(np.argmax(ratio))
    if ratio[worst] > _BEYOND_LIMIT:
        yield warning(
            "torque_limits",
            Stage.JOINTS,
            "joints",
            f"the torque of {robot.joint_names[worst]} reaches {largest[worst]:.3g} Nm, {ratio[worst]:.2g} times its "
            f"limit in the URDF ({robot.effort_limits[worst]:.3g} Nm): another unit; set {_FACTOR[:-1]} to the "
            "motor's constant",
        )

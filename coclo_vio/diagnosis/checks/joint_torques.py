# SPDX-License-Identifier: BSD-3-Clause
"""Joint torques where contact is estimated from them: absent, zero, of another sign or unit than the robot's weight.

Over a walk, as over a stand, the vertical forces of the ground carry the robot's weight in the mean, whatever the gait:
the sum of those that the torques say, over the weight, is near one.
"""

from collections.abc import Iterator

import numpy as np

from coclo_vio.diagnosis.checks.joint_order import keeps_distances
from coclo_vio.diagnosis.checks.joint_positions import is_in_degrees
from coclo_vio.diagnosis.evidence import Evidence, JointRecord
from coclo_vio.diagnosis.finding import Finding, Stage, error, warning
from coclo_vio.diagnosis.joint_series import thinned, up_body_at
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import listing
from coclo_vio.values.units import GRAVITY_MPS2

_FACTOR = "dataset.corrections.joints.effort_factor="
_RATE_HZ = 10.0
_SAMPLES = 400
_SURE = (0.33, 3.0)  # carried share of the weight: loads, friction and rough motor constants stay within
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
    silent = _silent(joints, robot)
    if silent is not None:
        yield silent
        return
    yield from _dead(joints, robot)
    loads = vertical_loads(evidence, joints, robot)
    carried = loads[np.isfinite(loads).all(axis=1)]
    if len(carried) < _LEAST_SAMPLES:
        return
    weight = robot.mass_kg * GRAVITY_MPS2
    share = float(carried.sum(axis=1).mean()) / weight
    if _USUAL[0] < share < _USUAL[1]:
        yield from _negative_legs(carried.mean(axis=0), weight, robot)
    else:
        yield _wrong_share(share, weight, is_certain=keeps_distances(evidence))
    yield from _beyond_limits(joints, robot)


def vertical_loads(evidence: Evidence, joints: JointRecord, robot: RobotModel) -> Array:
    """Vertical forces on the feet by the torques, without inertia, N, (N, n); NaN where unknown."""
    rows = thinned(joints.stamps_ns, _RATE_HZ, _SAMPLES)
    ups = up_body_at(evidence, joints, rows)
    found = []
    for row, up in zip(rows, ups, strict=True):
        position, velocity, effort = joints.position[row], joints.velocity[row], joints.effort[row]
        found.append(robot.foot_forces(position, velocity, effort, specific_force_body=GRAVITY_MPS2 * up) @ up)
    return np.array(found)


def _silent(joints: JointRecord, robot: RobotModel) -> Finding | None:
    effort = joints.effort
    has_reading = np.isfinite(effort)
    count = int(has_reading.any(axis=0).sum())
    what = f"in all {len(effort):,} samples, but contact.source is torque: no foot is ever in stance"
    cure = "record torques"
    if robot.description.contact.source == "torque":
        cure += ", or where feet have sensors set robot.contact.source=force_sensor with its thresholds"
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
            "other "
            "joints change: the load on this leg is wrong; repair the sensor, or leave the leg out by "
            f"dataset.corrections.joints.left_out=[{names}]",
        )


def _wrong_share(share: float, weight: float, *, is_certain: bool) -> Finding:
    said = (
        f"the joint torques say that the feet carry {share:.2g} times the robot's weight of {weight:.0f} N in the mean"
    )
    if -_SURE[1] < share < -_SURE[0]:
        text = f"{said}: they have the opposite sign of the motors' torques on the joints; set {_FACTOR}-1"
        return error("torque_sign", Stage.JOINTS, "joints", text, f"{_FACTOR}-1", is_certain=is_certain)
    if _SURE[0] < share < _SURE[1]:
        text = f"{said} (1 expected): a motor constant or the masses of the URDF are off by this factor"
        return warning(
            "torque_scale", Stage.JOINTS, "joints", f"{text}; set {_FACTOR}{1.0 / share:.3g} if it is the former"
        )
    text = (
        f"{said} (1 expected): another unit, such as currents or Nmm, or a robot that does not stand on its feet; set "
        f"{_FACTOR}{1.0 / share:.3g} if it stands"
    )
    return error("torque_scale", Stage.JOINTS, "joints", text, f"{_FACTOR}{1.0 / share:.3g}")


def _negative_legs(mean: Array, weight: float, robot: RobotModel) -> Iterator[Finding]:
    is_negative = mean < _NEGATIVE_SHARE * weight / len(mean)
    if is_negative.any():
        legs = listing(np.array(robot.leg_names)[is_negative].tolist())
        yield warning(
            "torque_leg_sign",
            Stage.JOINTS,
            "joints",
            f"by the joint torques leg {legs} pulls at the ground by {-mean[is_negative].min():.0f} N in the mean "
            "while the "
            "others push: the sign or the order of torques of this leg is wrong; correct it where they are recorded",
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
            "limit "
            f"in the URDF ({robot.effort_limits[worst]:.3g} Nm): another unit; set {_FACTOR} to the motor's constant",
        )

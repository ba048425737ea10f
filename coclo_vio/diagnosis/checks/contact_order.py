# SPDX-License-Identifier: BSD-3-Clause
"""Loads of the feet against their motion: feet that are both loaded stand still relative to each other.

The residuals of ``joint_order`` are small between feet that stand and large where one of them swings. Where those of
pairs that are both in stance by their loads are no smaller than the others, the loads are those of other feet.
"""

from collections.abc import Iterator

import numpy as np

from coclo_vio.diagnosis.checks.joint_order import known_motion, pair_residuals
from coclo_vio.diagnosis.checks.joint_positions import is_in_degrees
from coclo_vio.diagnosis.checks.joint_torques import are_usual, missing_factor, silent, vertical_loads
from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.finding import Finding, Stage, error
from coclo_vio.diagnosis.joint_arrangements import leg_orders
from coclo_vio.diagnosis.joint_series import LegMotion
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array, BoolArray, IntArray
from coclo_vio.values.errors import listing

_SAMPLES = 300
_QUANTILE = 0.7  # of loaded pairs: some are in the air while sensors linger
_LEAST_PAIRS = 30
_UNLIKE = 0.6  # residual of loaded pairs over that of the others; sound walks: 0.04 to 0.47
_ALIKE = 0.5  # of that
_OLDEST_NS = 100_000_000


def find(evidence: Evidence) -> Iterator[Finding]:
    """Loads that belong to other feet."""
    robot = evidence.robot
    if robot is None or len(robot.leg_names) < 3:
        return
    motion = known_motion(evidence, robot, _SAMPLES)
    load = None if motion is None else _load(evidence, robot, motion)
    if motion is None or load is None:
        return
    pairs, by_gyroscope, by_distance = pair_residuals(robot, motion)
    residual = by_distance if by_gyroscope is None else by_gyroscope
    is_loaded = load >= robot.description.contact.on_force
    ratio = _ratio(residual, pairs, is_loaded)
    if ratio is None or ratio < _UNLIKE:
        return
    ratios = {order: _ratio(residual, pairs, is_loaded[:, list(order)]) for order in leg_orders(robot)}
    known = {order: found for order, found in ratios.items() if found is not None}
    best = min(known, key=lambda order: known[order], default=None)
    if best is not None and known[best] < min(_UNLIKE, _ALIKE * ratio):
        yield _finding(robot, best, ratio, known[best])


def _load(evidence: Evidence, robot: RobotModel, motion: LegMotion) -> Array | None:
    joints, record = evidence.joints, evidence.foot_force
    if joints is None or is_in_degrees(joints, robot):
        return None
    if robot.description.contact.source == "kinematic":
        return None
    if robot.description.contact.source == "force_sensor":
        if record is None or not len(record.stamps_ns):
            return None
        latest = np.searchsorted(record.stamps_ns, motion.stamps_ns, side="right") - 1
        is_old = (latest < 0) | (motion.stamps_ns - record.stamps_ns[latest] > _OLDEST_NS)
        return np.where(is_old[:, None], np.nan, record.force[latest])
    if silent(joints) is not None or not are_usual(missing_factor(evidence, joints, robot)):
        return None
    return vertical_loads(evidence, joints, robot, np.searchsorted(joints.stamps_ns, motion.stamps_ns))


def _ratio(residual: Array, pairs: IntArray, is_loaded: BoolArray) -> float | None:
    """Residual of pairs that are loaded over that of the others; None where one of them is too rare."""
    is_both = is_loaded[:, pairs[:, 0]] & is_loaded[:, pairs[:, 1]] & np.isfinite(residual)
    is_other = ~is_both & np.isfinite(residual)
    if min(is_both.sum(), is_other.sum()) < _LEAST_PAIRS:
        return None
    return float(np.quantile(residual[is_both], _QUANTILE) / max(float(np.median(residual[is_other])), 1e-9))


def _finding(robot: RobotModel, order: tuple[int, ...], before: float, after: float) -> Finding:
    legs = robot.leg_names
    moved = [(leg, legs[source]) for leg, source in zip(legs, order, strict=True) if leg != legs[source]]
    said = (
        f"loaded feet move as much relative to each other as those in the air ({before:.2f} times, {after:.2f} if the "
        f"loads are exchanged: {listing(f'{leg} from {source}' for leg, source in moved)})"
    )
    if robot.description.contact.source != "force_sensor":
        text = f"{said}: the torques are in another order than the angles; correct it where they are recorded"
        return error("contact_order", Stage.CONTACT, "joints", text)
    setting = f"dataset.corrections.foot_force.order={{{', '.join(f'{leg}: {source}' for leg, source in moved)}}}"
    text = f"{said}: the forces are in another order than the legs; set {setting}"
    return error("contact_order", Stage.CONTACT, "foot_force", text, setting, is_certain=True)

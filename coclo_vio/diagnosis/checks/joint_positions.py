# SPDX-License-Identifier: BSD-3-Clause
"""Joint angles against the limits of the URDF, and joints that never move."""

from collections.abc import Iterator

import numpy as np

from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.finding import Finding, Stage, error, warning
from coclo_vio.diagnosis.joint_series import integral, seconds_of
from coclo_vio.diagnosis.records import JointRecord
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import listing

_MARGIN_RAD = 0.3  # zero offsets of encoders, and limits that were written roughly
_FAR_RAD = 0.5 * np.pi
_NOT_AN_ANGLE_RAD = 7.0  # more than a full turn
_STILL_RAD = 1e-6
_MOVING_RAD = 0.1
_TURNING_RADPS = 0.02  # scatter of means of the gyroscope over 0.1 s, from which the robot moves
_MOVED_M = 0.3
_SPEED_RADPS = 0.1
_LEAST_SAMPLES = 50


def find(evidence: Evidence) -> Iterator[Finding]:
    """Angles in another unit, beyond the limits, and joints that do not move."""
    joints, robot = evidence.joints, evidence.robot
    if joints is None or robot is None or len(joints.stamps_ns) < _LEAST_SAMPLES:
        return
    yield from _units_and_limits(joints, robot)
    yield from _still(evidence, joints, robot)


def is_in_degrees(joints: JointRecord, robot: RobotModel) -> bool:
    """Whether the angles are degrees: beyond the limits and a full turn as radians, within the limits as degrees."""
    if np.isnan(joints.position).all():
        return False
    largest = float(np.nanquantile(np.fmax.reduce(np.abs(joints.position), axis=1), 0.99))
    has_limits = np.isfinite(robot.position_limits).all(axis=0) & np.isfinite(joints.position).any(axis=0)
    if not has_limits.any() or largest < _NOT_AN_ANGLE_RAD:
        return False
    as_degrees = _excess(np.deg2rad(joints.position), robot, turns=False)[:, has_limits]
    if _share_beyond(as_degrees) > 0.01:
        return False
    low, high = np.nanquantile(joints.position[:, has_limits], (0.01, 0.99), axis=0)
    lower, upper = robot.position_limits[:, has_limits]
    is_wider = high - low > upper - lower + _MARGIN_RAD
    as_radians = _excess(joints.position, robot, turns=True)[:, has_limits]
    return bool(is_wider.mean() > 0.3 or _share_beyond(as_radians) > 0.15)


def joints_beyond(position: Array, robot: RobotModel) -> int:
    """How many joints of angles (N, J) are beyond their limits in most samples."""
    typical = np.median(np.nan_to_num(_excess(position, robot, turns=True)), axis=0)
    return int(np.count_nonzero(typical > _MARGIN_RAD))


def _units_and_limits(joints: JointRecord, robot: RobotModel) -> Iterator[Finding]:
    if np.isnan(joints.position).all():
        return
    if is_in_degrees(joints, robot):
        largest = float(np.nanmax(np.abs(joints.position)))
        yield error(
            "joint_position_unit",
            Stage.JOINTS,
            "joints",
            f"the joint angles reach {largest:.4g}, which is beyond the limits of the URDF as radians and within them "
            "as degrees: set dataset.corrections.joints.position_unit=deg",
            "dataset.corrections.joints.position_unit=deg",
            is_certain=True,
        )
        return
    excess = _excess(joints.position, robot, turns=True)
    typical = np.nan_to_num(np.nanmedian(np.where(np.isnan(excess), 0.0, excess), axis=0))
    beyond = np.flatnonzero(typical > _MARGIN_RAD)
    if not len(beyond):
        return
    worst = int(np.argmax(typical))
    lower, upper = robot.position_limits[:, worst]
    value = float(np.nanmedian(joints.position[:, worst]))
    is_most = np.count_nonzero(typical > _FAR_RAD) >= 0.5 * len(typical)
    report = error if is_most else warning
    names = [robot.joint_names[joint] for joint in beyond]
    negated = np.nanmedian(np.nan_to_num(_excess(-joints.position, robot, turns=True)), axis=0)[beyond]
    signs = f"dataset.corrections.joints.signs={{{', '.join(f'{name}: -1' for name in names)}}}"
    fits_negated = bool((negated == 0.0).all())
    cure = (
        f"with the opposite sign they would be within: set {signs}"
        if fits_negated
        else "correct the unit, zero, sign or order of the joints (dataset.corrections.joints) or the URDF"
    )
    yield report(
        "joint_position_limits",
        Stage.JOINTS,
        "joints",
        f"{_counted(len(beyond), 'joint is', 'joints are')} beyond the limits of the URDF in most samples "
        f"({listing(names[:6])}): {robot.joint_names[worst]} is at {value:.3g} "
        f"rad, its limits are {lower:.3g} and {upper:.3g}; {cure}",
        *((signs,) if fits_negated else ()),
    )


def _still(evidence: Evidence, joints: JointRecord, robot: RobotModel) -> Iterator[Finding]:
    has_reading = np.isfinite(joints.position).sum(axis=0) >= _LEAST_SAMPLES
    low, high = np.fmin.reduce(joints.position, axis=0), np.fmax.reduce(joints.position, axis=0)
    span = np.where(has_reading, high - low, np.nan)
    samples = len(joints.position)
    is_still = span < _STILL_RAD
    if not is_still.any():
        return
    duration_s = (joints.stamps_ns[-1] - joints.stamps_ns[0]) / 1e9
    if is_still[has_reading].all():
        if _is_moving(evidence, joints):
            yield error(
                "joints_still",
                Stage.JOINTS,
                "joints",
                f"the angles of all {int(has_reading.sum())} joints are the same in all {samples:,} samples "
                f"({duration_s:.0f} s) although the robot moves: they are not measured; record the joints, or run a "
                "mode without legs (--mode)",
            )
        return
    for leg, inside in zip(robot.leg_names, robot.leg_joint_slices, strict=True):
        stuck = [joint for joint in range(inside.start, inside.stop) if is_still[joint]]
        others = [
            span[joint] for joint in range(inside.start, inside.stop) if has_reading[joint] and joint not in stuck
        ]
        if not stuck or not (np.nanmax(span) > _MOVING_RAD and _is_moving_elsewhere(stuck, span, robot)):
            continue
        names = [robot.joint_names[joint] for joint in stuck]
        setting = f"dataset.corrections.joints.left_out=[{', '.join(names)}]"
        yield warning(
            "joint_still",
            Stage.JOINTS,
            "joints",
            f"the angle of {listing(names)} is {joints.position[0, stuck[0]]:.4g} rad in all {samples:,} samples "
            f"while {'the rest of the leg' if others else 'other legs'} moves by up to "
            f"{max(others, default=np.nanmax(span)):.2g} rad: a dead encoder; leave leg {leg} out by {setting}",
            setting,
            is_certain=True,
        )


def _is_moving(evidence: Evidence, joints: JointRecord) -> bool:
    """Whether gyroscope, ground truth or the joints' own velocities show motion."""
    if float(np.sqrt(np.mean(np.nan_to_num(joints.velocity) ** 2))) > _SPEED_RADPS:
        return True
    truth, imu = evidence.truth, evidence.imu
    if truth is not None and float(np.ptp(truth.trajectory.positions, axis=0).max()) > _MOVED_M:
        return True
    if imu is None or len(imu.stamps_ns) < _LEAST_SAMPLES:
        return False
    s = seconds_of(imu.stamps_ns, int(imu.stamps_ns[0]))
    at = np.arange(0.0, s[-1], 0.1)
    if len(at) < 10:
        return False
    turned = np.diff([np.interp(at, s, column) for column in integral(s, imu.rate).T], axis=1) / 0.1
    return float(np.linalg.norm(turned.std(axis=1))) > _TURNING_RADPS


def _is_moving_elsewhere(stuck: list[int], span: Array, robot: RobotModel) -> bool:
    """Whether the same joints of most other legs move, so that standing still is not the gait."""
    for inside in robot.leg_joint_slices:
        for joint in stuck:
            if inside.start <= joint < inside.stop:
                place = joint - inside.start
                same = [span[each.start + place] for each in robot.leg_joint_slices if each.start + place < each.stop]
                if float(np.nanmedian(same)) > 0.5 * _MOVING_RAD:
                    return True
    return False


def _excess(position: Array, robot: RobotModel, *, turns: bool) -> Array:
    """How far angles (N, J) are beyond the limits, rad, (N, J); with ``turns`` after whole turns were taken away."""
    lower, upper = robot.position_limits
    if turns:
        middle = np.where(np.isfinite(lower + upper), 0.5 * (lower + upper), 0.0)
        away = position - middle
        position = middle + away - 2.0 * np.pi * np.round(away / (2.0 * np.pi))
    return np.asarray(np.maximum(np.maximum(lower - position, position - upper), 0.0))


def _share_beyond(excess: Array) -> float:
    """Share of the known readings that are beyond the limits by more than the margin."""
    return float(np.mean(excess[np.isfinite(excess)] > _MARGIN_RAD))


def _counted(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"

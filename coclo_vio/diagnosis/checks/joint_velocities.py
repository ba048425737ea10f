# SPDX-License-Identifier: BSD-3-Clause
"""Joint velocities against the derivative of the angles: zero, in another unit, of another sign, late, or of others.

Angles' differences over 0.2 s are compared with the integral of the velocities over the same time, so that noise of
either hardly matters.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from coclo_vio.diagnosis.checks.joint_positions import is_in_degrees
from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.finding import Finding, Stage, error, warning
from coclo_vio.diagnosis.joint_series import integral, seconds_of
from coclo_vio.diagnosis.records import JointRecord
from coclo_vio.values.arrays import Array, BoolArray, IntArray
from coclo_vio.values.errors import listing

_SPAN_S = 0.2
_LONGEST_SPAN_S = 0.5
_LEAST_RAD = 0.02  # root mean square of a joint's differences, from which it moves
_LEAST_SPANS = 30
_FACTORS = {"deg/s": np.pi / 180.0, "rpm": 2.0 * np.pi / 60.0}
_FACTOR_TOLERANCE = 0.15
_OF_ANOTHER = 0.5  # a correlation below this is not that of a joint with its own velocity
_LAGS_S = np.arange(-0.3, 0.301, 0.01)
_LATE_S = 0.03
_VERY_LATE_S = 0.1
_FROM_POSITION = "dataset.corrections.joints.velocity=from_position"
_UNIT = "dataset.corrections.joints.velocity_unit="


@dataclass(frozen=True, slots=True, eq=False)
class _Comparison:
    """Joints that move: what their velocities say against what their angles do.

    Attributes:
        joints: their indices, (K,).
        moved: differences of angles, rad, (M, K).
        said: integrals of velocities over the same spans, (M, K).
        slope: angle's rate over velocity, (K,).
        correlation: of the two, (K,).
    """

    joints: IntArray
    moved: Array
    said: Array

    @property
    def slope(self) -> Array:
        return np.asarray((self.moved * self.said).sum(axis=0) / np.maximum((self.said**2).sum(axis=0), 1e-30))

    @property
    def correlation(self) -> Array:
        squares = (self.moved**2).sum(axis=0) * (self.said**2).sum(axis=0)
        return np.asarray((self.moved * self.said).sum(axis=0) / np.maximum(np.sqrt(squares), 1e-30))


def find(evidence: Evidence) -> Iterator[Finding]:
    """Velocities that contradict the angles."""
    joints, robot = evidence.joints, evidence.robot
    if joints is None or robot is None or np.isnan(joints.velocity).all() or np.isnan(joints.position).all():
        return
    spans = _spans(joints)
    compared = None if spans is None else _compared(joints, spans)
    if spans is None or compared is None:
        return
    names = [robot.joint_names[joint] for joint in compared.joints]
    is_zero = np.nanmax(np.abs(joints.velocity[:, compared.joints]), axis=0, initial=0.0) == 0.0
    if is_zero.any():
        yield _zero(names, is_zero, joints, compared)
        return
    correlation, slope = compared.correlation, compared.slope
    if np.median(np.abs(correlation)) < _OF_ANOTHER:
        late = _lag(joints, spans, compared)
        yield _late(late[0]) if late is not None and late[1] > 0.9 else _of_others(float(np.median(correlation)))
        return
    late = _lag(joints, spans, compared)
    if late is not None and abs(late[0]) >= _LATE_S:
        yield _late(late[0])
        return
    factor = float(np.median(slope))
    in_degrees = is_in_degrees(joints, robot)
    if in_degrees:
        factor *= np.pi / 180.0
    expected = _FACTORS["deg/s"] if in_degrees else 1.0  # as angles, so velocities by default
    if abs(factor / expected - 1.0) > _FACTOR_TOLERANCE:
        yield _wrong_factor(factor, float(np.median(correlation)), in_degrees=in_degrees)
    yield from _odd_joints(names, correlation, slope / np.median(slope))


def _spans(joints: JointRecord) -> tuple[IntArray, int] | None:
    """First samples of the spans, and how many samples they are long."""
    s = seconds_of(joints.stamps_ns, int(joints.stamps_ns[0]))
    if len(s) < 10:
        return None
    step_s = max(float(np.median(np.diff(s))), 1e-6)
    length = max(1, round(_SPAN_S / step_s))
    first = np.arange(0, len(s) - length, max(1, length // 4))
    span_s = s[first + length] - s[first]
    first = first[(span_s > 0.0) & (span_s < _LONGEST_SPAN_S)]
    return (first, length) if len(first) >= _LEAST_SPANS else None


def _compared(joints: JointRecord, spans: tuple[IntArray, int]) -> _Comparison | None:
    first, length = spans
    s = seconds_of(joints.stamps_ns, int(joints.stamps_ns[0]))
    is_known = np.isfinite(joints.velocity) & np.isfinite(joints.position)
    is_joint = is_known.mean(axis=0) > 0.9
    total = integral(s, np.nan_to_num(joints.velocity))
    moved = joints.position[first + length] - joints.position[first]
    is_whole = np.isfinite(moved[:, is_joint]).all(axis=1) if is_joint.any() else np.zeros(len(first), dtype=np.bool_)
    moved, said = moved[is_whole], (total[first + length] - total[first])[is_whole]
    if len(moved) < _LEAST_SPANS:
        return None
    is_moving: BoolArray = is_joint & (np.sqrt((moved**2).mean(axis=0)) > _LEAST_RAD)
    chosen = np.flatnonzero(is_moving)
    return _Comparison(chosen, moved[:, chosen], said[:, chosen]) if len(chosen) else None


def _lag(joints: JointRecord, spans: tuple[IntArray, int], compared: _Comparison) -> tuple[float, float] | None:
    """By how much the velocities are late, s, and the correlation then; None where no lag is clearly better than "
    "none."""
    first, length = spans
    s = seconds_of(joints.stamps_ns, int(joints.stamps_ns[0]))
    velocity = np.nan_to_num(joints.velocity[:, compared.joints])
    total = integral(s, velocity)
    scale = np.sqrt((compared.moved**2).mean(axis=0)) * np.sqrt((velocity**2).mean(axis=0))
    moved = (joints.position[first + length] - joints.position[first])[:, compared.joints]
    inside = np.isfinite(moved).all(axis=1) & (s[first] > 0.35) & (s[first + length] < s[-1] - 0.35)
    if inside.sum() < _LEAST_SPANS:
        return None
    start, end, moved = s[first[inside]], s[first[inside] + length], moved[inside] / scale
    index = np.arange(len(s), dtype=np.float64)

    def correlation(lag_s: float) -> float:
        said = (_at(total, np.interp(end + lag_s, s, index)) - _at(total, np.interp(start + lag_s, s, index))) / scale
        return float((moved * said).sum() / max(np.sqrt((moved**2).sum() * (said**2).sum()), 1e-30))

    found = np.array([correlation(lag_s) for lag_s in _LAGS_S])
    best, none = int(np.argmax(found)), float(found[len(_LAGS_S) // 2])
    if found[best] < 0.8 or 1.0 - found[best] ** 2 > 0.5 * (1.0 - none**2):
        return None
    return float(_LAGS_S[best]), float(found[best])


def _at(rows: Array, index: Array) -> Array:
    """Rows (N, k) at fractional indices (M,), linear between them, (M, k)."""
    low = np.clip(index.astype(int), 0, len(rows) - 2)
    share = (index - low)[:, None]
    return np.asarray(rows[low] * (1.0 - share) + rows[low + 1] * share)


def _zero(names: list[str], is_zero: BoolArray, joints: JointRecord, compared: _Comparison) -> Finding:
    which = f"all {len(names)} joints that move" if is_zero.all() else listing(np.array(names)[is_zero].tolist())
    moved = float(np.max(np.abs(compared.moved[:, is_zero])))
    return error(
        "joint_velocity_zero",
        Stage.JOINTS,
        "joints",
        f"the velocities of {which} are zero in all {len(joints.stamps_ns):,} samples while their angles change by up "
        f"to {moved:.2g} rad in 0.2 s: set {_FROM_POSITION}, which estimates them from the angles",
        _FROM_POSITION,
        is_certain=True,
    )


def _of_others(correlation: float) -> Finding:
    return error(
        "joint_velocity_contradicts",
        Stage.JOINTS,
        "joints",
        f"the velocities of the joints are not the derivatives of their angles (median correlation {correlation:.2f}, "
        f"1 expected): another order or another signal; set {_FROM_POSITION}, which estimates them from the angles",
        _FROM_POSITION,
        is_certain=True,
    )


def _wrong_factor(factor: float, correlation: float, *, in_degrees: bool) -> Finding:
    """A common factor between velocities and the derivatives of the angles, which are radians after correction."""
    said = f"the joint angles change at {factor:.3g} times the recorded velocities (correlation {correlation:.2f}"
    units = {**_FACTORS, "rad/s": 1.0}
    unit = next((name for name, known in units.items() if abs(factor / known - 1.0) < _FACTOR_TOLERANCE), None)
    if unit == "rad/s":
        text = f"the joint velocities are rad/s although the angles are degrees: set {_UNIT}{unit}"
        return error("joint_velocity_unit", Stage.JOINTS, "joints", text, _UNIT + unit, is_certain=True)
    if unit is not None:
        text = f"{said}), as velocities in {unit} do: set {_UNIT}{unit}"
        return error("joint_velocity_unit", Stage.JOINTS, "joints", text, _UNIT + unit, is_certain=True)
    if abs(factor * _FACTORS["deg/s"] - 1.0) < _FACTOR_TOLERANCE and not in_degrees:
        settings = ("dataset.corrections.joints.position_unit=deg", _UNIT + "rad/s")
        text = f"{said}), as angles in degrees with velocities in rad/s do: set {' and '.join(settings)}"
        return error("joint_velocity_unit", Stage.JOINTS, "joints", text, *settings)
    if abs(factor + 1.0) < _FACTOR_TOLERANCE:
        text = (
            f"{said}): the velocities have the opposite sign of the angles; set {_FROM_POSITION}, which estimates "
            "them from the angles"
        )
        return error("joint_velocity_sign", Stage.JOINTS, "joints", text, _FROM_POSITION, is_certain=True)
    is_far = factor < 0.67 or factor > 1.5
    text = f"{said}), 1 expected: an unknown unit; set {_FROM_POSITION}, which estimates them from the angles"
    severity = error if is_far else warning
    return severity("joint_velocity_unit", Stage.JOINTS, "joints", text, _FROM_POSITION, is_certain=is_far)


def _odd_joints(names: list[str], correlation: Array, slope: Array) -> Iterator[Finding]:
    """Single joints whose velocities contradict their angles while those of the others do not."""
    usual = np.sign(np.median(correlation))
    kinds = {
        "have the opposite sign of their angles' derivatives": usual * correlation < -_OF_ANOTHER,
        "are not the derivatives of their angles": np.abs(correlation) < 0.5 * _OF_ANOTHER,
        "have another unit than those of the other joints": (usual * correlation > 0.8)
        & ((slope < 0.5) | (slope > 2.0)),
    }
    for what, is_so in kinds.items():
        if is_so.any():
            yield error(
                "joint_velocity_contradicts",
                Stage.JOINTS,
                "joints",
                f"the velocities of {listing(np.array(names)[is_so].tolist())} {what}: set {_FROM_POSITION}, which "
                "estimates velocities from the angles",
                _FROM_POSITION,
                is_certain=True,
            )


def _late(lag_s: float) -> Finding:
    report = error if abs(lag_s) >= _VERY_LATE_S else warning
    return report(
        "joint_velocity_delay",
        Stage.JOINTS,
        "joints",
        f"the velocities of the joints are {abs(lag_s):.2f} s {'late' if lag_s > 0 else 'early'} against their angles "
        f"(0 expected): a filter or another clock; set {_FROM_POSITION}, which estimates them from the angles",
        _FROM_POSITION,
        is_certain=True,
    )

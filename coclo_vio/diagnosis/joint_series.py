# SPDX-License-Identifier: BSD-3-Clause
"""Joint readings prepared for checks: thinned, with rates from differences of the angles, and the feet that follow."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.records import InertialRecord, JointRecord
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.units import NS_PER_S

_HALF_SPAN_S = 0.05  # rates are differences over twice this
_LONGEST_SPAN_S = 0.3  # longer ones span a gap
_OPPOSITE = 0.7  # cosine of 45 deg
_LEAST_RATE_RADPS = 0.1  # root mean square of all joints, below which the legs stand


_STEPPING_HZ, _STEPPING_SAMPLES = 20.0, 1200
_STEPPING_M = 0.04  # change of the distance of two feet, from which both cannot have stood all the time
_CYCLING_RAD = 0.1
_STEPPING_TURNS = 3  # a robot that stands up has one


@dataclass(frozen=True, slots=True, eq=False)
class LegMotion:
    """Legs in motion at N times.

    Attributes:
        stamps_ns: of the joints' samples, (N,).
        position: rad, (N, J).
        rate: differences of the angles over 0.1 s, rad/s, (N, J).
        body_rate: mean of the gyroscope over the same 0.1 s, body frame, rad/s, (N, 3); None without an IMU.
    """

    stamps_ns: IntArray
    position: Array
    rate: Array
    body_rate: Array | None

    def every(self, n: int) -> "LegMotion":
        """Every n-th of the times."""
        body_rate = None if self.body_rate is None else self.body_rate[::n]
        return LegMotion(self.stamps_ns[::n], self.position[::n], self.rate[::n], body_rate)


def seconds_of(stamps_ns: IntArray, first_ns: int) -> Array:
    """Seconds since ``first_ns``, (N,)."""
    return np.asarray((stamps_ns - first_ns) / NS_PER_S)


def thinned(stamps_ns: IntArray, rate_hz: float, most: int) -> IntArray:
    """Indices of samples at about a rate, at most so many, evenly spread."""
    if len(stamps_ns) < 2:
        return np.arange(len(stamps_ns))
    step_s = max(float(np.median(np.diff(stamps_ns))) / NS_PER_S, 1e-6)
    chosen = np.arange(0, len(stamps_ns), max(1, round(1.0 / (rate_hz * step_s))))
    return chosen if len(chosen) <= most else chosen[np.linspace(0, len(chosen) - 1, most).astype(int)]


def leg_motion(evidence: Evidence, most: int) -> LegMotion | None:
    """The legs while they move; None where they never do, or nothing is known of them."""
    joints = evidence.joints
    if joints is None or len(joints.stamps_ns) < 10:
        return None
    s = seconds_of(joints.stamps_ns, int(joints.stamps_ns[0]))
    half = max(1, round(_HALF_SPAN_S / max(float(np.median(np.diff(s))), 1e-6)))
    rows = np.arange(half, len(s) - half, max(1, half // 2))
    span_s = s[rows + half] - s[rows - half]
    with np.errstate(divide="ignore", invalid="ignore"):
        rates = (joints.position[rows + half] - joints.position[rows - half]) / span_s[:, None]
    is_good = (span_s > 0.0) & (span_s < _LONGEST_SPAN_S) & np.isfinite(rates).any(axis=1)
    is_good &= np.sqrt(np.nanmean(np.where(is_good[:, None], rates, 0.0) ** 2, axis=1)) > _LEAST_RATE_RADPS
    rows, rates = rows[is_good], rates[is_good]
    if len(rows) < 20:
        return None
    chosen = np.unique(np.linspace(0, len(rows) - 1, min(most, len(rows))).astype(int))
    rows, rates = rows[chosen], rates[chosen]
    imu, start_ns, end_ns = evidence.imu, joints.stamps_ns[rows - half], joints.stamps_ns[rows + half]
    body_rate = None
    if imu is not None and len(imu.stamps_ns) > 1:
        is_covered = (start_ns >= imu.stamps_ns[0]) & (end_ns <= imu.stamps_ns[-1])
        if is_covered.mean() > 0.5:
            rows, rates = rows[is_covered], rates[is_covered]
            body_rate = _mean_rate(evidence, imu, start_ns[is_covered], end_ns[is_covered])
    return LegMotion(joints.stamps_ns[rows], joints.position[rows], rates, body_rate)


def feet_of(robot: RobotModel, position: Array, rate: Array) -> tuple[Array, Array]:
    """Positions and velocities of the feet in the body frame, m and m/s, (N, n, 3), from joints (N, J)."""
    feet = [robot.feet(each, its_rate) for each, its_rate in zip(position, rate, strict=True)]
    return np.array([each.position_body for each in feet]), np.array([each.velocity_body for each in feet])


def rotation_body_imu(evidence: Evidence) -> Array:
    """``R_body_imu`` (3, 3) that a run would use; the identity where nothing is known."""
    imu = evidence.robot_imu or (None if evidence.robot is None else evidence.robot.description.imu)
    return np.eye(3) if imu is None else imu.T_body_imu[:3, :3]


def integral(stamps_s: Array, values: Array) -> Array:
    """Integral of values (N, k) over their stamps by trapezoids, (N, k), zero at the first."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(stamps_s)[:, None]
    return np.vstack((np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)))


def has_gravity(evidence: Evidence) -> bool:
    """Whether the accelerometer's mean is gravity: larger than its scatter, and opposite to where the feet are."""
    imu, joints, robot = evidence.imu, evidence.joints, evidence.robot
    if imu is None or len(imu.stamps_ns) < 10:
        return False
    mean = imu.force.mean(axis=0)
    if float(np.linalg.norm(mean)) < float(np.linalg.norm(imu.force.std(axis=0))):
        return False
    if joints is None or robot is None:
        return True
    rows = thinned(joints.stamps_ns, 1.0, 60)
    places, _ = feet_of(robot, joints.position[rows], np.zeros_like(joints.position[rows]))
    if np.isnan(places).all(axis=(0, 2)).all():
        return True
    up, down = rotation_body_imu(evidence) @ mean, np.nanmean(places, axis=(0, 1))
    return float(up @ down) < -_OPPOSITE * float(np.linalg.norm(up) * np.linalg.norm(down))


def up_body_at(evidence: Evidence, joints: JointRecord, rows: IntArray) -> Array:
    """The upward direction in the body frame by the accelerometer's mean over a second, (N, 3); z without gravity."""
    imu = evidence.imu
    if imu is None or not has_gravity(evidence):
        return np.tile([0.0, 0.0, 1.0], (len(rows), 1))
    first_ns = int(joints.stamps_ns[0])
    s, at = seconds_of(imu.stamps_ns, first_ns), seconds_of(joints.stamps_ns[rows], first_ns)
    total = integral(s, imu.force)
    mean = _between(at - 0.5, at + 0.5, s, total) @ rotation_body_imu(evidence).T
    mean[np.linalg.norm(mean, axis=1) < 1e-6] = [0.0, 0.0, 1.0]  # before or after the IMU
    return np.asarray(mean / np.linalg.norm(mean, axis=1, keepdims=True))


def _mean_rate(evidence: Evidence, imu: InertialRecord, start_ns: IntArray, end_ns: IntArray) -> Array:
    first_ns = int(start_ns[0])
    s = seconds_of(imu.stamps_ns, first_ns)
    start, end = seconds_of(start_ns, first_ns), seconds_of(end_ns, first_ns)
    turned = _between(start, end, s, integral(s, imu.rate)) / (end - start)[:, None]
    return np.asarray(turned @ rotation_body_imu(evidence).T)


def _between(start: Array, end: Array, s: Array, total: Array) -> Array:
    """Differences of an integral (M, 3) between two sets of times (N,), (N, 3)."""
    return np.stack([np.interp(end, s, column) - np.interp(start, s, column) for column in total.T], axis=1)


def is_stepping(evidence: Evidence, robot: RobotModel) -> bool:
    """Whether the legs step: the distance of two feet goes there and back, by more than feet that stand can.

    A robot that stands up, lies or hangs still does not, however far its legs move once.
    """
    joints = evidence.joints
    if joints is None or len(joints.stamps_ns) < 10:
        return False
    rows = thinned(joints.stamps_ns, _STEPPING_HZ, _STEPPING_SAMPLES)
    places, _ = feet_of(robot, joints.position[rows], np.zeros_like(joints.position[rows]))
    places = places[:, np.isfinite(places).mean(axis=(0, 2)) > 0.9]
    places = places[np.isfinite(places).all(axis=(1, 2))]
    if places.shape[1] < 2 or len(places) < 10:
        return False
    for other in range(1, places.shape[1]):
        distance = np.linalg.norm(places[:, other] - places[:, 0], axis=1)
        low, high = np.quantile(distance, (0.05, 0.95))
        if high - low > _STEPPING_M and _turns(distance, low, high) >= _STEPPING_TURNS:
            return True
    return False


def are_cycling(evidence: Evidence) -> bool:
    """Whether two joints at least go there and back several times, as those of legs that step, whatever their order."""
    joints = evidence.joints
    if joints is None or len(joints.stamps_ns) < 10:
        return False
    position = joints.position[thinned(joints.stamps_ns, _STEPPING_HZ, _STEPPING_SAMPLES)]
    cycling = 0
    for angle in position.T[np.isfinite(position).all(axis=0)]:
        low, high = np.quantile(angle, (0.05, 0.95))
        cycling += bool(high - low > _CYCLING_RAD and _turns(angle, low, high) >= _STEPPING_TURNS)
    return cycling >= 2


def _turns(values: Array, low: float, high: float) -> int:
    """How often values (N,) go from near a lower to near an upper one or back."""
    place = (values - low) / max(high - low, 1e-9)
    level = (place > 0.75).astype(np.int8) - (place < 0.25).astype(np.int8)
    return int(np.count_nonzero(np.diff(level[level != 0])))

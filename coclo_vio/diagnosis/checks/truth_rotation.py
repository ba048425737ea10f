# SPDX-License-Identifier: BSD-3-Clause
"""Rotations of the ground truth against gyroscope and gravity: order of the quaternion, upright world, constant pose.

Two quantities do not depend on how the tracked frame is turned against the robot's: the size of the rotation over a
time, by which the two clocks are brought together, and its part about the world's vertical, which the gyroscope
measures along gravity. Gravity itself shows which axis of the world is up where the tracked frame is that of the body.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from coclo_vio.diagnosis.checks.joint_order import gyroscope_fits
from coclo_vio.diagnosis.checks.truth_motion import stamp_unit
from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.finding import Finding, Stage, error, warning
from coclo_vio.diagnosis.joint_series import has_gravity, integral, rotation_body_imu, seconds_of
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.trajectory import Trajectory

_SETTING = "dataset.corrections.ground_truth."
_NOT_READ = f"{_SETTING}is_read=false"
_STEP_S = 0.1
_SPAN_STEPS = 5  # rotations over half a second
_LEAST_SPANS = 40
_LEAST_TURN_RAD = 0.02  # root mean square of rotations, below which they say little
_VERY_CLEAR = 0.9  # agreement that is asked for then
_SYNCHRONOUS = 0.6  # correlation of the sizes of rotations, from which the clocks are brought together
_CLEAR = 0.8
_NONE = 0.3
_SCALE = 2.0
_UPRIGHT_RAD = np.deg2rad(15.0)
_LYING_RAD = np.deg2rad(30.0)
_OVERTURNED_RAD = np.deg2rad(150.0)
_CONSTANT_RAD = 1e-4
_LEAST_HEIGHT_M = 0.05
_LARGEST_BIAS_RADPS = 0.03
_AXES = {"z": (0, 0, 1), "-z": (0, 0, -1), "y": (0, 1, 0), "-y": (0, -1, 0), "x": (1, 0, 0), "-x": (-1, 0, 0)}


@dataclass(frozen=True, slots=True, eq=False)
class _Turns:
    """Rotations over half a second, N of them, by ground truth and by IMU.

    Attributes:
        rotations: ``R_world_body`` in the middle, (N, 3, 3).
        world: rotation vectors of the ground truth in world axes, rad, (N, 3).
        vertical: rotation about the vertical by the gyroscope, rad, (N,).
        up_body: upward direction by the accelerometer, (N, 3).
        scale: size of the rotations by ground truth over that by the gyroscope.
        correlation: of the sizes of both at the lag that fits best.
    """

    rotations: Array
    world: Array
    vertical: Array
    up_body: Array
    scale: float
    correlation: float


def find(evidence: Evidence) -> Iterator[Finding]:
    """Rotations that gyroscope and gravity contradict."""
    truth = evidence.truth
    if truth is None or evidence.imu is None or len(truth.trajectory) < 10:
        return
    trajectory = truth.trajectory
    turned = _gyroscope_turns(evidence)
    if turned is None:
        return
    ours = so3.log(np.swapaxes(trajectory.rotations[:1], 1, 2) @ trajectory.rotations)
    if float(np.linalg.norm(ours, axis=1).max()) < _CONSTANT_RAD:
        if np.sqrt(np.mean(turned**2)) > 0.2 * _LEAST_TURN_RAD:
            yield _constant(len(trajectory))
        return
    if truth.has_stamps and stamp_unit(evidence) is not None:
        return
    if not has_gravity(evidence):
        return
    turns = _turns(evidence, trajectory) if truth.has_stamps else None
    is_synchronous = turns is not None and turns.correlation > _SYNCHRONOUS
    found = _by_vertical(evidence, turns) if turns is not None and is_synchronous else None
    if found is None:
        found = _by_gravity(evidence, trajectory, turns, is_synchronous=is_synchronous)
    if found is not None:
        yield found
    elif turns is not None and turns.correlation < _NONE:
        yield from _unrelated(turns)


def _constant(poses: int) -> Finding:
    return warning(
        "truth_rotation_constant",
        Stage.GROUND_TRUTH,
        "ground_truth",
        f"the ground truth has one orientation in all {poses:,} poses while the gyroscope turns: it holds positions "
        "only; scores of rotation and yaw mean nothing",
    )


def _readings(rotations: Array) -> Mapping[str, Array]:
    """The rotations as read, and with the quaternion's other order."""
    rolled = so3.from_quat_xyzw(np.roll(so3.to_quat_xyzw(rotations), -1, axis=1))
    return {"xyzw": rotations, "wxyz": rolled}


def _by_vertical(evidence: Evidence, turns: _Turns) -> Finding | None:
    """What makes the rotation about the vertical that of the gyroscope; None where that is so, or says nothing."""
    scores: dict[tuple[str, str], float] = {}
    rolled = _readings(turns.rotations)["wxyz"]
    steps = {"xyzw": turns.world, "wxyz": _rolled_turns(turns, rolled)}
    for order, world in steps.items():
        for axis, direction in _AXES.items():
            scores[order, axis] = _agreement(world @ np.array(direction, dtype=np.float64), turns.vertical)
    as_read = scores["xyzw", "z"]
    if as_read > _NONE + 0.2:
        return None
    is_turning = np.sqrt(np.mean(turns.vertical**2)) > _LEAST_TURN_RAD
    tilts = {key: _tilt(_readings(turns.rotations)[key[0]], key[1], turns.up_body) for key in scores}
    said = f"about the vertical the ground truth turns unlike the gyroscope (agreement {as_read:.2f}, 1 expected)"
    enough = _CLEAR if is_turning else _VERY_CLEAR
    if tilts["xyzw", "z"] > _LYING_RAD:
        clear = [key for key, score in scores.items() if score > enough]
        best = min(clear, key=lambda key: (tilts[key] > _UPRIGHT_RAD, key[1] != "z", -scores[key]), default=None)
        return None if best is None else _read_as(best, said, scores[best])
    if scores["xyzw", "-z"] < enough and not is_turning:
        return None
    fits = gyroscope_fits(evidence)
    if fits is False or not 1.0 / _SCALE < turns.scale < _SCALE:
        return None  # it is the gyroscope that is wrong
    if scores["xyzw", "-z"] > enough:
        text = f"{said} but in the opposite sense: a left-handed world, or inverse poses; leave it out by {_NOT_READ}"
        report = error if fits else warning
        certain = bool(fits)
        return report("truth_handedness", Stage.GROUND_TRUTH, "ground_truth", text, _NOT_READ, is_certain=certain)
    text = f"{said}: scores of rotation mean nothing; leave it out by {_NOT_READ}, or correct the gyroscope"
    return warning("truth_rotation", Stage.GROUND_TRUTH, "ground_truth", text, _NOT_READ)


def _rolled_turns(turns: _Turns, rolled: Array) -> Array:
    """Rotation vectors in world axes (N, 3) of the other reading, whose poses at start and end follow from these."""
    half = so3.exp(0.5 * turns.world)
    start, end = np.swapaxes(half, 1, 2) @ turns.rotations, half @ turns.rotations
    starts, ends = _readings(start)["wxyz"], _readings(end)["wxyz"]
    return np.asarray(so3.log(ends @ np.swapaxes(starts, 1, 2)))


def _by_gravity(
    evidence: Evidence, trajectory: Trajectory, turns: _Turns | None, *, is_synchronous: bool
) -> Finding | None:
    """What makes the body as upright as it is by the accelerometer; None where it is."""
    if evidence.robot_imu is None and evidence.description is None:  # the IMU's mounting is not known
        return None
    rotations, up_body = _with_gravity(evidence, trajectory) if turns is None else (turns.rotations, turns.up_body)
    tilts = {
        (order, axis): _tilt(each, axis, up_body) for order, each in _readings(rotations).items() for axis in _AXES
    }
    as_read = tilts["xyzw", "z"]
    if as_read < _LYING_RAD:
        return None
    said = (
        f"by its ground truth the robot lies {np.rad2deg(as_read):.0f} deg from upright, by its accelerometer it "
        "does not"
    )
    fitting = [key for key, tilt in tilts.items() if tilt < _UPRIGHT_RAD]
    is_turned_right = is_synchronous and turns is not None and _agreement(turns.world[:, 2], turns.vertical) > _CLEAR
    if is_turned_right or not fitting:
        text = f"{said}: the tracked frame is turned against the robot's; scores of rotation contain that turn"
        return warning("truth_upright", Stage.GROUND_TRUTH, "ground_truth", text)
    heights = {
        key: float(np.median(trajectory.positions @ np.array(_AXES[key[1]], dtype=np.float64))) for key in fitting
    }
    best = max(fitting, key=lambda key: (round(heights[key] / _LEAST_HEIGHT_M), key[0] == "wxyz", key[1] == "z"))
    others = [heights[key] for key in fitting if key != best]
    is_alone = heights[best] > _LEAST_HEIGHT_M and all(height < 0.1 * heights[best] for height in others)
    is_certain = (is_alone or not others) and as_read > _OVERTURNED_RAD and (turns is None or is_synchronous)
    return _read_as(best, said, None, is_certain=bool(is_certain))


def _with_gravity(evidence: Evidence, trajectory: Trajectory) -> tuple[Array, Array]:
    """Some rotations (N, 3, 3), and the mean upward direction in the body by the accelerometer, (N, 3)."""
    rows = np.unique(np.linspace(0, len(trajectory) - 1, min(300, len(trajectory))).astype(int))
    force = np.zeros((1, 3)) if evidence.imu is None else evidence.imu.force
    mean = rotation_body_imu(evidence) @ force.mean(axis=0)
    return trajectory.rotations[rows], np.tile(mean / max(float(np.linalg.norm(mean)), 1e-9), (len(rows), 1))


def _read_as(best: tuple[str, str], said: str, score: float | None, *, is_certain: bool = True) -> Finding:
    order, axis = best
    settings, reasons = [], []
    if order == "wxyz":
        settings.append(f"{_SETTING}quaternion=wxyz")
        reasons.append("its quaternions are w x y z")
    if axis != "z":
        settings.append(f"{_SETTING}up={axis}")
        reasons.append(f"the axis of its world that points up is {axis}")
    agrees = "" if score is None else f" (then the agreement is {score:.2f})"
    text = f"{said}: {' and '.join(reasons)}{agrees}; set {' and '.join(settings)}"
    kind = "truth_quaternion_order" if order == "wxyz" else "truth_up"
    make = error if is_certain else warning
    return make(kind, Stage.GROUND_TRUTH, "ground_truth", text, *settings, is_certain=is_certain)


def _unrelated(turns: _Turns) -> Iterator[Finding]:
    if np.sqrt(np.mean(turns.vertical**2)) > 3.0 * _LEAST_TURN_RAD:
        yield warning(
            "truth_unrelated",
            Stage.GROUND_TRUTH,
            "ground_truth",
            f"rotations of ground truth and gyroscope do not go together at any delay (correlation "
            f"{turns.correlation:.2f}, 1 expected): another run or another body; leave it out by {_NOT_READ}",
            _NOT_READ,
        )


def _tilt(rotations: Array, axis: str, up_body: Array) -> float:
    """Median angle between a world axis seen in the body and the upward direction, rad."""
    seen = np.einsum("nji,j->ni", rotations, np.array(_AXES[axis], dtype=np.float64))
    return float(np.median(np.arccos(np.clip((seen * up_body).sum(axis=1), -1.0, 1.0))))


def _agreement(theirs: Array, ours: Array) -> float:
    """Agreement in sign and size: 1 where equal, 0 where unrelated, -1 where opposite; with or without their means.

    A gyroscope's bias is in its mean, and so is a steady turn.
    """
    pairs = (theirs, ours), (theirs - theirs.mean(), ours - ours.mean())
    found = [float(2.0 * (a @ b) / max(float(a @ a + b @ b), 1e-12)) for a, b in pairs]
    return max(found, key=abs)


def _without_bias(rate: Array) -> Array:
    """Angular rates without their median, (N, 3), where it may be a bias."""
    median = np.median(rate, axis=0)
    return np.asarray(rate - np.where(np.abs(median) < _LARGEST_BIAS_RADPS, median, 0.0))


def _gyroscope_turns(evidence: Evidence) -> Array | None:
    """Sizes of rotations over half a second by the gyroscope without its mean, rad, (N,)."""
    imu = evidence.imu
    if imu is None or len(imu.stamps_ns) < _LEAST_SPANS:
        return None
    s = seconds_of(imu.stamps_ns, int(imu.stamps_ns[0]))
    at = np.arange(0.0, s[-1], _STEP_S)
    if len(at) < _LEAST_SPANS:
        return None
    total = integral(s, _without_bias(imu.rate))
    angle = np.stack([np.interp(at, s, column) for column in total.T], axis=1)
    return np.asarray(np.linalg.norm(angle[_SPAN_STEPS:] - angle[:-_SPAN_STEPS], axis=1))


def _turns(evidence: Evidence, trajectory: Trajectory) -> _Turns | None:
    """Both rotations over the same half seconds, after the clocks were brought together; None where too short."""
    imu = evidence.imu
    sizes = _gyroscope_turns(evidence)
    duration_s = min(trajectory.duration_s, evidence.seconds)
    if imu is None or sizes is None or duration_s < _LEAST_SPANS * _STEP_S:
        return None
    first_ns = int(imu.stamps_ns[0])
    s = seconds_of(imu.stamps_ns, first_ns)
    own = np.arange(0.0, duration_s, _STEP_S)
    stamps = trajectory.stamps_ns[0] + np.round(own * 1e9).astype(np.int64)
    stamps = stamps[stamps <= trajectory.stamps_ns[-1]]
    rotations = trajectory.interpolated(stamps).rotations
    start, middle, end = (
        rotations[:-_SPAN_STEPS],
        rotations[_SPAN_STEPS // 2 : -(_SPAN_STEPS - _SPAN_STEPS // 2)],
        (rotations[_SPAN_STEPS:]),
    )
    world = so3.log(end @ np.swapaxes(start, 1, 2))
    lag, correlation = _lag(np.linalg.norm(world, axis=1), sizes)
    at = own[: len(world)] + lag * _STEP_S  # in seconds of the IMU
    inside = (at >= 0.0) & (at + _SPAN_STEPS * _STEP_S <= s[-1])
    if inside.sum() < _LEAST_SPANS:
        return None
    at, world, middle = at[inside], world[inside], middle[inside]
    R = rotation_body_imu(evidence)
    rate = integral(s, _without_bias(imu.rate) @ R.T)
    force = integral(s, imu.force @ R.T)
    turned, push = (_difference(at, at + _SPAN_STEPS * _STEP_S, s, each) for each in (rate, force))
    up = push / np.maximum(np.linalg.norm(push, axis=1, keepdims=True), 1e-9)
    scale = float(np.linalg.norm(world)) / max(float(np.linalg.norm(turned)), 1e-9)
    return _Turns(middle, world, (turned * up).sum(axis=1), up, scale, correlation)


def _difference(start: Array, end: Array, s: Array, total: Array) -> Array:
    return np.stack([np.interp(end, s, column) - np.interp(start, s, column) for column in total.T], axis=1)


def _lag(theirs: Array, ours: Array) -> tuple[int, float]:
    """By how many steps the second series is ahead of the first, and their correlation then."""
    a, b = theirs - theirs.mean(), ours - ours.mean()
    length = len(a) + len(b)
    product = np.fft.irfft(np.fft.rfft(b, length) * np.conj(np.fft.rfft(a, length)), length)
    lags = np.concatenate((np.arange(len(b)), np.arange(-len(a), 0)))
    best, score = 0, -1.0
    for index in np.argsort(product)[::-1][:20]:
        lag = int(lags[index]) if index < len(lags) else 0
        low, high = max(0, -lag), min(len(a), len(b) - lag)
        if high - low >= min(_LEAST_SPANS, len(a)):
            one, other = theirs[low:high], ours[low + lag : high + lag]
            spread = float(one.std() * other.std())
            found = float(((one - one.mean()) * (other - other.mean())).mean()) / max(spread, 1e-12)
            if found > score:
                best, score = lag, found
    return best, score

# SPDX-License-Identifier: BSD-3-Clause
"""Order and signs of the joints against the ground: feet that stand do not move relative to each other.

For two standing feet with positions p and velocities v relative to the body, which turns at w (body axes),
``v_i - v_j + w x (p_i - p_j) = 0``; and whatever w is, their distance is constant, ``(p_i - p_j) . (v_i - v_j) = 0``.
Both residuals are divided by the speeds of the two feet. In every gait pairs of feet stand together for some share of
the time, so that a low quantile over all pairs of a leg is small where kinematics and readings agree, whatever the
contact estimate says. Where it is not, other orders and signs are tried; one that makes it clearly smaller is named.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from coclo_vio.diagnosis.checks.joint_positions import is_in_degrees, joints_beyond
from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.finding import Finding, Stage, error, warning
from coclo_vio.diagnosis.joint_arrangements import Arrangement, alternatives
from coclo_vio.diagnosis.joint_series import LegMotion, are_cycling, feet_of, leg_motion
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.errors import listing

_SAMPLES = 400
_QUANTILE = 0.15
_SUSPICIOUS = (0.14, 0.035)  # of a leg's residuals with the gyroscope, of distances; sound walks: below 0.1, 0.03
_UNEVEN = 2.0  # times the least residual of a leg
_COARSE = 3  # every so many samples are used for the first choice among all alternatives
_REFINED = 6  # of them are compared by all samples
_UNKNOWN = 0.01  # for legs of which nothing is known
_GOOD = 0.25  # of all legs, after a change that explains them
_GOOD_ALONE = 0.1  # of some legs
_LIKE_OTHERS = 2.0  # ... or as good as that of the others
_ODD = 3.0  # times the others' residual: a leg that no change explains
_GAIN = 1.8
_HINTING_GAIN = 1.4  # sound walks stay below 1.1
_GAIN_ALONE = 3.0  # without a gyroscope
_CONFIRMING_GAIN = 1.25
_MOST_FAULTS = 4
_BETTER = 0.9


@dataclass(frozen=True, slots=True, eq=False)
class _Residuals:
    """By leg, low quantiles of the residuals: with the gyroscope and by distances alone, each (n,)."""

    by_gyroscope: Array | None
    by_distance: Array

    @property
    def chief(self) -> Array:
        """The one with more power that there is."""
        return self.by_distance if self.by_gyroscope is None else self.by_gyroscope


def find(evidence: Evidence) -> Iterator[Finding]:
    """An order or signs of the joints that contradict standing feet, with the cure."""
    robot, joints = evidence.robot, evidence.joints
    if robot is None or joints is None or len(robot.leg_names) < 2 or is_in_degrees(joints, robot):
        return
    motion = known_motion(evidence, robot, _SAMPLES)
    if motion is None:
        return
    start = _residuals(robot, motion)
    limit = _SUSPICIOUS[1 if start.by_gyroscope is None else 0]
    is_uneven = start.chief.max() > _UNEVEN * np.median(start.chief)
    if start.chief.max() < limit and start.by_distance.max() < _SUSPICIOUS[1] and not is_uneven:
        return
    found, now, rival = Arrangement.as_recorded(robot), start, None
    for number in range(_MOST_FAULTS):
        step = _best_step(robot, motion, found, now, _GAIN if number else _HINTING_GAIN)
        if step is None:
            break
        found, now, rival = step
    if found.is_as_recorded:
        yield from _odd_legs(robot, start)
    else:
        yield _finding(robot, found, start, now, rival, steps=are_cycling(evidence))


def _odd_legs(robot: RobotModel, start: _Residuals) -> Iterator[Finding]:
    usual = float(np.median(start.chief))
    odd = np.flatnonzero((start.chief > _ODD * usual) & (start.chief > _SUSPICIOUS[0]))
    if len(odd) and len(odd) < 0.5 * len(start.chief):
        yield warning(
            "joint_leg",
            Stage.JOINTS,
            "joints",
            "standing feet move relative to each other: the residual at "
            f"{listing(robot.leg_names[leg] for leg in odd)} is {start.chief[odd].max():.2f} of the feet's speed, at "
            f"the other legs {usual:.2f}: an encoder's zero, a link of the URDF or the order of this leg's joints is "
            "wrong; correct it, or leave its joints out (dataset.corrections.joints.left_out)",
        )


def keeps_distances(evidence: Evidence) -> bool:
    """Whether standing feet keep their distances, so that order and signs of the joints may be right."""
    robot, joints = evidence.robot, evidence.joints
    if robot is None or joints is None or len(robot.leg_names) < 2:
        return True
    motion = known_motion(evidence, robot, _SAMPLES // _COARSE)
    if motion is None:
        return True
    return bool(_residuals(robot, motion).by_distance.max() < 2.0 * _SUSPICIOUS[1])


def gyroscope_fits(evidence: Evidence) -> bool | None:
    """Whether standing feet agree with the gyroscope better than with its opposite; None where that is not known."""
    robot = evidence.robot
    motion = None if robot is None else known_motion(evidence, robot, _SAMPLES // _COARSE)
    if robot is None or motion is None or motion.body_rate is None:
        return None
    opposite = LegMotion(motion.stamps_ns, motion.position, motion.rate, -motion.body_rate)
    ours, theirs = (float(np.log(_residuals(robot, each).chief).mean()) for each in (motion, opposite))
    return bool(ours < theirs + np.log(_BETTER))


def known_motion(evidence: Evidence, robot: RobotModel, most: int) -> LegMotion | None:
    """The legs in motion, those with an unknown joint all NaN; None where fewer than two are known."""
    motion = leg_motion(evidence, most)
    if motion is None:
        return None
    is_known = np.isfinite(motion.rate).mean(axis=0) > 0.9
    legs = [inside for inside in robot.leg_joint_slices if is_known[inside].all()]
    if len(legs) < 2:
        return None
    whole = np.concatenate([np.arange(inside.start, inside.stop) for inside in legs])
    rows = np.isfinite(motion.rate[:, whole]).all(axis=1)
    masked = np.full((2, int(rows.sum()), motion.rate.shape[1]), np.nan)
    masked[:, :, whole] = motion.position[rows][:, whole], motion.rate[rows][:, whole]
    body_rate = None if motion.body_rate is None else motion.body_rate[rows]
    return LegMotion(motion.stamps_ns[rows], masked[0], masked[1], body_rate)


def _best_step(
    robot: RobotModel, motion: LegMotion, base: Arrangement, now: _Residuals, least_gain: float
) -> tuple[Arrangement, _Residuals, Arrangement | None] | None:
    """The change that explains the feet best, if clearly better than none; with another that is nearly as good."""
    few = motion.every(_COARSE)
    is_known = np.isfinite(motion.rate[0])
    most = joints_beyond(motion.position[:, base.source] * base.sign, robot)
    possible = [
        each
        for each in alternatives(robot)
        if np.array_equal(is_known[each.source], is_known)
        and joints_beyond(few.position[:, base.followed_by(each).source] * base.followed_by(each).sign, robot) <= most
    ]
    if len(possible) < 2:
        return None
    changes = sorted(possible, key=lambda change: _level(_of(robot, few, base.followed_by(change))))
    refined = [(change, _of(robot, motion, base.followed_by(change))) for change in changes[:_REFINED]]
    (change, residuals), (second, its_residuals), *_ = sorted(refined, key=lambda each: _level(each[1]))
    legs = change.changed_legs(robot)
    if _gain(now.chief[legs], residuals.chief[legs]) < least_gain:
        return None
    others = np.delete(residuals.chief, legs)
    good = max(_GOOD_ALONE, _LIKE_OTHERS * float(np.median(others))) if len(others) else _GOOD
    if np.median(residuals.chief[legs]) > good:
        return None
    if _gain(now.by_distance[legs], residuals.by_distance[legs]) < 0.85:
        return None  # the gyroscope fits better, but the feet do not keep their distances: it is the gyroscope
    is_near = _gain(its_residuals.chief[legs], residuals.chief[legs]) < _CONFIRMING_GAIN
    return base.followed_by(change), residuals, base.followed_by(second) if is_near else None


def _gain(before: Array, after: Array) -> float:
    return float(np.exp(np.mean(np.log(before / after))))


def _level(residuals: _Residuals) -> float:
    return float(np.log(residuals.chief).mean())


def _of(robot: RobotModel, motion: LegMotion, arrangement: Arrangement) -> _Residuals:
    position, rate = (each[:, arrangement.source] * arrangement.sign for each in (motion.position, motion.rate))
    return _residuals(robot, LegMotion(motion.stamps_ns, position, rate, motion.body_rate))


def pair_residuals(robot: RobotModel, motion: LegMotion) -> tuple[IntArray, Array | None, Array]:
    """Pairs of legs (M, 2), and their residuals over the feet's speeds, with the gyroscope and of distances, (N, M)."""
    places, velocities = feet_of(robot, motion.position, motion.rate)
    pairs = np.array(list(combinations(range(len(robot.leg_names)), 2)))
    apart, change = (each[:, pairs[:, 0]] - each[:, pairs[:, 1]] for each in (places, velocities))
    speeds = np.linalg.norm(velocities, axis=2)
    speed = np.maximum(speeds[:, pairs[:, 0]] + speeds[:, pairs[:, 1]], 1e-3)
    distance_m = np.maximum(np.linalg.norm(apart, axis=2), 1e-3)
    by_distance = np.abs((apart * change).sum(axis=2)) / distance_m / speed
    if motion.body_rate is None:
        return pairs, None, by_distance
    turned = change + np.cross(motion.body_rate[:, None], apart)
    return pairs, np.linalg.norm(turned, axis=2) / speed, by_distance


def _residuals(robot: RobotModel, motion: LegMotion) -> _Residuals:
    pairs, by_gyroscope, by_distance = pair_residuals(robot, motion)
    legs = range(len(robot.leg_names))

    def of_legs(residual: Array) -> Array:
        known = np.isfinite(residual).all(axis=0)
        mine = [residual[:, known & (pairs == leg).any(axis=1)] for leg in legs]
        return np.array([max(float(np.quantile(each, _QUANTILE)), 1e-6) if each.size else _UNKNOWN for each in mine])

    return _Residuals(None if by_gyroscope is None else of_legs(by_gyroscope), of_legs(by_distance))


def _finding(
    robot: RobotModel,
    found: Arrangement,
    start: _Residuals,
    now: _Residuals,
    rival: Arrangement | None,
    *,
    steps: bool,
) -> Finding:
    legs = found.changed_legs(robot)
    before, after = float(np.median(start.chief[legs])), float(np.median(now.chief[legs]))
    is_confirmed = _gain(start.by_distance[legs], now.by_distance[legs]) > _CONFIRMING_GAIN
    is_confirmed &= _gain(start.chief[legs], now.chief[legs]) > _GAIN
    settings = found.settings(robot)
    has_gyroscope = start.by_gyroscope is not None
    if not has_gyroscope:
        is_confirmed = before > _GAIN_ALONE * after
    gyroscope = "the axes of the gyroscope are wrong, which the feet's distances cannot exclude"
    kinematics = "the robot is another one, which distances of feet alone cannot exclude"
    doubt = "" if is_confirmed else f"; or {gyroscope if has_gyroscope else kinematics}"
    other = "" if rival is None else f"; nearly as good would be {' and '.join(rival.settings(robot))}"
    is_confirmed &= steps  # feet that slide as the robot stands up are no proof
    report = error if is_confirmed else warning
    return report(
        "joint_order",
        Stage.JOINTS,
        "joints",
        "standing feet move relative to each other: the residual at "
        f"{listing(robot.leg_names[leg] for leg in legs)} "
        f"is {before:.2f} of the feet's speed and falls to {after:.2f} with {found.described(robot)}; set "
        f"{' and '.join(settings)}{doubt}{other}",
        *settings,
        is_certain=is_confirmed and has_gyroscope and rival is None,
    )

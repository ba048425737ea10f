# SPDX-License-Identifier: BSD-3-Clause
"""Ground truth against what a body on legs can do: lost poses, jumps, unit of length, unit of stamps, standstill."""

from collections.abc import Iterator

import numpy as np

from coclo_vio.datasets.ground_truth import LOST
from coclo_vio.datasets.truth_defects import FASTEST_MPS, is_jump
from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.finding import Finding, Stage, error, warning
from coclo_vio.diagnosis.joint_series import feet_of, seconds_of, thinned
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array
from coclo_vio.values.trajectory import Trajectory
from coclo_vio.values.units import NS_PER_S

_FEW_JUMPS = 0.004  # of the poses, up to which scores are nearly right
_SETTING = "dataset.corrections.ground_truth."
_NOT_READ = f"{_SETTING}is_read=false"
_SPACING_S = 0.5
_LEAST_LEGS_M = 0.3
_FAR_M = 1.0
_LENGTHS = {"cm": 100.0, "mm": 1000.0}
_USUAL_RATIO = 0.5  # of the body's way to that of the feet relative to it: feet go to and fro
_LENGTH_FACTOR = 4.0  # it is known to this factor
_TOO_FAR = 5.0
_STAMP_FACTORS = (1e3, 1e6, 1e9)
_STAMP_TOLERANCE = 1.3
_FROZEN_S = 0.5
_FROZEN_SHARE = 0.02
_FROZEN_STEP_M = 0.02


def find(evidence: Evidence) -> Iterator[Finding]:
    """What no body that walks can do."""
    report = evidence.report
    lost = 0 if report is None else report.dropped.get(LOST, 0)
    if lost:
        yield warning(
            "truth_lost",
            Stage.GROUND_TRUTH,
            "ground_truth",
            f"{lost:,} poses of the ground truth are exactly at the origin, where the tracker lost the body: they "
            "were left out; nothing needs to be set",
        )
    truth = evidence.truth
    if truth is None or len(truth.trajectory) < 3:
        return
    stamps = stamp_unit(evidence) if truth.has_stamps else None
    if stamps is not None:
        yield stamps
        return
    walked = None if evidence.robot is None else _walked(evidence, evidence.robot)
    length = None if walked is None else _length(walked, truth.trajectory, has_stamps=truth.has_stamps)
    if length is not None:
        yield length
    elif truth.has_stamps and evidence.robot is not None:
        yield from _jumps(truth.trajectory)
    if walked is not None and walked[0] > _FAR_M:
        yield from _frozen(walked[0], truth.trajectory, has_stamps=truth.has_stamps)


def stamp_unit(evidence: Evidence) -> Finding | None:
    """Stamps in another unit: the ground truth is some thousand times as long as the recording."""
    truth, report = evidence.truth, evidence.report
    if truth is None or report is None or not report.streams:
        return None
    recorded_s = max(stream.duration_s for stream in report.streams)
    ratio = truth.trajectory.duration_s / max(recorded_s, 1e-9)
    for factor in (*_STAMP_FACTORS, *(1.0 / factor for factor in _STAMP_FACTORS)):
        if recorded_s > 1.0 and 1.0 / _STAMP_TOLERANCE < ratio / factor < _STAMP_TOLERANCE:
            setting = f"{_SETTING}stamp_factor={1.0 / factor:g}"
            return error(
                "truth_stamp_unit",
                Stage.GROUND_TRUTH,
                "ground_truth",
                f"the ground truth lasts {truth.trajectory.duration_s:.4g} s, the recording {recorded_s:.4g} s: its "
                f"stamps are in another unit; set {setting}",
                setting,
                is_certain=True,
            )
    return None


def _length(walked: tuple[float, int, int], trajectory: Trajectory, *, has_stamps: bool) -> Finding | None:
    """Positions in another unit: far longer a way than the feet's motion allows."""
    if walked[0] < _LEAST_LEGS_M or not has_stamps:  # without stamps it may be longer than what is looked at
        return None
    legs_m, first_ns, last_ns = walked
    legs_mps, during = legs_m / max((last_ns - first_ns) / NS_PER_S, 1e-9), trajectory
    inside = (trajectory.stamps_ns >= first_ns) & (trajectory.stamps_ns <= last_ns)
    during = trajectory.select(inside) if inside.sum() > 10 else trajectory
    ratio = _way_m(during) / max(during.duration_s, 1e-9) / legs_mps
    if ratio < _TOO_FAR:
        return None
    said = (
        f"the ground truth moves {_way_m(during):.4g} m, about {ratio:.2g} times as far as the feet of the robot do "
        "relative to its body"
    )
    off = {unit: abs(float(np.log(ratio / (_USUAL_RATIO * factor)))) for unit, factor in _LENGTHS.items()}
    unit = min(off, key=lambda each: off[each])
    if off[unit] < np.log(_LENGTH_FACTOR):
        setting = f"{_SETTING}length_unit={unit}"
        text = f"{said}: its positions are in {unit}; set {setting}"
        return error("truth_length_unit", Stage.GROUND_TRUTH, "ground_truth", text, setting, is_certain=True)
    text = f"{said}: another unit, or not this body; correct its unit, or leave it out by {_NOT_READ}"
    return error("truth_length", Stage.GROUND_TRUTH, "ground_truth", text, _NOT_READ)


def _walked(evidence: Evidence, robot: RobotModel) -> tuple[float, int, int] | None:
    """The way of the feet relative to the body, mean of all, m, from a first to a last stamp."""
    joints = evidence.joints
    if joints is None or len(joints.stamps_ns) < 10:
        return None
    rows = thinned(joints.stamps_ns, 10.0, 1500)
    rows = rows[np.isfinite(joints.position[rows]).all(axis=1)]
    if len(rows) < 10:
        return None
    places, _ = feet_of(robot, joints.position[rows], np.zeros_like(joints.position[rows]))
    way_m = np.linalg.norm(np.diff(places, axis=0), axis=2).sum(axis=0).mean()
    return float(way_m), int(joints.stamps_ns[rows[0]]), int(joints.stamps_ns[rows[-1]])


def _way_m(trajectory: Trajectory) -> float:
    """Way of the body, of positions half a second apart, each a median of neighbours, m."""
    rows = thinned(trajectory.stamps_ns, 1.0 / _SPACING_S, len(trajectory))
    smooth = [np.median(trajectory.positions[max(0, row - 2) : row + 3], axis=0) for row in rows.tolist()]
    return float(np.linalg.norm(np.diff(np.array(smooth), axis=0), axis=1).sum())


def _jumps(trajectory: Trajectory) -> Iterator[Finding]:
    jumps = np.flatnonzero(is_jump(trajectory.stamps_ns, trajectory.positions))
    if not len(jumps):
        return
    steps_m = np.linalg.norm(trajectory.positions[jumps + 1] - trajectory.positions[jumps], axis=1)
    worst = int(np.argmax(steps_m))
    at_s = float(seconds_of(trajectory.stamps_ns, int(trajectory.stamps_ns[0]))[jumps[worst]])
    setting = f"{_SETTING}drops_jumps=true"
    make = error if len(jumps) > _FEW_JUMPS * len(trajectory) else warning
    yield make(
        "truth_jumps",
        Stage.GROUND_TRUTH,
        "ground_truth",
        f"the ground truth jumps at {len(jumps)} of {len(trajectory):,} poses, by up to {steps_m[worst]:.3g} m at "
        f"{at_s:.2f} s: a body on legs stays below {FASTEST_MPS:g} m/s; leave these poses out by {setting}",
        setting,
        is_certain=True,
    )


def _frozen(legs_m: float, trajectory: Trajectory, *, has_stamps: bool) -> Iterator[Finding]:
    is_same = (np.diff(trajectory.T_world_body.reshape(len(trajectory), -1), axis=0) == 0.0).all(axis=1)
    if is_same.all():
        yield error(
            "truth_frozen",
            Stage.GROUND_TRUTH,
            "ground_truth",
            f"the ground truth is the same pose {len(trajectory):,} times while the feet move {legs_m:.3g} m: it is "
            f"not this robot's; leave it out by {_NOT_READ}",
            _NOT_READ,
            is_certain=True,
        )
        return
    frozen_s = _repeated_s(trajectory, is_same)
    if has_stamps and frozen_s > max(_FROZEN_SHARE * trajectory.duration_s, 2.0 * _FROZEN_S):
        yield warning(
            "truth_repeats",
            Stage.GROUND_TRUTH,
            "ground_truth",
            f"the ground truth repeats a pose exactly for {frozen_s:.1f} s in all (stretches of over {_FROZEN_S} s): "
            "the tracker does not see the body then; scores of this time are wrong",
        )


def _repeated_s(trajectory: Trajectory, is_same: Array) -> float:
    """Time in stretches of over half a second of one pose, after which the body is elsewhere, s."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], is_same, [False])).astype(np.int8))).reshape(-1, 2)
    edges = edges[edges[:, 1] < len(trajectory) - 1]
    spans_s = (trajectory.stamps_ns[edges[:, 1]] - trajectory.stamps_ns[edges[:, 0]]) / NS_PER_S
    step_m = np.linalg.norm(trajectory.positions[edges[:, 1] + 1] - trajectory.positions[edges[:, 1]], axis=1)
    return float(spans_s[(spans_s > _FROZEN_S) & (step_m > _FROZEN_STEP_M)].sum())

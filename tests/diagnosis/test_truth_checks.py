# SPDX-License-Identifier: BSD-3-Clause
"""Ground truth that cannot be meant so: each kind of defect is found with its cure, and the cure ends it."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from altered_walks import Walk

from coclo_vio.datasets.corrections import upright
from coclo_vio.diagnosis.finding import Stage
from coclo_vio.geometry import se3, so3
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.trajectory import GroundTruth

_SETTING = "dataset.corrections.ground_truth."
Change = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]


def _turned(turn: np.ndarray) -> Change:
    """Another world, (3, 3)."""
    return lambda stamps, R, p: (stamps, turn @ R, p @ turn.T)


def _jumping(stamps, R, p):
    moved = p.copy()
    moved[[50, 51, 300, 420]] += [2.0, -1.0, 0.5]
    return stamps, R, moved


def _hidden(stamps, R, p):
    """A tracker that repeats its last pose while it does not see the body."""
    R, p = R.copy(), p.copy()
    R[200:300], p[200:300] = R[199], p[199]
    return stamps, R, p


_MIRROR = np.diag([1.0, -1.0, 1.0])

# change of stamps, rotations and positions; kind; whether scores are wrong; certain settings
_DEFECTS: dict[str, tuple[Change, str, bool, tuple[str, ...]]] = {
    "w x y z": (
        lambda s, R, p: (s, so3.from_quat_xyzw(np.roll(so3.to_quat_xyzw(R), 1, axis=1)), p),
        "truth_quaternion_order",
        True,
        ("quaternion=wxyz",),
    ),
    "y up": (_turned(upright("y").T), "truth_up", True, ("up=y",)),
    "z down": (_turned(upright("-z").T), "truth_up", True, ("up=-z",)),
    "millimetres": (lambda s, R, p: (s, R, 1000.0 * p), "truth_length_unit", True, ("length_unit=mm",)),
    "centimetres": (lambda s, R, p: (s, R, 100.0 * p), "truth_length_unit", True, ("length_unit=cm",)),
    "milliseconds": (lambda s, R, p: (1000 * (s - s[0]), R, p), "truth_stamp_unit", True, ("stamp_factor=0.001",)),
    "jumps": (_jumping, "truth_jumps", True, ("drops_jumps=true",)),
    "left-handed": (
        lambda s, R, p: (s, _MIRROR @ R @ _MIRROR, p @ _MIRROR),
        "truth_handedness",
        True,
        ("is_read=false",),
    ),
    "inverse": (lambda s, R, p: (s, np.swapaxes(R, 1, 2), p), "truth_handedness", True, ("is_read=false",)),
    "one pose": (
        lambda s, R, p: (s, np.tile(R[:1], (len(R), 1, 1)), np.tile(p[:1], (len(p), 1))),
        "truth_frozen",
        True,
        ("is_read=false",),
    ),
    "positions only": (
        lambda s, R, p: (s, np.tile(np.eye(3), (len(R), 1, 1)), p),
        "truth_rotation_constant",
        False,
        (),
    ),
    "repeated poses": (_hidden, "truth_repeats", False, ()),
    "a tracked frame that is turned": (
        lambda s, R, p: (s, R @ so3.exp(np.array([1.5, 0.0, 0.0])), p),
        "truth_upright",
        False,
        (),
    ),
}


@pytest.fixture(scope="module")
def turning_walk() -> Walk:
    """A Go1 that walks in a narrow circle."""
    robot = load_robot("go1")
    body = BodyMotionConfig(rest_s=1.0, walk_s=10.0, stop_s=0.5, ramp_s=0.5, curvature_per_m=1.5)
    trial = generate(AnalyticTrialConfig(body=body, rate_hz=50.0), RobotModel(robot), seed=5)
    return Walk(robot, trial.measurements, GroundTruth(trial.truth, True, "truth"))


def _altered(walk: Walk, change: Change) -> Walk:
    truth = walk.truth.trajectory
    stamps, rotations, positions = change(truth.stamps_ns, truth.rotations, truth.positions)
    return walk.with_truth(stamps, se3.transform(rotations, positions))


def _of_truth(walk: Walk, path: Path, settings: tuple[str, ...] = ()) -> list:
    return [finding for finding in walk.findings(path, settings) if finding.stage is Stage.GROUND_TRUTH]


@pytest.mark.long
@pytest.mark.parametrize("name", _DEFECTS)
def test_a_defect_of_the_ground_truth_is_found_and_cured(turning_walk: Walk, tmp_path: Path, name: str) -> None:
    change, kind, is_wrong, settings = _DEFECTS[name]
    settings = tuple(_SETTING + setting for setting in settings)
    altered = _altered(turning_walk, change)
    path = altered.written(tmp_path)
    found = _of_truth(altered, path)
    assert kind in {finding.kind for finding in found}
    chief = next(finding for finding in found if finding.kind == kind)
    assert chief.is_error == is_wrong
    if settings:
        assert chief.remedy == settings
        assert chief.is_certain
        assert _of_truth(altered, path, settings) == []


@pytest.mark.parametrize("name", ["w x y z", "millimetres"])
def test_the_same_is_found_in_a_bag_of_a_straight_walk(walk: Walk, tmp_path: Path, name: str) -> None:
    change, kind, _, settings = _DEFECTS[name]
    altered = _altered(walk, change)
    path = altered.written(tmp_path, as_bag=True)
    (found,) = _of_truth(altered, path)
    assert found.kind == kind
    assert found.is_certain
    assert _of_truth(altered, path, tuple(_SETTING + setting for setting in settings)) == []


def test_poses_of_a_lost_body_are_left_out_and_counted(walk: Walk, tmp_path: Path) -> None:
    def lost(stamps, R, p):
        zeros, places = R.copy(), p.copy()
        zeros[100:140], places[100:140] = np.eye(3), 0.0
        return stamps, zeros, places

    altered = _altered(walk, lost)
    for as_bag in (False, True):
        (found,) = _of_truth(altered, altered.written(tmp_path / str(as_bag), as_bag=as_bag))
        assert found.kind == "truth_lost"
        assert not found.is_error
        assert "40 poses" in found.sentence


def test_a_clock_of_its_own_is_no_defect(walk: Walk, tmp_path: Path) -> None:
    altered = _altered(walk, lambda stamps, R, p: (stamps + 86_400_000_000_000, R, p))
    assert _of_truth(altered, altered.written(tmp_path)) == []


def test_a_robot_that_turns_steadily_is_no_defect(turning_walk: Walk, tmp_path: Path) -> None:
    assert turning_walk.findings(turning_walk.written(tmp_path)) == ()

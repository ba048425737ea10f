# SPDX-License-Identifier: BSD-3-Clause
"""Joint readings that cannot be: each kind of defect is found with its cure, and the cure ends it."""

from pathlib import Path

import numpy as np
import pytest
from altered_walks import JointChange, Walk

_POSITION = "dataset.corrections.joints.position_unit="
_VELOCITY = "dataset.corrections.joints.velocity_unit="
_ESTIMATED = "dataset.corrections.joints.velocity=from_position"


def _signed(*joints: int) -> JointChange:
    def change(position, velocity, effort):
        sign = np.ones(position.shape[1])
        sign[list(joints)] = -1.0
        return sign * position, sign * velocity, sign * effort

    return change


def _ordered(order: list[int]) -> JointChange:
    return lambda position, velocity, effort: (position[:, order], velocity[:, order], effort[:, order])


def _stuck(joint: int) -> JointChange:
    def change(position, velocity, effort):
        stuck = position.copy()
        stuck[:, joint] = 0.25
        return stuck, velocity, effort

    return change


def _torque_of_one(joint: int, factor: float) -> JointChange:
    def change(position, velocity, effort):
        changed = effort.copy()
        changed[:, joint] *= factor
        return position, velocity, changed

    return change


_LEFT_RIGHT = [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8, 15, 16, 17, 12, 13, 14]
_OUTSIDE_IN = [joint for leg in range(6) for joint in (3 * leg + 2, 3 * leg + 1, 3 * leg)]

# change, kind, whether a run is refused, settings that are certain
_DEFECTS: dict[str, tuple[JointChange, str, bool, tuple[str, ...]]] = {
    "all in degrees": (
        lambda p, v, t: (np.rad2deg(p), np.rad2deg(v), t),
        "joint_position_unit",
        True,
        (_POSITION + "deg",),
    ),
    "degrees and rpm": (
        lambda p, v, t: (np.rad2deg(p), v * 30.0 / np.pi, t),
        "joint_position_unit",
        True,
        (_POSITION + "deg", _VELOCITY + "rpm"),
    ),
    "angles in degrees only": (
        lambda p, v, t: (np.rad2deg(p), v, t),
        "joint_position_unit",
        True,
        (_POSITION + "deg", _VELOCITY + "rad/s"),
    ),
    "velocities in deg/s": (
        lambda p, v, t: (p, np.rad2deg(v), t),
        "joint_velocity_unit",
        True,
        (_VELOCITY + "deg/s",),
    ),
    "velocities zero": (lambda p, v, t: (p, 0.0 * v, t), "joint_velocity_zero", True, (_ESTIMATED,)),
    "velocities negated": (lambda p, v, t: (p, -v, t), "joint_velocity_sign", True, (_ESTIMATED,)),
    "velocities of other joints": (
        lambda p, v, t: (p, np.roll(v, 1, axis=1), t),
        "joint_velocity_contradicts",
        True,
        (_ESTIMATED,),
    ),
    "velocities late": (lambda p, v, t: (p, np.roll(v, 15, axis=0), t), "joint_velocity_delay", True, (_ESTIMATED,)),
    "angles still": (lambda p, v, t: (np.tile(p[:1], (len(p), 1)), v, t), "joints_still", True, ()),
    "one encoder dead": (_stuck(1), "joint_still", False, ("dataset.corrections.joints.left_out=[leg1_shoulder]",)),
    "sign of one joint": (
        _signed(3),
        "joint_order",
        True,
        ("dataset.corrections.joints.signs={leg2_base: -1}",),
    ),
    "signs of two legs": (
        _signed(3, 15),
        "joint_order",
        True,
        ("dataset.corrections.joints.signs={leg2_base: -1, leg6_base: -1}",),
    ),
    "torques zero": (lambda p, v, t: (p, v, 0.0 * t), "torque_zero", True, ()),
    "torques absent": (lambda p, v, t: (p, v, np.nan * t), "torque_absent", True, ()),
    "torques negated": (
        lambda p, v, t: (p, v, -t),
        "torque_sign",
        True,
        ("dataset.corrections.joints.effort_factor=-1",),
    ),
    "torques in Nmm": (lambda p, v, t: (p, v, 1000.0 * t), "torque_scale", True, ()),
    "one torque dead": (_torque_of_one(1, 0.0), "torque_dead", False, ()),
    "one torque negated": (_torque_of_one(1, -1.0), "torque_leg_sign", False, ()),
}


def test_a_sound_walk_has_no_findings(walk: Walk, go1_walk: Walk, tmp_path: Path) -> None:
    assert walk.findings(walk.written(tmp_path / "daisy")) == ()
    assert walk.findings(walk.written(tmp_path, as_bag=True)) == ()
    assert go1_walk.findings(go1_walk.written(tmp_path / "go1")) == ()


@pytest.mark.long
@pytest.mark.parametrize("name", [name for name in _DEFECTS if name != "sign of one joint"])
def test_a_defect_of_the_joints_is_found_and_cured(walk: Walk, tmp_path: Path, name: str) -> None:
    change, kind, is_refused, settings = _DEFECTS[name]
    altered = walk.with_joints(change)
    path = altered.written(tmp_path)
    found = altered.findings(path)
    assert found[0].kind == kind
    assert found[0].is_error == is_refused
    certain = [setting for finding in found if finding.is_certain for setting in finding.remedy]
    assert tuple(certain) == settings
    if settings:
        assert altered.findings(path, settings) == ()


@pytest.mark.long
@pytest.mark.parametrize("name", ["torques negated", "sign of one joint"])
def test_the_same_is_found_in_a_bag(walk: Walk, tmp_path: Path, name: str) -> None:
    change, kind, is_refused, settings = _DEFECTS[name]
    altered = walk.with_joints(change)
    path = altered.written(tmp_path, as_bag=True)
    found = altered.findings(path)
    assert (found[0].kind, found[0].is_error, found[0].remedy) == (kind, is_refused, settings)
    assert altered.findings(path, settings) == ()


@pytest.mark.long
@pytest.mark.parametrize(
    ("order", "words"),
    [(_LEFT_RIGHT, "leg1 from leg2"), (_OUTSIDE_IN, "leg1_base from leg1_elbow")],
    ids=["left and right legs", "from the foot to the body"],
)
def test_an_order_of_the_joints_that_the_ground_contradicts_is_named(
    walk: Walk, tmp_path: Path, order: list[int], words: str
) -> None:
    altered = walk.with_joints(_ordered(order))
    path = altered.written(tmp_path)
    found = next(finding for finding in altered.findings(path) if finding.kind == "joint_order")
    assert found.is_error
    assert found.is_certain
    assert words in found.sentence
    assert altered.findings(path, found.remedy) == ()


def test_a_wrong_gyroscope_is_not_taken_for_wrong_joints(walk: Walk, tmp_path: Path) -> None:
    path = walk.written(tmp_path)
    for axes in ("x -y -z", "-x -y z"):
        found = walk.findings(path, [f"dataset.corrections.imu.axes={axes}"])
        assert "joint_order" not in {finding.kind for finding in found}
    found = walk.findings(path, ["dataset.corrections.imu.rate_unit=deg/s"])
    assert "joint_order" not in {finding.kind for finding in found}


def test_angles_beyond_the_limits_name_the_joint_and_its_limits(walk: Walk, tmp_path: Path) -> None:
    def shifted(position, velocity, effort):
        return position + np.eye(18)[4] * 2.4, velocity, effort

    altered = walk.with_joints(shifted)
    found = next(f for f in altered.findings(altered.written(tmp_path)) if f.kind == "joint_position_limits")
    assert "leg2_shoulder" in found.sentence
    assert "-1.57 and 1.57" in found.sentence


def test_a_wrong_zero_of_an_encoder_is_not_taken_for_a_wrong_order(walk: Walk, tmp_path: Path) -> None:
    def shifted(position, velocity, effort):
        return position + np.eye(18)[3] * 1.0, velocity, effort

    altered = walk.with_joints(shifted)
    found = {finding.kind: finding for finding in altered.findings(altered.written(tmp_path))}
    assert "joint_order" not in found
    assert not found["joint_leg"].is_error
    assert "leg2" in found["joint_leg"].sentence


def test_whole_turns_are_no_defect(walk: Walk, tmp_path: Path) -> None:
    altered = walk.with_joints(lambda p, v, t: (p + 2.0 * np.pi, v, t))
    assert altered.findings(altered.written(tmp_path)) == ()


_FORCES = {
    "negated": (lambda f: -f, "contact_never", ("dataset.corrections.foot_force.factor=-1",)),
    "in newton": (lambda f: 0.05 * f, "contact_never", ()),
    "with an offset": (lambda f: f + 1000.0, "contact_always", ()),
    "zero": (lambda f: 0.0 * f, "contact_force_constant", ()),
    "one dead": (lambda f: f * np.array([1.0, 0.0, 1.0, 1.0]), "contact_force_constant", ()),
    "one weak": (lambda f: f * np.array([1.0, 0.05, 1.0, 1.0]), "contact_foot_never", ()),
    "one with an offset": (lambda f: f + np.array([0.0, 500.0, 0.0, 0.0]), "contact_foot_always", ()),
    "absent": (lambda f: np.nan * f, "contact_force_absent", ()),
}


@pytest.mark.long
@pytest.mark.parametrize("name", _FORCES)
def test_feet_that_cannot_stand_or_always_do_are_found(go1_walk: Walk, tmp_path: Path, name: str) -> None:
    change, kind, settings = _FORCES[name]
    altered = go1_walk.with_forces(change)
    path = altered.written(tmp_path)
    (found,) = altered.findings(path)
    assert found.kind == kind
    assert found.is_error != name.startswith("one ")
    if settings:
        assert found.remedy == settings
        assert altered.findings(path, settings) == ()
    if "contact.on_force" in " ".join(found.remedy):
        on, off = (float(setting.partition("=")[2]) for setting in found.remedy)
        contact = go1_walk.robot.contact.model_copy(update={"on_force": on, "off_force": off})
        cured = Walk(go1_walk.robot.model_copy(update={"contact": contact}), altered.samples, altered.truth)
        assert cured.findings(path) == ()


def test_forces_of_other_feet_are_put_in_order(go1_walk: Walk, tmp_path: Path) -> None:
    altered = go1_walk.with_forces(lambda f: f[[1, 0, 2, 3]])
    path = altered.written(tmp_path)
    (found,) = altered.findings(path)
    assert found.kind == "contact_order"
    assert found.is_error
    cured = altered.findings(path, found.remedy)
    assert found.is_certain
    assert cured == ()


def test_forces_in_a_bag_are_checked_too(go1_walk: Walk, tmp_path: Path) -> None:
    altered = go1_walk.with_forces(lambda f: -f)
    (found,) = altered.findings(altered.written(tmp_path, as_bag=True))
    assert found.kind == "contact_never"

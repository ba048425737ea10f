# SPDX-License-Identifier: BSD-3-Clause
"""Names of logs against those of a URDF: equal, differing in case and affixes, abbreviated, numbered."""

from itertools import product

import pytest

from coclo_vio.adoption.name_matching import leg_of_name, legs_in_order, match_names
from coclo_vio.robot.description import load_robot, urdf_path
from coclo_vio.robot.leg_search import FoundLeg, find_legs
from coclo_vio.robot.urdf_tree import read_urdf_tree


def legs_of(name: str) -> tuple[FoundLeg, ...]:
    return find_legs(read_urdf_tree(urdf_path(load_robot(name)))).legs


def biped() -> tuple[FoundLeg, ...]:
    joints = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
    return tuple(
        FoundLeg(side, tuple(f"{side}_{joint}_joint" for joint in joints), side, "flat", 0.0, (0, 0, 0), "")
        for side in ("left", "right")
    )


def combined(legs: tuple[str, ...], joints: tuple[str, ...], pattern: str = "{leg}_{joint}") -> list[str]:
    return [pattern.format(leg=leg, joint=joint) for leg, joint in product(legs, joints)]


@pytest.mark.parametrize(
    ("names", "confidence"),
    [
        (combined(("FR", "FL", "RR", "RL"), ("hip_joint", "thigh_joint", "calf_joint")), 1.0),
        (combined(("fr", "fl", "rr", "rl"), ("Hip", "Thigh", "Calf"), "{leg}.{joint}"), 0.97),
        (combined(("rf", "lf", "rh", "lh"), ("hip_joint", "thigh_joint", "calf_joint")), 0.9),
        (combined(("front_right", "front_left", "rear_right", "rear_left"), ("hip", "thigh", "calf")), 0.9),
        (combined(("rf", "lf", "rh", "lh"), ("hip_joint", "upper_leg_joint", "lower_leg_joint")), 0.8),
        (combined(("RF", "LF", "RH", "LH"), ("HAA", "HFE", "KFE")), 0.8),
        (combined(("fr", "fl", "hr", "hl"), ("hx", "hy", "kn"), "{leg}.{joint}"), 0.8),
        (combined(("FR", "FL", "RR", "RL"), ("0", "1", "2")), 0.8),
        (combined(("FR", "FL", "RR", "RL"), ("1", "2", "3"), "{leg}{joint}"), 0.8),
    ],
)
def test_a_go1_is_recognised_under_the_names_of_many_drivers(names, confidence) -> None:
    legs = legs_of("go1")
    matches = match_names(legs, [*reversed(names), "gripper", "neck_yaw"])
    assert [matches[joint].log_name for leg in legs for joint in leg.joints] == names
    assert min(match.confidence for match in matches.values()) == confidence


def test_a_daisy_s_legs_are_numbered() -> None:
    names = combined(tuple("123456"), ("base", "shoulder", "elbow"), "Leg {leg}/{joint}")
    matches = match_names(legs_of("daisy"), names)
    assert [match.log_name for match in matches.values()] == names


def test_a_biped_s_joints_are_matched_by_side_and_words() -> None:
    words = ("HipPitch", "HipRoll", "HipYaw", "Knee", "AnklePitch", "AnkleRoll")
    for names in (combined(("Left", "Right"), words, "{leg}{joint}"), combined(("l", "r"), words)):
        matches = match_names(biped(), names)
        assert [matches[joint].log_name for leg in biped() for joint in leg.joints] == names


@pytest.mark.parametrize(
    "names",
    [
        [f"joint_{number}" for number in range(12)],
        combined(("FR", "FL"), ("0", "1", "2")) * 2,
        combined(("FR", "FL", "RR", "XX"), ("hip", "thigh", "calf")),
    ],
)
def test_a_name_that_can_be_two_joints_or_none_is_matched_to_none(names) -> None:
    legs = legs_of("go1")
    matches = match_names(legs, names)
    assert len(matches) < 12
    assert {match.log_name for match in matches.values()} <= set(names)
    assert len({match.log_name for match in matches.values()}) == len(matches)


def test_the_legs_that_names_state_come_in_order() -> None:
    names = ["FL_0", "FL_1", "Foot_3", "FR_0", "rear_left_hip", "motor", "hind_right"]
    ends = [("front", "left"), ("front", "right"), ("rear", "left"), ("rear", "right")]
    assert legs_in_order(names) == ends
    assert leg_of_name("leg3_elbow") == ("3", "")
    assert leg_of_name("torso") is None

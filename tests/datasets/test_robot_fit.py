# SPDX-License-Identifier: BSD-3-Clause
"""The robot whose joints a recording has, and the error where it is ambiguous."""

from pathlib import Path

import pytest

from coclo_vio.datasets.robot_fit import fit_of
from coclo_vio.robot.description import load_robot
from coclo_vio.values.errors import ConfigError, TopicNotFound

DAISY, GO1 = (load_robot(name).joint_names for name in ("daisy", "go1"))
PATH = Path("walk.bag")


def test_all_joints_of_a_robot_and_some_more_fit_it():
    fit = fit_of([*DAISY, "gripper"])
    assert (fit.fitting, fit.nearest) == (("daisy",), None)
    assert fit.guess("", takes_nearest=False) == "daisy"
    assert fit.foreign_joints("daisy") == ("gripper",)


def test_of_robots_that_share_their_joints_the_name_decides():
    fit = fit_of(GO1)
    assert set(fit.fitting) == {"a1", "b1", "go1", "go2", "laikago"}
    assert fit.guess("trot", takes_nearest=True) is None
    assert fit.guess("go2_07", takes_nearest=False) == "go2"
    assert fit.guess("Trot_Go1_07", takes_nearest=False) == "go1"
    assert fit.guess("cargo100", takes_nearest=False) is None
    error = fit.unknown_robot_error(PATH)
    assert isinstance(error, ConfigError)
    assert "which robot is it?" in str(error)
    assert "walk.bag are those of a1, b1, go1, go2, laikago" in str(error)


def test_a_robot_that_shares_its_joint_names_is_inferred_from_the_path_only():
    anymal = load_robot("anymal_b").joint_names
    assert fit_of(anymal).fitting == ("anymal_b", "anymal_c")
    for names, robot in (("walk", "anymal_b"), ("anymal_c walk", "anymal_c"), ("anymal_b walk", "anymal_b")):
        assert fit_of(anymal).guess(names, takes_nearest=False) == robot
    short_names = fit_of([*load_robot("go1").joint_aliases])
    assert short_names.fitting == ("b1", "go1", "go2", "laikago")
    assert short_names.guess("walk", takes_nearest=False) == "go1"
    assert fit_of(anymal[:-1]).nearest == "anymal_b"


def test_a_robot_whose_joints_are_part_of_another_s_is_not_inferred_from_the_other_s_recording():
    solo, bolt = (load_robot(name).joint_names for name in ("solo12", "bolt"))
    assert set(bolt) < set(solo)
    assert fit_of(bolt).guess("", takes_nearest=False) == "bolt"
    damaged = fit_of(solo[:-1])
    assert (damaged.fitting, damaged.nearest) == ((), "solo12")
    assert damaged.guess("", takes_nearest=False) is None


def test_an_alias_matches_its_joint():
    go1 = load_robot("go1")
    assert fit_of([*go1.joint_aliases]).matched(go1) == go1.joint_names


def test_a_wrong_joint_name_leaves_the_nearest_robot_and_lists_the_other_joints():
    fit = fit_of(["leg3_ellbow" if name == "leg3_elbow" else name for name in DAISY])
    assert (fit.fitting, fit.nearest) == ((), "daisy")
    assert fit.guess("", takes_nearest=False) is None
    assert fit.guess("", takes_nearest=True) == "daisy"
    error = fit.unknown_robot_error(PATH)
    assert isinstance(error, TopicNotFound)
    assert "the joints of daisy except leg3_elbow; its other joints are leg3_ellbow; --allow-partial" in str(error)


@pytest.mark.parametrize("count", [1, 8])
def test_fewer_than_half_of_the_joints_fit_no_robot(count):
    fit = fit_of(DAISY[:count])
    assert fit.nearest is None
    assert fit.guess("daisy", takes_nearest=True) is None
    assert isinstance(fit.unknown_robot_error(PATH), ConfigError)
    assert DAISY[0] in str(fit.unknown_robot_error(PATH))


def test_of_robots_that_fit_equally_none_is_nearest():
    assert fit_of(GO1[:-1]).nearest is None


def test_a_recording_without_joints_has_no_robot():
    error = fit_of(()).unknown_robot_error(PATH)
    assert isinstance(error, TopicNotFound)
    assert "walk.bag has no joint" in str(error)

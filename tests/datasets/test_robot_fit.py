# SPDX-License-Identifier: BSD-3-Clause
"""Whose joints a recording has, and what is said where that is not clear."""

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
    assert fit.strangers("daisy") == ("gripper",)


def test_of_robots_that_share_their_joints_the_name_decides():
    fit = fit_of(GO1)
    assert set(fit.fitting) == {"a1", "go1"}
    assert fit.guess("Trot_Go1_07", takes_nearest=False) == "go1"
    assert fit.guess("cargo100", takes_nearest=False) is None
    said = fit.why_unknown(PATH)
    assert isinstance(said, ConfigError)
    assert "which robot is it?" in str(said)
    assert "walk.bag are those of a1, go1" in str(said)


def test_an_alias_is_the_joint_it_stands_for():
    go1 = load_robot("go1")
    assert fit_of([*go1.joint_aliases]).matched(go1) == go1.joint_names


def test_a_wrong_name_leaves_the_nearest_robot_and_says_what_is_there_instead():
    fit = fit_of(["leg3_ellbow" if name == "leg3_elbow" else name for name in DAISY])
    assert (fit.fitting, fit.nearest) == ((), "daisy")
    assert fit.guess("", takes_nearest=False) is None
    assert fit.guess("", takes_nearest=True) == "daisy"
    said = fit.why_unknown(PATH)
    assert isinstance(said, TopicNotFound)
    assert "the joints of daisy but for leg3_elbow; the others it has are leg3_ellbow; --allow-partial" in str(said)


@pytest.mark.parametrize("count", [1, 8])
def test_fewer_than_half_of_the_joints_are_nobodys(count):
    fit = fit_of(DAISY[:count])
    assert fit.nearest is None
    assert fit.guess("daisy", takes_nearest=True) is None
    assert isinstance(fit.why_unknown(PATH), ConfigError)
    assert DAISY[0] in str(fit.why_unknown(PATH))


def test_robots_that_come_equally_near_are_not_chosen_between():
    assert fit_of(GO1[:-1]).nearest is None


def test_no_joint_at_all_is_the_recordings_fault():
    said = fit_of(()).why_unknown(PATH)
    assert isinstance(said, TopicNotFound)
    assert "walk.bag has no joint" in str(said)

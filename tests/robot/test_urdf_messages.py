# SPDX-License-Identifier: BSD-3-Clause
"""Nothing of the URDF parser reaches the terminal; what it says is in the error."""

import os
from pathlib import Path

import pytest

from coclo_vio.robot.description import LegDescription, RobotDescription
from coclo_vio.robot.model import RobotModel
from coclo_vio.robot.urdf_messages import caught_messages
from coclo_vio.values.errors import RobotModelError

_JOINT = '<joint name="hip" type="{type}"><parent link="root"/><child link="{child}"/></joint>'
_LINKS = '<link name="root"/><link name="shank"/>'


def write(folder: Path, content: str) -> RobotDescription:
    path = folder / "mine.urdf"
    path.write_text(f'<robot name="mine">{content}</robot>', encoding="utf-8")
    leg = LegDescription(name="leg", joints=("hip",), foot_frame="shank")
    return RobotDescription(name="mine", urdf=str(path), legs=(leg,))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (_LINKS + _JOINT.format(type="revolute", child="shank"), r"Joint \[hip\] is of type REVOLUTE but .* limits"),
        (_LINKS + _JOINT.format(type="continuous", child="foot"), r"child link \[foot\] of joint \[hip\] not found"),
        (_LINKS + '<link name="root"/>' + _JOINT.format(type="continuous", child="shank"), r"'root' is not unique"),
    ],
)
def test_the_error_says_what_the_parser_found_and_the_terminal_stays_empty(content, message, tmp_path, capfd) -> None:
    with pytest.raises(RobotModelError, match=rf"mine\.urdf is not a URDF that can be read: .*{message}.*; correct"):
        RobotModel(write(tmp_path, content))
    assert capfd.readouterr().err == ""


def test_what_the_parser_ignores_is_logged_in_one_line(tmp_path, capfd, caplog) -> None:
    bad = (
        '<link name="root"><collision><geometry><sphere radius="r"/></geometry></collision></link><link name="shank"/>'
    )
    RobotModel(write(tmp_path, bad + _JOINT.format(type="continuous", child="shank")))
    assert "parts of" in caplog.text
    assert "radius [r] is not a valid float" in caplog.text
    assert "mine.urdf" in caplog.text
    assert capfd.readouterr().err == ""


def test_other_output_is_written_once_the_context_is_left(capfd) -> None:
    with caught_messages() as messages:
        os.write(2, b"of another thread\nError:   joint [a] is\n         at line 6 in /somewhere/joint.cpp\nand more\n")
        assert capfd.readouterr().err == ""
    assert messages == ["joint [a] is"]
    assert capfd.readouterr().err == "of another thread\nand more\n"


def test_the_terminal_is_back_after_an_exception(capfd) -> None:
    with pytest.raises(KeyError), caught_messages():
        raise KeyError
    os.write(2, b"here")
    assert capfd.readouterr().err == "here"

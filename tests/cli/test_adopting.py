# SPDX-License-Identifier: BSD-3-Clause
"""``adopt`` from the command line and from Python: what is written, printed, and asked back."""

from importlib import resources
from pathlib import Path

import pytest
from console import Coclo, is_one_sentence

import coclo_vio as cv

_DAISY = Path(str(resources.files("coclo_vio.robot") / "presets" / "daisy.urdf"))


def test_the_description_is_written_and_runs(coclo: Coclo, leg_log: Path, tmp_path: Path) -> None:
    answer = coclo("adopt", _DAISY, leg_log, "-o", "my_daisy.yaml")
    assert answer.status == 0, answer.err
    assert "my_daisy.yaml written" in answer.out
    assert f"coclo-vio run {leg_log} --robot my_daisy.yaml" in answer.out
    text = (tmp_path / "my_daisy.yaml").read_text("utf-8")
    assert "# ? imu.position_body_m = 0, 0, 0" in text
    robot = cv.load_robot(tmp_path / "my_daisy.yaml")
    assert {leg.joints for leg in robot.legs} == {leg.joints for leg in cv.load_robot("daisy").legs}
    assert coclo("run", leg_log, "-m", "naive", "--robot", "my_daisy.yaml").status == 0


def test_python_gives_the_same_with_the_fields(leg_log: Path, tmp_path: Path) -> None:
    adoption = cv.adopt(_DAISY, leg_log, tmp_path / "robot.yaml")
    assert cv.load_robot(tmp_path / "robot.yaml").legs == adoption.description.legs
    assert adoption.confidence("joints") == 1.0
    assert adoption.confidence("no such field") == 0.0
    assert all(0.0 <= field.confidence <= 1.0 for field in adoption.fields)


@pytest.mark.parametrize(
    ("urdf", "log", "words"),
    [
        ("nowhere.urdf", "walk", "nowhere.urdf"),
        (str(_DAISY), "nowhere", "nowhere does not exist"),
    ],
)
def test_a_missing_file_is_one_sentence(urdf: str, log: str, words: str, coclo: Coclo, leg_log: Path) -> None:
    answer = coclo("adopt", urdf, leg_log if log == "walk" else log)
    assert answer.status == 1
    assert is_one_sentence(answer)
    assert words in answer.err

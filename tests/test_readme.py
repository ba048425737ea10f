# SPDX-License-Identifier: BSD-3-Clause
"""What README and the other pages of the root show is what the package does; ``tests/docs`` has the site's pages."""

import re
import tomllib
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
import yaml

from coclo_vio import __version__
from coclo_vio.cli.application import COMMANDS
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel

_ROOT = Path(__file__).resolve().parents[1]
_README = (_ROOT / "README.md").read_text(encoding="utf-8")
_MOST_WORDS = 700


def test_the_readme_is_short() -> None:
    assert len(re.sub(r"<!--.*?-->", "", _README, flags=re.DOTALL).split()) <= _MOST_WORDS


def test_the_robot_of_the_readme_is_ten_lines_that_work(tmp_path: Path) -> None:
    """With the packaged go1's URDF for its own."""
    (description,) = re.findall(r"```yaml\n(.*?)```", _README, flags=re.DOTALL)
    assert len(description.splitlines()) <= 10
    urdf = (resources.files("coclo_vio.robot") / "presets" / "go1.urdf").read_text(encoding="utf-8")
    (tmp_path / "my_dog.urdf").write_text(urdf, encoding="utf-8")
    (tmp_path / "my_dog.yaml").write_text(description, encoding="utf-8")
    model = RobotModel(load_robot(tmp_path / "my_dog.yaml"))
    feet = model.feet(np.tile([0.0, 0.8, -1.6], 4), np.zeros(12))
    assert (feet.position_body[:, 2] < -0.2).all()
    np.testing.assert_allclose(model.foot_radii_m, 0.02)


@pytest.mark.parametrize("page", ["README.md", "CHANGELOG.md", "Makefile", "ARCHITECTURE.md", "CONTRIBUTING.md"])
def test_every_command_that_a_page_names_exists(page: str) -> None:
    text = (_ROOT / page).read_text(encoding="utf-8")
    assert set(re.findall(r"(?:^|`|/)coclo-vio ([a-z]+)\b", text, flags=re.MULTILINE)) <= set(COMMANDS)


def test_the_version_is_the_same_everywhere() -> None:
    project = tomllib.loads((_ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = yaml.safe_load((_ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert __version__ == project["version"] == citation["version"]
    assert citation["license"] == project["license"]

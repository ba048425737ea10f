# SPDX-License-Identifier: BSD-3-Clause
"""What the README shows is what the package does."""

import re
import tomllib
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
import yaml

from coclo_vio import __version__
from coclo_vio.cli import app
from coclo_vio.datasets.columns import ColumnNames
from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.robot.description import RobotDescription, load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs.estimators import ESTIMATORS
from coclo_vio.runs.run_config import resolve
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample

_ROOT = Path(__file__).resolve().parents[1]
_README = (_ROOT / "README.md").read_text(encoding="utf-8")


def _block(language: str) -> str:
    found = re.findall(rf"```{language}\n(.*?)```", _README, flags=re.DOTALL)
    assert len(found) == 1
    return str(found[0])


@pytest.fixture
def my_dog(tmp_path: Path) -> RobotDescription:
    """The README's robot, with the packaged go1's URDF for its own."""
    urdf = (resources.files("coclo_vio.robot") / "presets" / "go1.urdf").read_text(encoding="utf-8")
    (tmp_path / "my_dog.urdf").write_text(urdf, encoding="utf-8")
    (tmp_path / "my_dog.yaml").write_text(_block("yaml"), encoding="utf-8")
    return load_robot(tmp_path / "my_dog.yaml")


def test_your_own_robot_is_ten_lines_that_work(my_dog: RobotDescription) -> None:
    assert len(_block("yaml").splitlines()) <= 10
    model = RobotModel(my_dog)
    feet = model.feet(np.tile([0.0, 0.8, -1.6], 4), np.zeros(12))
    assert (feet.position_body[:, 2] < -0.2).all()
    np.testing.assert_allclose(model.foot_radii_m, 0.02)


def test_a_log_with_the_columns_of_the_readme_is_read(my_dog: RobotDescription, tmp_path: Path) -> None:
    columns = re.findall(r"^\| `([^`]+)`", _README.partition("## Your robot")[0], flags=re.MULTILINE)
    header = [name for column in columns for name in _named(column, my_dog)]
    row = [str(1_000_000 + index) if name == "stamp_ns" else "0.5" for index, name in enumerate(header)]
    log = tmp_path / "my_log.csv"
    log.write_text(",".join(header) + "\n" + ",".join(row) + "\n", encoding="utf-8")
    measurements = list(open_dataset(log, my_dog).measurements())
    assert [type(sample) for sample in measurements] == [FootForceSample, ImuSample, JointSample]
    joints = measurements[-1]
    assert isinstance(joints, JointSample)
    for reading in (joints.position, joints.velocity, joints.effort):
        np.testing.assert_array_equal(reading, np.full(12, 0.5))


def _named(column: str, robot: RobotDescription) -> list[str]:
    choices = {"axis": tuple("xyz"), "joint": robot.joint_names, "leg": robot.leg_names}
    for placeholder, names in choices.items():
        if f"{{{placeholder}}}" in column:
            return [column.format(**{placeholder: name}) for name in names]
    return [column]


def test_the_columns_of_the_readme_are_the_canonical_ones() -> None:
    for name, field in ColumnNames.model_fields.items():
        assert f"`{field.default[0]}`" in _README, name


def test_the_modes_of_the_readme_are_those_there_are() -> None:
    table = _README.partition("## Modes")[2].partition("##")[0]
    rows = [line.split("|")[1] for line in table.splitlines() if line.startswith("| `") and "--mode" not in line]
    assert {name for row in rows for name in re.findall(r"`(\w+)`", row)} == set(ESTIMATORS)


@pytest.mark.parametrize("page", ["README.md", "CHANGELOG.md", "Makefile", "ARCHITECTURE.md"])
def test_every_command_that_a_page_names_exists(page: str) -> None:
    there = {command.name or command.callback.__name__ for command in app.registered_commands if command.callback}
    text = (_ROOT / page).read_text(encoding="utf-8")
    assert set(re.findall(r"(?:^|`|/)coclo-vio ([a-z]+)\b", text, flags=re.MULTILINE)) <= there


def test_the_python_of_the_readme_runs() -> None:
    names: dict[str, object] = {"measurement": ImuSample(0, np.zeros(3), np.array([0.0, 0.0, 9.81]))}
    exec(_block("python"), names)
    assert isinstance(names["odometry"], LegOdometryFilter)
    assert names["estimate"] is None, "an IMU sample alone completes no step"


def test_every_setting_of_the_readme_exists() -> None:
    settings = re.findall(r"--set ([\w.]+=\S+?)`", _README)
    assert settings
    for setting in settings:
        resolve("daisy", settings=[setting])


def test_every_page_that_a_page_links_to_exists() -> None:
    for page in ("README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CONVENTIONS.md"):
        links = re.findall(r"\]\((?!https?:)([^)#]+)\)", (_ROOT / page).read_text(encoding="utf-8"))
        assert [link for link in links if not (_ROOT / link).is_file()] == []


def test_the_version_is_the_same_everywhere() -> None:
    project = tomllib.loads((_ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = yaml.safe_load((_ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert __version__ == project["version"] == citation["version"]
    assert citation["license"] == project["license"]

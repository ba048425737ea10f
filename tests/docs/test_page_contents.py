# SPDX-License-Identifier: BSD-3-Clause
"""What the pages show is what the package does: columns, robot, modes, commands, settings."""

import re
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from coclo_vio.cli import app
from coclo_vio.datasets.columns import ColumnNames
from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.robot.description import LegDescription, RobotDescription, load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs.estimators import ESTIMATORS
from coclo_vio.runs.run_config import resolve
from coclo_vio.simulation.simulated_recording import simulation_config
from coclo_vio.values.config import parse_settings
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample

_DOCS = Path(__file__).resolve().parents[2] / "docs"
_ALL_PAGES = "\n".join(page.read_text(encoding="utf-8") for page in sorted(_DOCS.glob("**/*.md")))
_IN_BLOCKS = "\n".join(re.findall(r"^```.*?^```", _ALL_PAGES, flags=re.DOTALL | re.MULTILINE))
_COMMAND = re.compile(r"^coclo-vio ([a-z]+)\b", flags=re.MULTILINE)
_SETTING = re.compile(r"--set (?:'([^']+)'|([a-z][\w.]*=[^\s`]+))")


def _page(name: str) -> str:
    return (_DOCS / name).read_text(encoding="utf-8")


def _table(page: str, head: str) -> list[list[str]]:
    """The cells of a table below its head, row by row."""
    rows = page.partition(head)[2].partition("\n\n")[0].splitlines()[2:]
    return [[cell.strip() for cell in row.strip("|").split(" | ")] for row in rows]


def _in_code(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)


@pytest.fixture
def my_dog(tmp_path: Path) -> RobotDescription:
    """The robot of the page, with the packaged go1's URDF for its own."""
    (example,) = re.findall(r"```yaml\n(.*?)```", _page("robots.md"), flags=re.DOTALL)
    urdf = (resources.files("coclo_vio.robot") / "presets" / "go1.urdf").read_text(encoding="utf-8")
    (tmp_path / "my_dog.urdf").write_text(urdf, encoding="utf-8")
    (tmp_path / "my_dog.yaml").write_text(example, encoding="utf-8")
    return load_robot(tmp_path / "my_dog.yaml")


def test_your_own_robot_is_ten_lines_that_work(my_dog: RobotDescription, tmp_path: Path) -> None:
    assert len((tmp_path / "my_dog.yaml").read_text(encoding="utf-8").splitlines()) <= 10
    model = RobotModel(my_dog)
    feet = model.feet(np.tile([0.0, 0.8, -1.6], 4), np.zeros(12))
    assert (feet.position_body[:, 2] < -0.2).all()
    np.testing.assert_allclose(model.foot_radii_m, 0.02)


def test_the_keys_of_a_robot_are_those_of_the_page(my_dog: RobotDescription) -> None:
    named = {key for keys, *_ in _table(_page("robots.md"), "| key | unit |") for key in _in_code(keys)}
    roots = {key.partition(".")[0].removesuffix("[]") for key in named}
    assert roots == set(RobotDescription.model_fields)
    assert {key[len("legs[].") :] for key in named if key.startswith("legs[].")} == set(LegDescription.model_fields)
    for part in ("contact", "imu"):
        keys = {key.partition(".")[2] for key in named if key.startswith(f"{part}.")}
        assert keys <= set(type(getattr(my_dog, part)).model_fields), part


def test_a_log_with_the_columns_of_the_page_is_read(my_dog: RobotDescription, tmp_path: Path) -> None:
    columns = [_in_code(cells[0])[0] for cells in _table(_page("recordings.md"), "| column | unit |")]
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


def test_the_columns_of_the_page_are_the_canonical_ones() -> None:
    for name, field in ColumnNames.model_fields.items():
        assert f"`{field.default[0]}`" in _page("recordings.md"), name


def test_the_modes_of_the_page_are_those_there_are() -> None:
    rows = _table(_page("modes.md"), "| `--mode` |")
    assert {name for row in rows for name in _in_code(row[0])} == set(ESTIMATORS)


def test_the_metrics_of_the_page_are_those_of_an_evaluation() -> None:
    named = {key for row in _table(_page("metrics.md"), "| metric | key |") for key in _in_code(row[1])}
    assert "drift_percent" in named
    assert named <= set(Evaluation.__dataclass_fields__)


def test_every_command_that_a_page_names_exists() -> None:
    there = {command.name or command.callback.__name__ for command in app.registered_commands if command.callback}
    named = set(_COMMAND.findall(_IN_BLOCKS)) | set(re.findall(r"`coclo-vio ([a-z]+)\b", _ALL_PAGES))
    assert len(named) > 8
    assert named <= there


def test_every_setting_that_a_page_gives_exists() -> None:
    settings = {quoted or bare for quoted, bare in _SETTING.findall(_ALL_PAGES)}
    of_trials = {setting for setting in settings if setting.startswith("trial.")}
    assert of_trials
    simulation_config("flat", parse_settings(sorted(of_trials)))
    assert len(settings - of_trials) > 8
    for setting in sorted(settings - of_trials):
        resolve("daisy", settings=[setting])

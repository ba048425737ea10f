# SPDX-License-Identifier: BSD-3-Clause
"""What the pages show is what the package does: columns, robot, modes, commands, settings, events, names."""

import ast
import re
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from coclo_vio.cli.application import COMMANDS
from coclo_vio.datasets.columns import ColumnNames
from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.filter.evidence_gate import GateOutcome
from coclo_vio.robot.description import LegDescription, RobotDescription, load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs.modes.registry import modes
from coclo_vio.runs.run_config import resolve
from coclo_vio.simulation.simulated_recording import simulation_config
from coclo_vio.simulation.simulated_trot import trot_config
from coclo_vio.simulation.trot.ground import GROUNDS
from coclo_vio.simulation.trot.quadruped import QUADRUPEDS
from coclo_vio.values.config import parse_settings
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample

_ROOT = Path(__file__).resolve().parents[2]
_DOCS = _ROOT / "docs"
_ALL_PAGES = "\n".join(page.read_text(encoding="utf-8") for page in sorted(_DOCS.glob("**/*.md")))
_IN_BLOCKS = "\n".join(re.findall(r"^```.*?^```", _ALL_PAGES, flags=re.DOTALL | re.MULTILINE))
_COMMAND = re.compile(r"^coclo-vio ([a-z]+)\b", flags=re.MULTILINE)
_SNAKE_CASE = re.compile(r"\b[a-z][a-z0-9]*(?:_[a-z0-9]+)+\b")
_OF_A_READER = ("my_body", "my_imu", "stairs_truth", "stereo_keyframes")  # names of a reader's own files and frames
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
    assert {name for row in rows for name in _in_code(row[0])} == set(modes())


def test_the_metrics_of_the_page_are_those_of_an_evaluation() -> None:
    named = {key for row in _table(_page("metrics.md"), "| metric | key |") for key in _in_code(row[1])}
    assert "drift_percent" in named
    assert named <= set(Evaluation.__dataclass_fields__)


def test_every_command_that_a_page_names_exists() -> None:
    named = set(_COMMAND.findall(_IN_BLOCKS)) | set(re.findall(r"`coclo-vio ([a-z]+)\b", _ALL_PAGES))
    assert len(named) > 8
    assert named <= set(COMMANDS)


def test_every_setting_that_a_page_gives_exists() -> None:
    examples = "".join(file.read_text(encoding="utf-8") for file in (_DOCS / "extending" / "examples").glob("*.py"))
    settings = {quoted or bare for quoted, bare in _SETTING.findall(_ALL_PAGES)}
    of_trials = {setting for setting in settings if setting.startswith("trial.")}
    of_plugins = {setting for setting in settings if f'"{setting.partition("=")[2]}"' in examples}
    assert of_trials
    assert len(of_plugins) == 2, "a contact estimator and a feedback policy, which the tests of the examples choose"
    of_trots = {quoted or bare for quoted, bare in _SETTING.findall(_page("trot.md"))}
    simulation_config("flat", parse_settings(sorted(of_trials - of_trots)))
    trot_config(parse_settings(sorted(of_trials & of_trots)))
    assert len(settings - of_trials) > 8
    for setting in sorted(settings - of_trials - of_plugins):
        resolve("daisy", settings=[setting])


def test_the_keys_of_the_trot_page_are_those_of_a_trot() -> None:
    trial = trot_config().trial
    causes = {key.split(":")[0] for row in _table(_page("trot.md"), "| cause | key |") for key in _in_code(row[1])}
    assert len(causes) > 15
    of_feet = {key for key in causes if key in type(trial.feet).model_fields}
    assert {"fall_s", "lingering", "lingering_s"} == of_feet
    assert {key for key in causes - of_feet if "." not in key} <= set(type(trial.imperfection).model_fields)
    for path in (key.removeprefix("trial.").split(".") for key in causes if key.startswith("trial.")):
        section = type(getattr(trial, path[0])).model_fields
        assert path[1] == "*" or path[1].partition("=")[0] in section
    robots = {name for row in _table(_page("trot.md"), "| `--robot` |") for name in _in_code(row[0])}
    grounds = {name for row in _table(_page("trot.md"), "| `--ground` |") for name in _in_code(row[0])}
    assert (robots, grounds) == (set(QUADRUPEDS), set(GROUNDS))


def test_every_event_is_on_a_page_with_its_condition() -> None:
    vision = {name for row in _table(_page("vision.md"), "| event | condition |") for name in _in_code(row[0])}
    bridge = set(re.findall(r"`(feedback_\w+ed)`", _page("bridge.md")))
    rotations = _table(_page("robustness.md"), "| event | when | what is done |")
    compared = {name for row in rotations for name in _in_code(row[0])}
    compared |= set(re.findall(r"`(vision_agrees)`", _page("robustness.md")))
    online = {name for row in _table(_page("online.md"), "| event | when |") for name in _in_code(row[0])}
    beside = {name for row in _table(_page("play.md"), "| event | condition |") for name in _in_code(row[0])}
    watched = _page("robustness.md").partition("## Streams watched")[2].partition("\n## ")[0]
    watched_events = set(re.findall(r"`((?:stream|reading)_\w+)`", watched))
    assert vision | bridge | compared | online | beside | watched_events == _event_kinds()
    wire = {name for row in _table(_page("live.md"), "| event | condition |") for name in _in_code(row[0])}
    sources = "".join(path.read_text(encoding="utf-8") for path in (_ROOT / "coclo_vio" / "live").glob("*.py"))
    assert wire == set(re.findall(r'kind(?:: str)? ?= ?"(\w+)"', sources))


def _event_kinds() -> set[str]:
    """The kinds of all events that the sources make, each a constant in a call of ``Event`` or of an event log."""
    kinds = {f"feedback_{outcome.value}" for outcome in (GateOutcome.REJECTED, GateOutcome.FORCED)}
    rooms = [_ROOT / "coclo_vio" / room for room in ("backend", "fusion", "online")]
    for file in (file for room in rooms for file in room.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            match node:
                case ast.Call(
                    func=ast.Name(id="Event") | ast.Attribute(attr="add"), args=[_, ast.Constant(value=str(kind)), _]
                ):
                    kinds.add(kind)
    return kinds


def test_names_in_code_type_are_names_of_the_package() -> None:
    """Of counts, events, settings, metrics, files: a renamed one is found on every page."""
    sources = [*(_ROOT / "coclo_vio").rglob("*.py"), *(_ROOT / "coclo_vio").rglob("*.yaml"), *_ROOT.glob("*.toml")]
    sources += [*(_ROOT / "tests").rglob("*.py"), *(_ROOT / "examples").iterdir(), _ROOT / "Makefile"]
    known = {
        word for file in sources if file.is_file() for word in re.findall(r"\w+", file.read_text(encoding="utf-8"))
    }
    known |= {path.stem for path in [*sources, *_DOCS.rglob("*")]} | set(_OF_A_READER)
    pages = [*_DOCS.rglob("*.md"), *(_ROOT / name for name in ("README.md", "ARCHITECTURE.md", "CONVENTIONS.md"))]
    named = {
        f"{page.name}: {name}"
        for page in pages
        for code in re.findall(r"`([^`\n]+)`", page.read_text(encoding="utf-8"))
        for name in _SNAKE_CASE.findall(code)
        if name not in known
    }
    assert sorted(named) == []

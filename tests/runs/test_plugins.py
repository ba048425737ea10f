# SPDX-License-Identifier: BSD-3-Clause
"""Extensions from files outside the package: the examples of the pages, each through ``COCLO_VIO_PLUGINS``."""

import json
import os
import runpy
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from coclo_vio import cli
from coclo_vio.datasets.dataset import FORMATS, open_dataset, robot_fit
from coclo_vio.evaluation.evaluation_record import RankingRecord
from coclo_vio.fusion.feedback import make_feedback_policy, unregister_feedback_policy
from coclo_vio.robot.contact import ContactConfig, ContactDetector, unregister_contact_estimator
from coclo_vio.robot.description import load_robot
from coclo_vio.runs import plugins
from coclo_vio.runs.modes.registry import modes, unregister_mode
from coclo_vio.runs.plugins import VARIABLE, load_plugins
from coclo_vio.runs.run_config import resolve
from coclo_vio.runs.run_folder import read_estimates
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.measurements import ImuSample, JointSample

pytestmark = pytest.mark.long

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "extending" / "examples"
MODE, FORMAT, CONTACT, FEEDBACK = (
    EXAMPLES / f"{name}_plugin.py" for name in ("mode", "format", "contact_estimator", "feedback_policy")
)
DAISY = load_robot("daisy")


DRIVER = """
import contextlib, io, json, sys
from coclo_vio import cli
answers = []
for arguments in json.loads(sys.argv[1]):
    sys.argv, out, err, status = ["coclo-vio", *arguments], io.StringIO(), io.StringIO(), 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            cli.main()
        except SystemExit as exit:
            status = exit.code or 0
    answers.append((status, out.getvalue(), err.getvalue()))
print(json.dumps(answers))
"""
LEAST_PHASE = ("--set", "robot.contact.method=least_phase", "--set", "robot.contact.parameters.least_s=0.1")


@dataclass(frozen=True)
class Answer:
    """Exit status, and what a command printed, in one line."""

    status: int
    out: str
    err: str

    @classmethod
    def of(cls, status: int, out: str, err: str) -> "Answer":
        return cls(status, *(" ".join(text.replace("│", " ").split()) for text in (out, err)))


def answers(commands: Sequence[Sequence[object]], plugins: Sequence[Path], folder: Path) -> list[Answer]:
    """The answers of commands in one process with these plugins."""
    environment = {**os.environ, VARIABLE: os.pathsep.join(map(str, plugins)), "COLUMNS": "200"}
    arguments = json.dumps([[str(argument) for argument in command] for command in commands])
    driver = [sys.executable, "-c", DRIVER, arguments]
    ran = subprocess.run(driver, check=False, capture_output=True, text=True, env=environment, cwd=folder)
    assert ran.returncode == 0, ran.stderr
    return [Answer.of(*answer) for answer in json.loads(ran.stdout)]


@dataclass(frozen=True)
class Extended:
    """What the command line does with all example plugins, and another one whose mode is a default.

    Attributes:
        folder: where it ran.
        by: the answers by the name of the command here.
    """

    folder: Path
    by: dict[str, Answer]


@pytest.fixture(scope="module")
def extended(leg_log: Path, tmp_path_factory: pytest.TempPathFactory) -> Extended:
    folder = tmp_path_factory.mktemp("extended")
    eager = folder / "eager_plugin.py"
    text = MODE.read_text(encoding="utf-8").replace('"coclo_smooth"', '"eager"').replace("rank=11", "default_rank=-1")
    eager.write_text(text, encoding="utf-8")
    write_semicolon_log(folder / "walk.csv", leg_log)
    write_semicolon_log(folder / "broken.csv", leg_log, until=20)
    with (folder / "broken.csv").open("a", encoding="utf-8") as lines:
        lines.write("210,0;oops\n")
    commands: dict[str, Sequence[object]] = {
        "compare": ("compare", leg_log, "--modes", "coclo,coclo_smooth", "-o", "out"),
        "inspect": ("inspect", leg_log, "--json"),
        "run --help": ("run", "--help"),
        "compare --help": ("compare", "--help"),
        "config": ("config", "--robot", "daisy", "--set", "bridge.feedback=inflated"),
        "contact": ("run", leg_log, "--mode", "coclo", *LEAST_PHASE, "-o", "contact"),
        "format": ("inspect", "walk.csv", "--json"),
        "format run": ("run", "walk.csv", "--mode", "naive", "-o", "format"),
        "broken": ("run", "broken.csv", "--mode", "naive", "-o", "broken"),
    }
    plugins = (MODE, FORMAT, CONTACT, FEEDBACK, eager)
    return Extended(folder, dict(zip(commands, answers(tuple(commands.values()), plugins, folder), strict=True)))


def write_semicolon_log(path: Path, recording: Path, until: int = 200) -> None:
    """The first samples of a leg log in the other format."""
    columns = [f"{joint}.{part}" for joint in DAISY.joint_names for part in ("pos", "vel", "torque")]
    lines, rates_forces = [], [0.0] * 6
    for sample in open_dataset(recording, DAISY).measurements(frozenset({ImuSample, JointSample})):
        if isinstance(sample, ImuSample):
            rates_forces = [*sample.angular_velocity, *sample.specific_force]
        elif isinstance(sample, JointSample):
            joints = np.column_stack((sample.position, sample.velocity, sample.effort)).ravel()
            values = [sample.stamp_ns * 1e-6, *rates_forces, *joints]
            lines.append(";".join(repr(float(value)).replace(".", ",") for value in values))
    header = ";".join(["t_ms", "wx", "wy", "wz", "ax", "ay", "az", *columns])
    path.write_text("\n".join([header, *lines[:until]]) + "\n", encoding="utf-8")


def test_the_example_of_a_mode_is_short() -> None:
    assert len(MODE.read_text(encoding="utf-8").splitlines()) <= 40


def test_a_mode_from_one_file_is_compared_and_ranked(extended: Extended) -> None:
    answer, out = extended.by["compare"], extended.folder / "out"
    assert answer.status == 0, answer.err
    compared = json.loads((out / "compare.json").read_text(encoding="utf-8"))
    assert set(compared) == {"coclo", "coclo_smooth"}
    [ranking] = RankingRecord.read(out / "ranking.json").pairs
    assert (ranking.subject, ranking.against) == ("coclo_smooth", "coclo")
    assert "smooth COCLO" in answer.out
    assert "smooth COCLO" in (out / "report.html").read_text(encoding="utf-8")
    assert (out / "figures" / "path.png").is_file()


def test_a_mode_from_one_file_estimates_what_it_says(extended: Extended) -> None:
    """The poses of coclo, and a velocity without its jumps."""
    plain, smooth = (read_estimates(extended.folder / "out", name) for name in ("coclo", "coclo_smooth"))
    np.testing.assert_array_equal(smooth.trajectory.T_world_body, plain.trajectory.T_world_body)
    velocities = [one.trajectory.velocity_world for one in (plain, smooth)]
    jumps = [np.abs(np.diff(velocity, axis=0)).max() for velocity in velocities if velocity is not None]
    assert jumps[1] < 0.7 * jumps[0]
    assert smooth.leg_names == plain.leg_names == DAISY.leg_names


def test_a_mode_from_one_file_is_inspected_and_in_the_help(extended: Extended) -> None:
    modes = json.loads(extended.by["inspect"].out)["modes"]
    assert modes["coclo_smooth"] == {"ready": True, "missing": []}
    for command in ("run --help", "compare --help"):
        assert "coclo_smooth" in extended.by[command].out


def test_a_mode_from_one_file_can_be_the_default(extended: Extended) -> None:
    assert "Default: eager, otherwise combined" in extended.by["run --help"].out


def test_a_contact_estimator_from_one_file_decides_stance(extended: Extended) -> None:
    assert extended.by["contact"].status == 0, extended.by["contact"].err
    states = np.genfromtxt(extended.folder / "contact" / "coclo_state.csv", delimiter=",", names=True)
    stamps_s = states["stamp_ns"] * 1e-9
    changes = 0
    for leg in DAISY.leg_names:
        at_s = stamps_s[1:][np.diff(states[f"{leg}is_stance"]) != 0]
        assert (np.diff(at_s) > 0.1 - 1e-6).all(), leg
        changes += len(at_s)
    assert changes > 6, "the robot walks"
    with pytest.raises(
        ConfigError,
        match=r"no contact estimator 'least_phase'; there are: hysteresis, kinematic, kinematic_load, logistic, paper",
    ):
        resolve("daisy", settings=LEAST_PHASE[1::2])


@pytest.fixture
def least_phase() -> Iterator[None]:
    runpy.run_path(str(CONTACT))
    yield
    unregister_contact_estimator("least_phase")


@pytest.mark.usefixtures("least_phase")
def test_the_example_of_a_contact_estimator_holds_each_phase_and_ends_stance_without_a_load() -> None:
    config = ContactConfig.parse(
        {"method": "least_phase", "on_force": 20, "off_force": 12, "parameters": {"least_s": 0.05}}, "test"
    )
    detector = ContactDetector(config, 2)
    loads = [(0, 0), (25, 0), (5, 0), (5, 0), (25, 15), (25, 21), (25, np.nan), (25, 30), (5, 30), (5, 30)]
    stance = [
        detector.update(20_000_000 * step, np.array(load, dtype=np.float64)).is_stance.tolist()
        for step, load in enumerate(loads)
    ]
    assert [first for first, _ in stance] == [False, *[True] * 7, False, False]
    assert [second for _, second in stance] == [*[False] * 5, True, False, False, False, True]


def test_a_feedback_policy_from_one_file_can_be_configured(extended: Extended) -> None:
    answer = extended.by["config"]
    assert answer.status == 0, answer.err
    assert "feedback: inflated" in answer.out


@pytest.mark.usefixtures("fresh")
def test_a_configuration_loads_the_plugins_that_it_may_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, str(FEEDBACK))
    try:
        bridge = resolve(settings=["bridge.feedback=inflated"]).bridge
        policy = make_feedback_policy(bridge.feedback, bridge.policy_parameters)
    finally:
        unregister_feedback_policy("inflated")
    assert type(policy).__name__ == "InflatedFeedback"


def test_a_format_from_one_file_is_read_and_its_robot_inferred(extended: Extended, leg_log: Path) -> None:
    inspected = json.loads(extended.by["format"].out)
    assert (inspected["report"]["format"], inspected["robot"]) == ("semicolon log", "daisy")
    counts = {stream["name"]: stream["samples"] for stream in inspected["report"]["streams"]}
    assert counts == {"imu": 200, "joints": 200}
    assert inspected["modes"]["coclo"]["ready"]
    assert extended.by["format run"].status == 0, extended.by["format run"].err
    estimates = read_estimates(extended.folder / "format", "naive").trajectory
    assert estimates.stamps_ns[-1] == 1_990_000_000


def test_a_format_from_one_file_names_the_line_of_a_malformed_cell(extended: Extended) -> None:
    answer = extended.by["broken"]
    assert answer.status == 1
    assert "broken.csv, line 22: could not convert string to float: 'oops'; correct it" in answer.err
    assert "Traceback" not in answer.err


@pytest.fixture
def semicolon_log() -> Iterator[None]:
    before = list(FORMATS)
    runpy.run_path(str(FORMAT))
    yield
    FORMATS[:] = before


@pytest.mark.usefixtures("semicolon_log")
def test_the_example_of_a_format_gives_back_every_value(leg_log: Path, tmp_path: Path) -> None:
    write_semicolon_log(tmp_path / "walk.csv", leg_log)
    sensors = frozenset({ImuSample, JointSample})
    ours, canonical = (open_dataset(path, DAISY).measurements(sensors) for path in (tmp_path / "walk.csv", leg_log))
    compared = 0
    for one, other in zip(ours, canonical, strict=False):
        assert type(one) is type(other)
        assert one.stamp_ns == other.stamp_ns
        for part in ("position", "velocity", "effort", "angular_velocity", "specific_force"):
            np.testing.assert_allclose(getattr(one, part, 0.0), getattr(other, part, 0.0), rtol=1e-12)
        compared += 1
    assert compared == 400
    assert robot_fit(tmp_path / "walk.csv").fitting == ("daisy",)


@pytest.fixture
def fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    """No plugin has been loaded yet."""
    monkeypatch.setattr(plugins, "_loaded", {})


@pytest.mark.usefixtures("fresh")
def test_a_plugin_is_imported_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = tmp_path / "imports.txt"
    plugin = tmp_path / "counting_plugin.py"
    plugin.write_text(f"with open({str(log)!r}, 'a') as file:\n    file.write('imported ')\n", encoding="utf-8")
    monkeypatch.setenv(VARIABLE, os.pathsep.join((str(plugin), str(plugin))))
    load_plugins()
    load_plugins()
    assert log.read_text(encoding="utf-8") == "imported "


@pytest.mark.usefixtures("fresh")
def test_a_plugin_can_be_an_importable_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "some_coclo_plugin.py").write_text("LOADED = True\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv(VARIABLE, "some_coclo_plugin")
    load_plugins()
    assert sys.modules["some_coclo_plugin"].LOADED


@pytest.mark.usefixtures("fresh")
@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, r"ImportError: there is no file .*broken_plugin\.py"),
        ("import no_such_module_at_all\n", "ModuleNotFoundError: No module named 'no_such_module_at_all'"),
        ("raise ValueError('half-way')\n", "ValueError: half-way"),
        ("def f(:\n", "SyntaxError: "),
        (
            "import coclo_vio as cv\ncv.register_mode(cv.Mode('coclo', '', frozenset(), None))\n",
            "ConfigError: there is a mode 'coclo' already; register yours under another name",
        ),
    ],
)
def test_a_plugin_that_cannot_be_loaded_is_an_error_at_every_call(
    content: str | None, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plugin = tmp_path / "broken_plugin.py"
    if content is not None:
        plugin.write_text(content, encoding="utf-8")
    monkeypatch.setenv(VARIABLE, str(plugin))
    for _ in range(2):
        words = (
            rf"the plugin '.*broken_plugin\.py' cannot be loaded \({reason}.*\); mend it, or take it out of {VARIABLE}"
        )
        with pytest.raises(ConfigError, match=words):
            load_plugins()


@pytest.mark.usefixtures("fresh")
def test_a_plugin_that_cannot_be_loaded_is_one_sentence_on_the_command_line(
    leg_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "missing_plugin.py"))
    monkeypatch.setattr(sys, "argv", ["coclo-vio", "run", str(leg_log)])
    with pytest.raises(SystemExit, match="2"):
        cli.main()
    error = capsys.readouterr().err
    assert error.startswith("coclo-vio: the plugin ")
    assert error.count("\n") == 1


@pytest.mark.usefixtures("fresh")
def test_a_plugin_can_be_an_entry_point_of_an_installed_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A package with the entry point group ``coclo_vio.plugins``, as pip would have installed it."""
    (tmp_path / "smooth_coclo.py").write_bytes(MODE.read_bytes())
    metadata = tmp_path / "smooth_coclo-1.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: smooth-coclo\nVersion: 1\n", encoding="utf-8")
    (metadata / "entry_points.txt").write_text("[coclo_vio.plugins]\nsmooth = smooth_coclo\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(plugins, "_entry_points", plugins._entry_points.__wrapped__)  # not those of before
    try:
        assert "coclo_smooth" in modes()
    finally:
        unregister_mode("coclo_smooth")

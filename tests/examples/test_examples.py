# SPDX-License-Identifier: BSD-3-Clause
"""Every script of ``examples`` runs, without arguments too, and prints a result that makes sense."""

import re
import runpy
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

import coclo_vio as cv
from coclo_vio.datasets.rosbag.storage.bag_file import BagFile
from coclo_vio.datasets.rosbag.storage.type_definitions import TypeDefinitions
from coclo_vio.robot.contact import unregister_contact_estimator

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
MOST_LINES = 40
Example = Callable[..., str]


@pytest.fixture
def run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path, leg_log: Path
) -> Iterator[Example]:
    """Runs a script in this process, in a folder of its own; the short leg log stands in for the bundled recording."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(EXAMPLES))
    monkeypatch.setattr(cv, "sample_path", lambda: leg_log)

    def run_script(name: str, *arguments: object) -> str:
        monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
        runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
        return capsys.readouterr().out

    yield run_script
    unregister_contact_estimator("relative_load")


def numbers(pattern: str, text: str) -> list[float]:
    """The numbers that a pattern with one group finds."""
    found = [float(number) for number in re.findall(pattern, text)]
    assert found, f"no {pattern} in {text!r}"
    return found


@pytest.mark.long
def test_a_recording_is_run_and_saved(run: Example, tmp_path: Path) -> None:
    shown = run("run_bag")
    assert "walk: robot daisy; enough for coclo, " in shown
    assert numbers(r"ATE ([\d.]+) mm", shown)[0] < 10.0
    assert cv.load_run(tmp_path / "out" / "run_bag").names == ("coclo",)
    assert run("run_bag") == shown, "a second time"


@pytest.mark.long
def test_a_bag_is_run_by_the_mode_that_is_named(run: Example, short_recording: Path, tmp_path: Path) -> None:
    shown = run("run_bag", short_recording, "naive", tmp_path / "naive")
    assert "walk.mcap: robot daisy; enough for coclo, vins, combined" in shown
    assert cv.load_run(tmp_path / "naive").names == ("naive",)


def test_a_robot_of_ones_own_stands_on_its_feet(run: Example) -> None:
    shown = run("own_robot")
    assert shown.startswith("my_dog: ")
    feet = {leg: (float(y), float(z)) for leg, y, z in re.findall(r"(\w+): foot at \[\s*\S+\s+(\S+)\s+(\S+)\]", shown)}
    assert set(feet) == {"FR", "FL", "RR", "RL"}
    assert all((y > 0) == leg.endswith("L") and z < -0.2 for leg, (y, z) in feet.items())


def test_the_online_loop_prints_poses_and_counts(run: Example) -> None:
    shown = run("online_loop")
    assert len(re.findall(r"^coclo at \d+ ns: position \[", shown, flags=re.MULTILINE)) == 3, "one a second"
    assert "'standstill'" in shown


def test_the_errors_of_the_evaluated_file_are_found(run: Example) -> None:
    shown = run("evaluate_tum")
    (heading_deg,) = numbers(r"heading off by (\S+) deg", shown)
    assert 0.7 < heading_deg < 1.0, "1 deg over the log, of which the start is tied over a second"
    estimated, true = re.findall(r"path length ([\d.]+) m of ([\d.]+) m", shown)[0]
    assert float(estimated) / float(true) == pytest.approx(1.02, abs=0.005)


def test_any_two_files_are_evaluated(run: Example, leg_log: Path) -> None:
    shown = run("evaluate_tum", leg_log / "groundtruth.tum", leg_log / "groundtruth.tum")
    assert numbers(r"ATE ([\d.]+) m", shown) == [0.0]


@pytest.mark.long
def test_modes_are_ranked(run: Example, short_recording: Path, tmp_path: Path) -> None:
    shown = run("compare_modes", short_recording, "coclo,vins", "ranked")
    assert len(numbers(r"walk.mcap, \w+: ATE ([\d.]+) mm, ANEES", shown)) == 2
    assert re.search(r"^(VINS|COCLO) .*(COCLO|VINS)", shown, flags=re.MULTILINE), "a sentence of the ranking"
    assert (tmp_path / "ranked" / "report.html").is_file()


def test_tracks_need_no_image(run: Example) -> None:
    estimated, true = re.findall(r"estimated ([\d.]+) m, travelled ([\d.]+) m", run("tracks_without_images"))[0]
    assert float(estimated) == pytest.approx(float(true), abs=0.02)


def test_external_odometry_bridges_lost_vision(run: Example) -> None:
    off_m = dict(re.findall(r"^(\w+): (\S+) m off", run("external_odometry"), flags=re.MULTILINE))
    assert abs(float(off_m["stereo_twist"])) < 0.01 < abs(float(off_m["stereo"]))


def test_a_simulated_walk_is_estimated(run: Example) -> None:
    assert numbers(r"daisy: ([\d.]+) mm off", run("simulate_walk", "daisy"))[0] < 15.0


@pytest.mark.long
def test_a_contact_estimator_of_ones_own_is_used(run: Example) -> None:
    shown = run("own_contact_estimator")
    assert "relative_load" in shown
    described, own = numbers(r"ATE ([\d.]+) mm", shown)
    assert max(described, own) < 10.0


def test_covariances_are_drawn(run: Example, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    assert numbers(r"largest position sigma ([\d.]+) mm", run("covariance_plots"))[0] > 0.0
    for name in ("error_bands.png", "sigmas.png"):
        assert (tmp_path / "out" / name).read_bytes().startswith(b"\x89PNG")


def test_a_script_runs_as_its_docstring_shows(tmp_path: Path) -> None:
    command = [sys.executable, str(EXAMPLES / "own_robot.py")]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path)
    assert done.stdout.startswith("my_dog: ")


@pytest.mark.parametrize("script", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_a_script_is_short_shows_its_command_and_has_a_test(script: Path) -> None:
    text = script.read_text(encoding="utf-8")
    assert text.startswith("# SPDX-License-Identifier: BSD-3-Clause\n")
    assert len(text.splitlines()) <= MOST_LINES
    assert f"``python examples/{script.name}" in text.partition('"""')[2].partition('"""')[0]
    assert f'run("{script.stem}"' in Path(__file__).read_text(encoding="utf-8")


def test_a_node_of_ros_publishes_odometry(run: Example, monkeypatch: pytest.MonkeyPatch, short_recording: Path) -> None:
    published = fake_ros(monkeypatch, short_recording)
    run("ros2_node", "daisy")
    assert len(published) > 300
    types = TypeDefinitions()
    first = types.typed("nav_msgs/msg/Odometry")[1].deserialize_cdr(published[0], "nav_msgs/msg/Odometry")
    assert (first.header.frame_id, first.child_frame_id) == ("odom", "base_link")
    assert first.pose.covariance[0] > 0.0


def fake_ros(monkeypatch: pytest.MonkeyPatch, recording: Path) -> list[bytes]:
    """Modules named as those of ROS; ``spin`` plays a recording. What is published is in the list."""
    published: list[bytes] = []

    class Node:
        def __init__(self, name: str) -> None:
            self.callbacks: dict[str, Callable[[Any], None]] = {}

        def create_publisher(self, msgtype: type, topic: str, depth: int) -> SimpleNamespace:
            return SimpleNamespace(publish=published.append)

        def create_subscription(self, msgtype: type, topic: str, callback: Callable[[Any], None], depth: int) -> None:
            self.callbacks[topic] = callback

    def spin(node: Node) -> None:
        bag = BagFile(recording, allow_partial=False)
        for message in bag.messages(node.callbacks.keys()):
            node.callbacks[message.topic](bag.decoded(message.topic, message.data))

    modules = {
        "rclpy": {"init": lambda: None, "spin": spin},
        "rclpy.node": {"Node": Node},
        "nav_msgs.msg": {"Odometry": object},
        "sensor_msgs.msg": {"Imu": object, "JointState": object},
    }
    for name, contents in modules.items():
        module = ModuleType(name)
        module.__dict__.update(contents)
        monkeypatch.setitem(sys.modules, name, module)
    return published

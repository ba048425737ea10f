# SPDX-License-Identifier: BSD-3-Clause
"""The command ``simulate``: what it writes and prints, what its options change, and what it refuses."""

import os
import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest
import yaml
from console import Answer, Coclo, is_one_sentence

from coclo_vio.cli import simulating
from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.robot.description import load_robot
from coclo_vio.simulation import simulated_recording
from coclo_vio.simulation.simulated_recording import RecordingFormat
from coclo_vio.simulation.trial.terrain import TerrainName
from coclo_vio.simulation.trot.ground import GROUNDS
from coclo_vio.simulation.trot.quadruped import QUADRUPEDS
from coclo_vio.simulation.visuals import opengl
from coclo_vio.values.measurements import JointSample

SHORT = ("--duration", 1, "--no-images")


def test_it_prints_the_paths_of_the_recording_and_of_its_truth(coclo: Coclo, tmp_path: Path) -> None:
    answer = coclo("simulate", "stairs", "--seed", 5, "-o", "walk.mcap", *SHORT)
    assert (answer.status, answer.err) == (0, "")
    lines = answer.out.splitlines()
    assert lines[0].startswith("recording: walk.mcap (")
    assert lines[1].startswith("truth, which no estimator may read: walk_truth (")
    assert lines[2] == "1.0 s, 0.00 m walked of a path of 4.99 m"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["walk.mcap", "walk_truth"]
    assert (tmp_path / "walk.mcap").read_bytes().startswith(b"\x89MCAP")


@pytest.mark.long
@pytest.mark.parametrize(
    ("arguments", "written"),
    [
        (("-o", "walk"), "walk/mav0/joints0/data.csv"),
        (("-o", "walk", "--format", "ros2"), "walk/metadata.yaml"),
        (("-o", "walk.db3"), "walk.db3"),
    ],
)
def test_the_format_is_that_of_the_suffix_or_of_the_option(
    arguments: tuple[str, ...], written: str, coclo: Coclo, tmp_path: Path
) -> None:
    answer = coclo("simulate", "flat", *arguments, *SHORT)
    assert answer.status == 0
    assert (tmp_path / written).is_file()
    recording = tmp_path / arguments[1]
    assert len(list(open_dataset(recording, load_robot("daisy")).measurements())) == 200


def test_options_change_the_configuration_that_is_kept_with_the_truth(coclo: Coclo, tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("trial: {gait: {height_m: 0.21}, imperfection: {mass: 0.1}}", encoding="utf-8")
    answer = coclo(
        *("simulate", "ramp", "-o", "walk", *SHORT, "-c", "mine.yaml", "--ideal", "--friction", 0.5),
        *("--foot-radius", 0.03, "--gait-speed", 1.5, "--lighting", "dark", "--blackout", "3:1.5", "--blackout", "9:2"),
        *(
            "--slippery-tile",
            0.3,
            "--shock-scale",
            3,
            "--texture",
            "poor",
            "--image-encoding",
            "jpeg",
            "--condition",
            "shadows",
            "--condition",
            "relief",
            "--set",
            "trial.imperfection.link_length=0.02",
        ),
    )
    assert answer.status == 0
    config = yaml.safe_load((tmp_path / "walk_truth" / "config.yaml").read_text(encoding="utf-8"))
    plain = simulated_recording.simulation_config("ramp").trial.gait
    gait, body, imperfection = (config["trial"][part] for part in ("gait", "body", "imperfection"))
    assert gait["height_m"] == 0.21
    for key, factor in (("speed_mps", 1.5), ("turn_rate_radps", 1.5), ("period_s", 1 / 1.5)):
        assert gait[key] == pytest.approx(factor * getattr(plain, key))
    assert (body["friction"], body["foot_radius_m"]) == (0.5, 0.03)
    assert config["trial"]["slippery_tile"] == 0.3
    assert [config["trial"][imu]["shock_scale"] for imu in ("imu", "camera_imu")] == [1.0, 3.0]
    assert config["trial"]["camera_imu"]["rate_hz"] == 200.0
    assert (config["scene"]["texture"], config["scene"]["rubble"]) == ("poor", 200)
    assert config["camera"]["encoding"] == "jpeg"
    blackouts = [{"start_s": 3.0, "duration_s": 1.5}, {"start_s": 9.0, "duration_s": 2.0}]
    lighting = config["camera"]["lighting"]
    assert (lighting["level"], lighting["dark_share"], lighting["blackouts"]) == ("dark", 0.05, blackouts)
    assert lighting["bars"] == 0.6  # of the condition
    assert imperfection.pop("link_length") == 0.02  # --set wins over --ideal, and that over the file
    assert set(imperfection.values()) == {0.0}


def test_the_kept_configuration_and_the_seed_repeat_the_recording(coclo: Coclo, tmp_path: Path) -> None:
    assert coclo("simulate", "stairs", "--seed", 2, "-o", "one.bag", *SHORT, "--friction", 0.6).status == 0
    again = ("simulate", "stairs", "--seed", 2, "-o", "two.bag", *SHORT, "-c", "one_truth/config.yaml")
    assert coclo(*again).status == 0
    assert (tmp_path / "two.bag").read_bytes() == (tmp_path / "one.bag").read_bytes()


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["-o", "there.bag"], 1, "there.bag is there already; name another path, or remove it first"),
        (["-o", "old.mcap"], 1, "old_truth is there already"),
        (["-o", "."], 1, "no name for a recording"),
        (["-o", "walk.zip"], 1, "walk.zip ends in .zip, which no format has; end it in .bag"),
        (["-o", "walk.bag", "--format", "mcap"], 1, "walk.bag cannot be written as mcap, which ends in .mcap"),
        (["-o", "there.bag/walk"], 1, "cannot write there.bag/walk: "),
        (["-o", "walk", "--blackout", "3"], 2, "--blackout takes START:SECONDS, such as 20:3"),
        (["-o", "walk", "--blackout", "-1:3"], 2, "camera.lighting.blackouts.0.start_s = -1.0: "),
        (["-o", "walk", "--friction", "7"], 2, "trial.body.friction = 7.0: Input should be less than or equal to 2"),
        (["-o", "walk", "--slippery-tile", "0"], 2, "trial.slippery_tile = 0.0: Input should be greater than 0"),
        (["-o", "walk", "--shock-scale", "-1"], 2, "trial.camera_imu.shock_scale = -1.0: "),
        (["-o", "walk", "--gait-speed", "5", "--set", "trial.gait.speed_mps=0.3"], 2, "gait speed 5.0: "),
        (["-o", "walk", "--set", "trial.gait.sped_mps=1"], 2, "there is no trial.gait.sped_mps; the keys there are: "),
        (["-o", "walk", "--condition", "fog"], 2, "there is no condition 'fog'; choose from bricks, "),
        (["-o", "walk", "-c", "none.yaml"], 2, "cannot read the configuration none.yaml"),
    ],
)
def test_errors_are_reported_before_the_simulation_starts(
    arguments: list[str], status: int, words: str, coclo: Coclo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulated_recording, "simulate", lambda *_, **__: pytest.fail("the simulation started"))
    (tmp_path / "there.bag").touch()
    (tmp_path / "old_truth").mkdir()
    answer = coclo("simulate", "flat", *arguments)
    assert answer.status == status
    assert words in answer.err
    assert is_one_sentence(answer)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["old_truth", "there.bag"]


def test_missing_opengl_is_reported_before_the_simulation_starts(
    coclo: Coclo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulated_recording, "simulate", lambda *_, **__: pytest.fail("the simulation started"))
    monkeypatch.setattr(opengl, "works", lambda backend: False)
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    answer = coclo("simulate", "flat", "-o", "walk.bag")
    assert answer.status == 1
    assert "or leave the images out with --no-images" in answer.err
    assert is_one_sentence(answer)
    assert list(tmp_path.iterdir()) == []


def test_an_interrupt_leaves_nothing(coclo: Coclo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(folder: Path, *_: object, **__: object) -> None:
        (folder / "half").mkdir(parents=True)
        raise KeyboardInterrupt

    monkeypatch.setattr(simulated_recording, "write_euroc_folder", interrupted)
    answer = coclo("simulate", "flat", "-o", "walk", *SHORT)
    assert answer.status == 130
    assert "nothing was written: the same command simulates the same trial" in answer.err
    assert list(tmp_path.iterdir()) == []


def test_a_trot_is_that_of_the_robot_on_the_ground_at_the_speed(coclo: Coclo, tmp_path: Path) -> None:
    answer = coclo(
        *("simulate", "trot", "-o", "a1.bag", *SHORT, "--robot", "a1", "--ground", "ramp", "--speed", 0.4, "--ideal"),
        *("--friction", 0.6, "--set", "trial.imperfection.link_length_error=-0.05"),
    )
    assert (answer.status, answer.err) == (0, "")
    assert "m walked of a path of 50.00 m" in answer.out
    kept = yaml.safe_load((tmp_path / "a1_truth" / "config.yaml").read_text(encoding="utf-8"))["trial"]
    assert (kept["robot"], kept["ground"], kept["gait"]["speed_mps"]) == ("a1", "ramp", 0.4)
    assert (kept["body"]["friction"], kept["feet"]["is_present"]) == (0.6, False)
    imperfection = kept["imperfection"]
    assert (imperfection["link_length_error"], imperfection["link_length"]) == (-0.05, 0.0)
    read = open_dataset(tmp_path / "a1.bag", load_robot("a1")).measurements()
    assert sum(isinstance(sample, JointSample) for sample in read) == 500
    again = coclo("simulate", "trot", "-o", "again/a1.bag", *SHORT, "-c", "a1_truth/config.yaml")
    assert again.status == 0
    assert (tmp_path / "again" / "a1.bag").read_bytes() == (tmp_path / "a1.bag").read_bytes()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["flat", "--speed", "0.5", "--robot", "go1"], "the trial flat has no --robot, --speed"),
        (["trot", "--gait-speed", "2"], "the trial trot has no --gait-speed"),
        (["trot", "--set", "trial.gait.dutty=0.5"], "there is no trial.gait.dutty"),
    ],
)
def test_options_of_other_trials_are_refused(arguments: list[str], words: str, coclo: Coclo, tmp_path: Path) -> None:
    answer = coclo("simulate", *arguments, "-o", "walk.bag")
    assert answer.status == 2
    assert words in answer.err
    assert is_one_sentence(answer)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_a_robot_that_falls_is_status_1(coclo: Coclo, tmp_path: Path) -> None:
    answer = coclo("simulate", "flat", "-o", "walk", "--no-images", "--set", "trial.body.spring_nm_per_rad=[1, 1, 1]")
    assert answer.status == 1
    assert "the robot fell after " in answer.err
    assert is_one_sentence(answer)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("arguments", [["hill", "-o", "x"], ["flat"], ["flat", "-o", "x", "--seed", "-1"]])
def test_wrong_usage_of_simulate_is_status_2(arguments: list[str], coclo: Coclo) -> None:
    answer = coclo("simulate", *arguments)
    assert answer.status == 2
    assert "Usage" in answer.err


def test_the_choices_are_those_of_the_simulator() -> None:
    def choices(option: object) -> tuple[str, ...]:
        return get_args(get_args(option)[0])

    assert choices(simulating.TrialArgument) == (*get_args(TerrainName), "trot")
    assert get_args(choices(simulating.RobotOption)[0]) == QUADRUPEDS
    assert get_args(choices(simulating.GroundOption)[0]) == GROUNDS
    assert set(get_args(choices(simulating.FormatOption)[0])) == {kind.value for kind in RecordingFormat}


@pytest.mark.long
def test_without_mujoco_only_simulate_is_missing(tmp_path: Path) -> None:
    """In a process where MuJoCo cannot be imported, all other commands are there; this one names the extra."""
    code = "import sys; sys.modules['mujoco'] = None; from coclo_vio.cli import main; main()"

    def run(*arguments: str) -> Answer:
        done = subprocess.run(
            [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False, cwd=tmp_path
        )
        return Answer(done.returncode, done.stdout, done.stderr)

    assert run("robots").status == 0
    answer = run("simulate", "flat", "-o", "walk")
    assert answer.status == 1
    assert "pip install 'coclo-vio[sim]'" in answer.err
    assert is_one_sentence(answer)


@pytest.mark.long
def test_a_seed_makes_the_same_bytes_with_and_without_numba(tmp_path: Path) -> None:
    """Contacts make much of rounding, and kernels round otherwise: the simulator takes none."""
    arguments = ["simulate", "stairs", "--seed", "4", "--no-images", "--duration", "1.5"]
    made = []
    for numba in ("0", "1"):
        path = tmp_path / numba / "trial.mcap"
        subprocess.run(
            [sys.executable, "-m", "coclo_vio", *arguments, "-o", str(path)],
            env={**os.environ, "COCLO_VIO_NUMBA": numba},
            check=True,
            capture_output=True,
        )
        made.append(path.read_bytes())
    assert made[0] == made[1]

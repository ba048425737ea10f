# SPDX-License-Identifier: BSD-3-Clause
from pathlib import Path

import pytest
import yaml

from coclo_vio.robot.description import load_robot
from coclo_vio.runs.run_config import RunConfig, resolve
from coclo_vio.values.calibration import ImuCalibration
from coclo_vio.values.config import write_yaml
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.imu_grades import ERRORS_OF_GRADE


def _file(folder: Path, values: object) -> Path:
    path = folder / "config.yaml"
    path.write_text(yaml.safe_dump(values), encoding="utf-8")
    return path


def _robot_folder(tmp_path: Path) -> Path:
    """A folder with a robot described whole in a configuration, its URDF named as a neighbour."""
    description = load_robot("daisy").model_dump(mode="json")
    (tmp_path / "mine.urdf").write_bytes(Path(description["urdf"]).read_bytes())
    _file(tmp_path, {"robot": description | {"name": "mine", "urdf": "mine.urdf", "filter": {"max_gap_s": 0.3}}})
    return tmp_path / "config.yaml"


def test_every_stage_has_its_defaults() -> None:
    config = resolve("daisy")
    assert config == RunConfig(robot=load_robot("daisy"), filter=config.filter)
    assert config.filter == resolve("daisy", settings=["filter.profile=robust"]).filter


def test_the_later_wins_preset_then_file_then_setting(tmp_path: Path) -> None:
    plain = resolve("go1")
    file = _file(tmp_path, {"filter": {"max_gap_s": 0.31, "rest_timeout_s": 0.7}})
    config = resolve("go1", file, ["filter.max_gap_s=0.4", "robot.contact.on_dwell_s=0.05"])
    assert (config.filter.max_gap_s, config.filter.rest_timeout_s) == (0.4, 0.7)
    assert config.robot.contact.on_dwell_s == 0.05
    assert config.robot.contact.on_force == plain.robot.contact.on_force
    assert plain.filter.max_gap_s != 0.4


def test_a_written_configuration_gives_the_same_again(tmp_path: Path) -> None:
    config = resolve("go1", None, ["filter.profile=paper", "evaluation.alignment=se3"])
    write_yaml(config, tmp_path / "config.yaml")
    assert resolve(None, tmp_path / "config.yaml") == config


def test_a_file_names_a_preset_and_changes_it(tmp_path: Path) -> None:
    config = resolve(None, _file(tmp_path, {"robot": {"preset": "go1", "encoder_noise_rad": 0.004}}))
    assert config.robot.name == "go1"
    assert config.robot.encoder_noise_rad == 0.004


@pytest.mark.parametrize("given", [{"preset": "go1", "encoder_noise_rad": 0.004}, "whole"])
def test_the_robot_of_the_command_line_replaces_the_files(given: object, tmp_path: Path) -> None:
    if given == "whole":
        given = load_robot("go1").model_dump(mode="json")
    assert resolve("daisy", _file(tmp_path, {"robot": given})).robot == load_robot("daisy")


def test_changes_without_a_robot_go_to_the_robot_of_the_command_line(tmp_path: Path) -> None:
    config = resolve("daisy", _file(tmp_path, {"robot": {"encoder_noise_rad": 0.004}}))
    assert config.robot == load_robot("daisy").model_copy(update={"encoder_noise_rad": 0.004})


def test_a_robot_described_whole_brings_its_urdf_and_filter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = _robot_folder(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    config = resolve(None, Path("..") / file.name)
    assert Path(config.robot.urdf).resolve() == (tmp_path / "mine.urdf").resolve()
    assert config.filter.max_gap_s == 0.3


def test_settings_overrule_the_filter_of_a_robot(tmp_path: Path) -> None:
    file = _robot_folder(tmp_path)
    assert resolve(None, file, ["filter.max_gap_s=0.2"]).filter.max_gap_s == 0.2
    assert resolve(None, file, ["robot.filter.max_gap_s=0.25"]).filter.max_gap_s == 0.25


def test_a_guessed_robot_is_taken_where_none_is_named(tmp_path: Path) -> None:
    assert resolve(guess="daisy").robot.name == "daisy"
    assert resolve(None, _file(tmp_path, {"robot": {"preset": "go1"}}), guess="daisy").robot.name == "go1"


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["filter.profil=paper"], ["there is no filter.profil", "--set", "profile"]),
        (["fliter.profile=paper"], ["there is no fliter", "filter"]),
        (["filter.robust.gate_probability=2"], ["filter.robust.gate_probability = 2", "less than 1"]),
        (["filter.profile=papper"], ["papper", "'robust' or 'paper'"]),
        (["filter=5"], ["filter = 5"]),
        (["filter="], ["filter = None"]),
        (["robot=go1"], ["robot = 'go1'", "--robot"]),
        (["robot.filter=7"], ["robot.filter = 7"]),
        (["filter.max_gap_s=.nan"], ["filter.max_gap_s = nan", "finite"]),
        (["filter.max_gap_s"], ["key.subkey=value"]),
    ],
)
def test_a_wrong_setting_is_named_with_the_choices(settings: list[str], words: list[str]) -> None:
    with pytest.raises(ConfigError) as caught:
        resolve("daisy", None, settings)
    assert [word for word in words if word not in str(caught.value)] == []


def test_without_a_robot_there_is_none(tmp_path: Path) -> None:
    config = resolve(settings=["smoother.keyframes=7"])
    assert config.robot is None
    assert config.on_recording(ImuCalibration()) == config
    write_yaml(config, tmp_path / "config.yaml")
    assert resolve(None, tmp_path / "config.yaml") == config
    assert resolve("go1", tmp_path / "config.yaml").smoother.keyframes == 7


def test_changes_to_a_robot_that_is_not_named_list_the_known_ones() -> None:
    with pytest.raises(
        ConfigError, match=r"--set changes robot\.encoder_noise_rad, but no robot is named: give --robot .*daisy, .*go1"
    ):
        resolve(settings=["robot.encoder_noise_rad=0.004"])


def test_an_unknown_robot_lists_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"no robot 'spot'; .*daisy, .*go1"):
        resolve("spot")


def test_a_wrong_key_in_a_file_names_the_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"config\.yaml: there is no evaluation\.algnment; .*alignment"):
        resolve("daisy", _file(tmp_path, {"evaluation": {"algnment": "se3"}}))


def test_the_recordings_imu_calibration_counts_unless_the_robots_is_asked_for() -> None:
    recorded = ImuCalibration(position_body_m=(0.1, 0.2, 0.3), gyroscope_noise_density=1e-3)
    config = resolve("go1")
    assert config.on_recording(recorded).robot.imu == recorded
    assert config.on_recording(None) == config
    own = resolve("go1", settings=["imu_calibration=robot"])
    assert own.on_recording(recorded).robot.imu == load_robot("go1").imu


def test_a_configured_imu_counts_whatever_the_recording_has() -> None:
    recorded = ImuCalibration(gyroscope_noise_density=1e-3)
    configured = resolve("go1", settings=["robot.imu.gyroscope_noise_density=0.5"])
    assert configured.on_recording(recorded).robot.imu.gyroscope_noise_density == 0.5
    contradictory = resolve("go1", settings=["robot.imu.gyroscope_noise_density=0.5", "imu_calibration=recording"])
    assert contradictory.on_recording(recorded).robot.imu == recorded


def test_a_recording_without_a_grade_leaves_that_of_the_robots_imu() -> None:
    config = resolve("go1", settings=["robot.imu.grade=calibrated_mems", "imu_calibration=recording"])
    assert config.robot.imu.accelerometer_bias == ERRORS_OF_GRADE["calibrated_mems"].accelerometer_bias
    noisy = config.on_recording(ImuCalibration(gyroscope_noise_density=1e-3)).robot.imu
    assert noisy.gyroscope_noise_density == 1e-3
    assert noisy.accelerometer_bias == config.robot.imu.accelerometer_bias
    graded = config.on_recording(ImuCalibration(grade="tactical")).robot.imu
    assert graded.accelerometer_bias == ERRORS_OF_GRADE["tactical"].accelerometer_bias

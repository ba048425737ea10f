# SPDX-License-Identifier: BSD-3-Clause
import pytest

from coclo_vio.datasets.contents import RecordingContents
from coclo_vio.datasets.dataset import DatasetConfig, guess_robot, open_dataset
from coclo_vio.datasets.writer import write_euroc_folder, write_leg_log
from coclo_vio.robot.description import load_robot
from coclo_vio.values.config import parse_settings
from coclo_vio.values.errors import ConfigError, DatasetError
from coclo_vio.values.measurements import JointSample


def to_euroc_folder(folder, robot, measurements):
    return write_euroc_folder(folder, RecordingContents(robot, measurements))


def one_sample_of(robot):
    size = len(robot.joint_names)
    return [JointSample(0, [0.0] * size, [0.0] * size, [0.0] * size)]


def test_an_unknown_layout_says_what_was_looked_for(tmp_path, biped):
    (tmp_path / "notes.txt").write_text("nothing here")
    for path in (tmp_path, tmp_path / "notes.txt"):
        with pytest.raises(DatasetError, match=r"mav0/imu0/data\.csv.*image_0 and image_1.*\.mat.*leg log") as error:
            open_dataset(path, biped)
        assert str(path) in str(error.value)


def test_a_path_that_is_not_there_is_named(tmp_path, biped):
    with pytest.raises(DatasetError, match=r"there is no .*nowhere"):
        open_dataset(tmp_path / "nowhere", biped)


@pytest.mark.parametrize("write", [write_leg_log, to_euroc_folder])
def test_the_robot_is_guessed_from_the_joints(tmp_path, write):
    for name in ("daisy", "anymal_b"):
        robot = load_robot(name)
        write(tmp_path / name / "trial", robot, one_sample_of(robot))
        assert guess_robot(tmp_path / name / "trial") == name


@pytest.mark.parametrize("write", [write_leg_log, to_euroc_folder])
def test_robots_that_share_their_joints_are_told_apart_by_name_or_not_at_all(tmp_path, write):
    robot = load_robot("go1")
    for folder, wanted in (("walk_go1_3", "go1"), ("A1-indoor", "a1"), ("data1", None), ("go1_and_a1", None)):
        write(tmp_path / folder, robot, one_sample_of(robot))
        assert guess_robot(tmp_path / folder) == wanted


def test_a_log_of_no_known_robot_is_not_guessed(tmp_path, biped):
    write_leg_log(tmp_path, biped, one_sample_of(biped))
    assert guess_robot(tmp_path) is None


def test_the_real_logs(shared_data):
    assert guess_robot(shared_data / "go1_mocap") == "go1"
    assert guess_robot(shared_data / "euroc_v1_01_start") is None


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("colums.stamp_ns=[t]", "there is no colums"),
        ("columns.position=['q']", "must hold {joint} once"),
        ("columns.force=['{leg}{leg}']", "must hold {leg} once"),
        ("joint_velocity.window_s=0", "greater than 0"),
    ],
)
def test_a_wrong_setting_is_refused(setting, said):
    with pytest.raises(ConfigError, match=said):
        DatasetConfig.parse(parse_settings([setting]), "--set")

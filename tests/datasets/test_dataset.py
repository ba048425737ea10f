# SPDX-License-Identifier: BSD-3-Clause
"""Opening a recording of any format, the registry of formats, and the robot inferred from the joints."""

from pathlib import Path

import numpy as np
import pytest

from coclo_vio.datasets import dataset
from coclo_vio.datasets.dataset import DatasetConfig, guess_robot, open_dataset, register_format
from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.recording_reader import RecordingReader
from coclo_vio.datasets.writer import write_euroc_folder, write_leg_log
from coclo_vio.robot.description import load_robot
from coclo_vio.values.config import parse_settings
from coclo_vio.values.errors import ConfigError, DatasetError
from coclo_vio.values.measurements import ImuSample, JointSample
from coclo_vio.values.units import GRAVITY_MPS2


def to_euroc_folder(folder, robot, measurements):
    return write_euroc_folder(folder, RecordingContents(robot, measurements))


def one_sample_of(robot):
    size = len(robot.joint_names)
    return [JointSample(0, [0.0] * size, [0.0] * size, [0.0] * size)]


def test_an_unknown_layout_lists_the_formats(tmp_path, biped):
    (tmp_path / "notes.txt").write_text("nothing here")
    for path in (tmp_path, tmp_path / "notes.txt"):
        with pytest.raises(DatasetError, match=r"mav0/imu0/data\.csv.*image_0 and image_1.*\.mat.*leg log") as error:
            open_dataset(path, biped)
        assert str(path) in str(error.value)
        for known in dataset.FORMATS:
            assert f"{known.name} ({known.layout})" in str(error.value)


def test_a_path_that_does_not_exist_is_named(tmp_path, biped):
    with pytest.raises(DatasetError, match=r"nowhere does not exist"):
        open_dataset(tmp_path / "nowhere", biped)


@pytest.mark.parametrize("write", [write_leg_log, to_euroc_folder])
def test_the_robot_is_guessed_from_the_joints(tmp_path, write):
    for name in ("daisy", "anymal_b"):
        robot = load_robot(name)
        write(tmp_path / name / "trial", robot, one_sample_of(robot))
        assert guess_robot(tmp_path / name / "trial") == name


@pytest.mark.parametrize("write", [write_leg_log, to_euroc_folder])
def test_robots_that_share_their_joints_are_distinguished_by_name_or_not_at_all(tmp_path, write):
    robot = load_robot("go1")
    for folder, name in (("walk_go1_3", "go1"), ("A1-indoor", "a1"), ("data1", None), ("go1_and_a1", None)):
        write(tmp_path / folder, robot, one_sample_of(robot))
        assert guess_robot(tmp_path / folder) == name


def test_a_log_of_no_known_robot_is_not_guessed(tmp_path, biped):
    write_leg_log(tmp_path, biped, one_sample_of(biped))
    assert guess_robot(tmp_path) is None


def test_the_real_logs(shared_data):
    assert guess_robot(shared_data / "go1_mocap") == "go1"
    assert guess_robot(shared_data / "euroc_v1_01_start") is None


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("colums.stamp_ns=[t]", "there is no colums"),
        ("columns.position=['q']", "must hold {joint} once"),
        ("columns.force=['{leg}{leg}']", "must hold {leg} once"),
        ("joint_velocity.window_s=0", "greater than 0"),
    ],
)
def test_a_wrong_setting_is_refused(setting, message):
    with pytest.raises(ConfigError, match=message):
        DatasetConfig.parse(parse_settings([setting]), "--set")


class GyroText(RecordingReader):
    """A format that the package does not know: a text file with a line `stamp_ns wx wy wz` for each IMU sample."""

    format_name = "gyro text"

    def __init__(self, path, robot, config):
        super().__init__(path.stem, config)
        self._path = path

    def _samples(self, tally):
        tally.note("specific force is not recorded: standard gravity is assumed")
        for line in self._path.read_text().splitlines():
            stamp, *rate = line.split()
            yield ImuSample(int(stamp), np.array(rate, dtype=float), np.array([0.0, 0.0, GRAVITY_MPS2]))


@pytest.fixture
def gyro_text(monkeypatch):
    """Registers the format for one test."""
    monkeypatch.setattr(dataset, "FORMATS", [*dataset.FORMATS])
    register_format("gyro text", lambda path: path.suffix == ".gyro", GyroText, layout="a .gyro file")


@pytest.mark.usefixtures("gyro_text")
def test_a_registered_format_is_opened_like_the_known_ones(tmp_path):
    path = tmp_path / "walk.gyro"
    path.write_text("5 0.1 0.2 0.3\n15 0.4 0.5 0.6\n")
    recording = open_dataset(path, None)
    samples = list(recording.measurements())
    assert [sample.stamp_ns for sample in samples] == [5, 15]
    np.testing.assert_array_equal(samples[1].angular_velocity, [0.4, 0.5, 0.6])
    report = recording.report()
    assert (recording.name, report.format, report.stream("imu").samples) == ("walk", "gyro text", 2)
    assert report.notes == ("specific force is not recorded: standard gravity is assumed",)
    assert recording.ground_truth() is None
    assert (recording.imu_calibration(), recording.stereo_calibration()) == (None, None)
    assert guess_robot(path) is None


@pytest.mark.usefixtures("gyro_text")
def test_a_registered_format_is_among_those_listed_and_its_name_is_taken(tmp_path):
    (tmp_path / "notes.txt").write_text("nothing here")
    with pytest.raises(DatasetError, match=r"the formats are: gyro text \(a \.gyro file\); EuRoC folder"):
        open_dataset(tmp_path / "notes.txt", None)
    with pytest.raises(DatasetError, match=r"the format gyro text is registered already; choose a name other than"):
        register_format("gyro text", Path.is_file, GyroText)


@pytest.mark.usefixtures("gyro_text")
def test_a_registered_format_goes_before_the_known_ones(tmp_path, biped):
    write_leg_log(tmp_path, biped, one_sample_of(biped))
    log = tmp_path / "leg_log.csv"
    assert open_dataset(log, biped).report().format == "leg log"
    register_format("my log", lambda path: path == log, GyroText)
    assert isinstance(open_dataset(log, biped), GyroText)

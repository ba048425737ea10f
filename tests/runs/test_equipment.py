# SPDX-License-Identifier: BSD-3-Clause
"""What a recording has for estimators to work with."""

from pathlib import Path

import pytest
from tiny_recordings import BODY_IMU, CAMERA_IMU, camera_imu, imu, joints, tiny_cameras, write_still

from coclo_vio.datasets.dataset import DatasetConfig, open_dataset
from coclo_vio.datasets.euroc_folder import EurocFolder
from coclo_vio.datasets.read_report import ReadReport
from coclo_vio.robot.description import load_robot
from coclo_vio.runs.equipment import Equipment, check_pictures, sensors_of
from coclo_vio.runs.run_config import resolve
from coclo_vio.values.errors import ConfigError, DatasetError
from coclo_vio.values.measurements import (
    LEG_SENSORS,
    VISION_SENSORS,
    BodyTwistSample,
    CameraImuSample,
    ImuSample,
    StereoFrame,
    StereoTracks,
)

DAISY = load_robot("daisy")


def test_cameras_take_their_own_imu_where_it_was_recorded(tmp_path: Path) -> None:
    both = open_dataset(write_still(tmp_path / "both", imu() + camera_imu()), None)
    body = open_dataset(write_still(tmp_path / "body", imu()), None)
    equipment = Equipment.of(both, resolve(), VISION_SENSORS)
    assert equipment.require_vision_imu() == (CameraImuSample, CAMERA_IMU)
    assert (equipment.imu, equipment.camera_imu, equipment.stereo) == (BODY_IMU, CAMERA_IMU, tiny_cameras())
    assert equipment.sensors == {ImuSample, CameraImuSample, StereoFrame}
    assert equipment.has_frames
    assert Equipment.of(body, resolve(), VISION_SENSORS).require_vision_imu() == (ImuSample, BODY_IMU)


@pytest.mark.parametrize(
    ("equipment", "kind"),
    [
        (Equipment(camera_imu=CAMERA_IMU, sensors=frozenset({CameraImuSample})), CameraImuSample),
        (Equipment(imu=BODY_IMU, sensors=frozenset({CameraImuSample})), None),
        (Equipment(imu=BODY_IMU, sensors=frozenset({CameraImuSample, ImuSample})), ImuSample),
        (Equipment(imu=BODY_IMU, camera_imu=CAMERA_IMU, sensors=frozenset({ImuSample})), ImuSample),
        (Equipment(sensors=frozenset({ImuSample, CameraImuSample})), None),
    ],
)
def test_the_imu_of_vision_has_samples_and_a_known_mounting(equipment: Equipment, kind: type | None) -> None:
    assert equipment.vision_imu is kind
    known = equipment.known_vision_imu
    assert (None if known is None else known[0]) is kind


def test_the_imu_of_the_robots_description_counts_for_vision_too(tmp_path: Path) -> None:
    dataset = open_dataset(write_still(tmp_path, imu()), DAISY)
    config = resolve("daisy")
    assert Equipment.of(dataset, config, VISION_SENSORS).imu == DAISY.imu
    assert Equipment.of(dataset, config.on_recording(BODY_IMU), VISION_SENSORS).imu == BODY_IMU


def test_a_mode_of_legs_reads_no_calibration_of_the_cameras(tmp_path: Path) -> None:
    folder = write_still(tmp_path, imu() + joints())
    (folder / "mav0" / "cam0" / "sensor.yaml").write_text("T_BS: [", encoding="utf-8")
    equipment = Equipment.of(open_dataset(folder, DAISY), resolve("daisy"), LEG_SENSORS)
    assert equipment.require_robot().leg_names == DAISY.leg_names
    assert equipment.stereo is None


def test_pictures_are_part_of_the_equipment() -> None:
    assert Equipment().pictures_every is None
    assert Equipment(name="walk").with_pictures(3).pictures_every == 3
    assert Equipment(name="walk").with_pictures(3).name == "walk"


def test_pictures_are_of_every_first_frame_at_least() -> None:
    check_pictures(None)
    check_pictures(1)
    with pytest.raises(ConfigError, match=r"pictures_every = 0: give 1 for a picture of every frame"):
        check_pictures(0)


def test_tracks_are_cameras_without_frames() -> None:
    tracks = Equipment(stereo=tiny_cameras(), sensors=frozenset({StereoTracks}))
    assert tracks.require_cameras() == tiny_cameras()
    assert not tracks.has_frames


def test_a_body_twist_is_required_of_the_samples() -> None:
    Equipment(sensors=frozenset({BodyTwistSample})).require_body_twist()


def test_without_a_robot_the_known_ones_are_listed() -> None:
    with pytest.raises(ConfigError, match=r"--robot\) by its name or a YAML file; known robots are: .*daisy, .*go1"):
        Equipment().require_robot()


def test_sensors_are_those_with_samples(film: Path) -> None:
    assert sensors_of(open_dataset(film, None)) == {ImuSample, StereoFrame}


def test_a_recording_that_cannot_be_read_through_has_no_known_sensors(film: Path) -> None:
    class Broken(EurocFolder):
        def report(self) -> ReadReport:
            raise DatasetError("line 7: mend it")

    assert sensors_of(Broken(film, None, DatasetConfig())) == frozenset()

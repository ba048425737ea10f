# SPDX-License-Identifier: BSD-3-Clause
"""What a recording is equipped with, and which modes suit it."""

from pathlib import Path

import numpy as np
import pytest

from coclo_vio.datasets import images
from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.writer import write_euroc_folder
from coclo_vio.geometry import se3
from coclo_vio.robot.description import load_robot
from coclo_vio.runs.equipment import LEG_MODES, Equipment, compared_modes, default_mode
from coclo_vio.runs.run_config import resolve
from coclo_vio.values.calibration import CameraCalibration, ImuCalibration, StereoCalibration, matrix4
from coclo_vio.values.measurements import (
    LEG_SENSORS,
    VISION_SENSORS,
    CameraImuSample,
    EncodedStereoFrame,
    ImuSample,
    JointSample,
    Measurement,
    StereoFrame,
)

DAISY = load_robot("daisy")
BODY_IMU = ImuCalibration(gyroscope_noise_density=3e-4)
CAMERA_IMU = ImuCalibration(position_body_m=(0.2, 0.0, 0.1))
STAMPS_NS = range(0, 200_000_000, 10_000_000)
LEVEL = np.array([0.0, 0.0, 9.81])


def imu() -> list[Measurement]:
    return [ImuSample(stamp_ns, np.zeros(3), LEVEL) for stamp_ns in STAMPS_NS]


def camera_imu() -> list[Measurement]:
    return [CameraImuSample(stamp_ns, np.zeros(3), LEVEL) for stamp_ns in STAMPS_NS]


def joints() -> list[Measurement]:
    return [JointSample(stamp_ns, *np.zeros((3, len(DAISY.joint_names)))) for stamp_ns in STAMPS_NS]


def pictures() -> list[EncodedStereoFrame]:
    data = images.encoded(np.full((6, 8), 90, dtype=np.uint8), "png")
    return [EncodedStereoFrame(stamp_ns, data, data, "png") for stamp_ns in STAMPS_NS[::5]]


def cameras() -> StereoCalibration:
    lens = CameraCalibration(width_px=8, height_px=6, focal_px=(5.0, 5.0), principal_point_px=(3.5, 2.5))
    T_body_right = se3.transform(np.eye(3), np.array([0.05, 0.0, 0.0]))
    return StereoCalibration(
        left=lens, right=lens, body_left_camera=matrix4(np.eye(4)), body_right_camera=matrix4(T_body_right)
    )


def recorded(folder: Path, measurements: list[Measurement], *, sees: bool) -> Path:
    contents = RecordingContents(
        DAISY,
        sorted(measurements, key=lambda sample: sample.stamp_ns),
        imu=BODY_IMU,
        camera_imu=CAMERA_IMU,
        stereo=cameras() if sees else None,
        frames=pictures() if sees else (),
    )
    write_euroc_folder(folder, contents)
    return folder


@pytest.mark.parametrize(
    ("robot", "measurements", "sees", "modes"),
    [
        ("daisy", imu() + joints(), True, (*LEG_MODES, "vins", "combined")),
        ("daisy", imu() + joints(), False, LEG_MODES),
        (None, imu() + joints(), True, ("vins", "stereo")),
        (None, imu(), True, ("vins", "stereo")),
        (None, camera_imu(), True, ("vins", "stereo")),
        (None, [], True, ("stereo",)),
        ("daisy", imu(), True, ("vins", "stereo")),
        (None, imu(), False, LEG_MODES),
    ],
)
def test_legs_come_first_and_then_eyes_with_an_imu(
    robot: str | None, measurements: list[Measurement], sees: bool, modes: tuple[str, ...], tmp_path: Path
) -> None:
    recording = recorded(tmp_path, measurements, sees=sees)
    assert compared_modes(recording, resolve(robot)) == modes
    assert default_mode(recording, resolve(robot)) == ("combined" if "combined" in modes else modes[0])


def test_eyes_of_unknown_lenses_are_left_out_beside_legs(tmp_path: Path) -> None:
    recording = recorded(tmp_path, imu() + joints(), sees=True)
    (recording / "mav0" / "cam0" / "sensor.yaml").unlink()
    assert compared_modes(recording, resolve("daisy")) == LEG_MODES
    (recording / "mav0" / "cam0" / "sensor.yaml").write_text("T_BS: [", encoding="utf-8")
    assert compared_modes(recording, resolve("daisy")) == LEG_MODES


def test_eyes_take_the_imu_of_their_own_where_it_is_there(tmp_path: Path) -> None:
    both = open_dataset(recorded(tmp_path / "both", imu() + camera_imu(), sees=True), None)
    body = open_dataset(recorded(tmp_path / "body", imu(), sees=True), None)
    equipment = Equipment.of(both, resolve(), VISION_SENSORS)
    assert equipment.eye_imu is CameraImuSample
    assert (equipment.imu, equipment.camera_imu, equipment.stereo) == (BODY_IMU, CAMERA_IMU, cameras())
    assert equipment.sensors == {ImuSample, CameraImuSample, StereoFrame}
    assert Equipment.of(body, resolve(), VISION_SENSORS).eye_imu is ImuSample
    blind = Equipment(camera_imu=CAMERA_IMU, sensors=frozenset({CameraImuSample}))
    assert blind.eye_imu is CameraImuSample
    assert Equipment(imu=BODY_IMU, sensors=frozenset({CameraImuSample})).eye_imu is None


def test_the_robot_s_word_on_its_imu_counts_for_eyes_too(tmp_path: Path) -> None:
    dataset = open_dataset(recorded(tmp_path, imu(), sees=True), DAISY)
    config = resolve("daisy")
    assert Equipment.of(dataset, config, VISION_SENSORS).imu == DAISY.imu
    assert Equipment.of(dataset, config.on_recording(BODY_IMU), VISION_SENSORS).imu == BODY_IMU


def test_legs_ask_nothing_of_the_cameras(tmp_path: Path) -> None:
    folder = recorded(tmp_path, imu() + joints(), sees=True)
    (folder / "mav0" / "cam0" / "sensor.yaml").write_text("T_BS: [", encoding="utf-8")
    equipment = Equipment.of(open_dataset(folder, DAISY), resolve("daisy"), LEG_SENSORS)
    assert equipment.legs().leg_names == DAISY.leg_names
    assert equipment.stereo is None

# SPDX-License-Identifier: BSD-3-Clause
"""Which modes a recording is enough for, and the default one."""

from pathlib import Path

import pytest
from tiny_recordings import camera_imu, imu, joints, write_still

from coclo_vio.runs import mode_choice
from coclo_vio.runs.mode_choice import compared_modes, default_mode
from coclo_vio.runs.modes.mode import Mode, Need
from coclo_vio.runs.modes.registry import mode_of, register_mode, unregister_mode
from coclo_vio.runs.run_config import resolve
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.measurements import BodyTwistSample, Measurement

OF_LEGS = ("coclo", "coclo_paper", "inekf", "naive")
OF_ALL = ("coclo", "vins", "combined", "coclo_paper", "inekf", "naive")


@pytest.mark.parametrize(
    ("robot", "measurements", "has_cameras", "compared", "default"),
    [
        ("daisy", imu() + joints(), True, OF_ALL, "combined"),
        ("daisy", imu() + joints(), False, OF_LEGS, "coclo"),
        (None, imu() + joints(), True, ("vins", "stereo"), "vins"),
        (None, imu(), True, ("vins", "stereo"), "vins"),
        (None, camera_imu(), True, ("vins", "stereo"), "vins"),
        (None, [], True, ("stereo",), "stereo"),
        ("daisy", imu(), True, ("vins", "stereo"), "vins"),
        (None, imu(), False, OF_LEGS, "coclo"),
    ],
)
def test_modes_follow_from_robot_sensors_and_calibrations(
    robot: str | None,
    measurements: list[Measurement],
    has_cameras: bool,
    compared: tuple[str, ...],
    default: str,
    tmp_path: Path,
) -> None:
    recording = write_still(tmp_path, measurements, has_cameras=has_cameras)
    assert compared_modes(recording, resolve(robot)) == compared
    assert default_mode(recording, resolve(robot)) == default


@pytest.mark.parametrize("text", [None, "T_BS: ["], ids=["missing", "malformed"])
def test_cameras_without_a_usable_calibration_are_left_out_beside_legs(text: str | None, tmp_path: Path) -> None:
    recording = write_still(tmp_path, imu() + joints(), has_cameras=True)
    lens = recording / "mav0" / "cam0" / "sensor.yaml"
    if text is None:
        lens.unlink()
    else:
        lens.write_text(text, encoding="utf-8")
    assert compared_modes(recording, resolve("daisy")) == OF_LEGS
    assert default_mode(recording, resolve("daisy")) == "coclo"


def test_cameras_without_calibration_alone_are_tried_so_that_the_error_gives_the_next_step(tmp_path: Path) -> None:
    recording = write_still(tmp_path, imu(), has_cameras=True)
    (recording / "mav0" / "cam0" / "sensor.yaml").unlink()
    assert compared_modes(recording, resolve()) == ("vins", "stereo")


def test_no_recording_has_no_modes(tmp_path: Path) -> None:
    for choose in (compared_modes, default_mode):
        with pytest.raises(DatasetError, match="does not exist"):
            choose(tmp_path / "missing", resolve())


def test_a_body_twist_without_cameras_is_enough_for_a_mode_that_needs_nothing_else(
    film: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mode_choice, "sensors_of", lambda dataset: frozenset({BodyTwistSample}))
    register_mode(Mode("twist", "", frozenset({Need.BODY_TWIST}), mode_of("stereo_twist").make, default_rank=-1))
    try:
        assert compared_modes(film, resolve()) == (*OF_LEGS, "twist")
        assert default_mode(film, resolve()) == "twist"
    finally:
        unregister_mode("twist")

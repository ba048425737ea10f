# SPDX-License-Identifier: BSD-3-Clause
"""A recording through the API: robot, configuration, calibration, measurements, inspection."""

from pathlib import Path

import numpy as np
import pytest

import coclo_vio as cv


def test_a_known_robot_is_found_by_its_joints(leg_log: Path) -> None:
    recording = cv.open(leg_log)
    assert recording.robot is not None
    assert (recording.name, recording.robot.name) == ("walk", "daisy")


def test_the_robot_is_a_name_a_file_or_a_description(leg_log: Path, tmp_path: Path) -> None:
    daisy = cv.load_robot("daisy")
    urdf = Path(daisy.urdf)
    (tmp_path / "mine.yaml").write_text(
        (urdf.parent / "daisy.yaml").read_text(encoding="utf-8").replace("urdf: daisy.urdf", f"urdf: {urdf}"),
        encoding="utf-8",
    )
    for robot in ("daisy", tmp_path / "mine.yaml", str(tmp_path / "mine.yaml"), daisy):
        assert cv.open(leg_log, robot=robot).robot == daisy


def test_settings_win_over_a_file(leg_log: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("filter: {profile: paper, max_gap_s: 0.2}", encoding="utf-8")
    recording = cv.open(leg_log, config=tmp_path / "mine.yaml", settings=["filter.profile=robust"])
    assert (recording.config.filter.profile, recording.config.filter.max_gap_s) == ("robust", 0.2)


def test_measurements_come_in_time_order_from_the_beginning_each_time(leg_log: Path) -> None:
    recording = cv.open(leg_log)
    first = [measurement.stamp_ns for measurement in recording.measurements()]
    assert first == sorted(first)
    assert [measurement.stamp_ns for measurement in recording.measurements()] == first
    joints = list(recording.measurements(frozenset({cv.JointSample})))
    assert {type(sample) for sample in joints} == {cv.JointSample}
    assert len(joints) == 301


def test_the_calibration_is_that_of_the_recording_or_of_the_robot(go1_walk: Path, leg_log: Path) -> None:
    recorded = cv.open(go1_walk, robot="go1").calibration
    assert recorded.stereo is not None
    assert recorded.stereo.baseline_m == pytest.approx(0.06)
    go1 = cv.load_robot("go1")
    assert recorded.imu is not None
    np.testing.assert_allclose(recorded.imu.T_body_imu, go1.imu.T_body_imu, atol=1e-12)
    assert recorded.camera_imu is None
    without = cv.open(leg_log).calibration
    assert without.stereo is None
    assert without.imu == cv.load_robot("daisy").imu, "a leg log holds no mounting"


def test_an_inspection_lists_what_modes_lack(leg_log: Path) -> None:
    inspection = cv.open(leg_log).inspect()
    assert inspection.missing["coclo"] == ()
    assert inspection.missing["stereo"] == ("stereo images", "calibration of the cameras")


def test_the_bundled_recording_is_one_of_a_daisy() -> None:
    recording = cv.open(cv.sample_path())
    assert recording.robot is not None
    assert recording.robot.name == "daisy"

# SPDX-License-Identifier: BSD-3-Clause
"""One number from two sources: agreement is silent, a difference is named with the source that counts."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

import coclo_vio as cv
from coclo_vio.experiments.contradictions.content import sample_content
from coclo_vio.geometry import se3
from coclo_vio.values.calibration import ImuCalibration, StereoCalibration, matrix4

_KINDS = {"calibrations_disagree", "imu_mountings_disagree"}


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds of the sample with a few images."""
    content = sample_content()
    short = replace(content, measurements=content.measurements[:800], frames=content.frames[:3])
    return short.write(tmp_path_factory.mktemp("bag"), "bag")


def _camchain(path: Path, stereo: StereoCalibration, imu: ImuCalibration) -> Path:
    """The calibration as Kalibr writes it."""
    cameras = {}
    for name, lens, T_body_camera in (
        ("cam0", stereo.left, stereo.T_body_left_camera),
        ("cam1", stereo.right, stereo.T_body_right_camera),
    ):
        cameras[name] = {
            "camera_model": "pinhole",
            "distortion_model": "radtan",
            "distortion_coeffs": [0.0, 0.0, 0.0, 0.0],
            "intrinsics": [*lens.focal_px, *lens.principal_point_px],
            "resolution": [lens.width_px, lens.height_px],
            "T_cam_imu": (se3.inverse(T_body_camera) @ imu.T_body_imu).tolist(),
        }
    path.write_text(yaml.safe_dump(cameras))
    return path


def _found(bag: Path, camchain: Path) -> list[str]:
    recording = cv.open(bag, robot="daisy", settings=[f"dataset.rosbag.kalibr.camchain={camchain}"])
    return [finding.sentence for finding in recording.inspect().findings if finding.kind in _KINDS]


@pytest.mark.long
def test_a_camchain_that_agrees_is_silent_and_one_that_does_not_is_named(bag: Path, tmp_path: Path) -> None:
    calibration = cv.open(bag, robot="daisy").calibration
    stereo, imu = calibration.stereo, calibration.imu
    assert stereo is not None
    assert imu is not None
    assert _found(bag, _camchain(tmp_path / "same.yaml", stereo, imu)) == []
    focal_px = (1.1 * stereo.left.focal_px[0], 1.1 * stereo.left.focal_px[1])
    other = stereo.model_copy(update={"left": stereo.left.model_copy(update={"focal_px": focal_px})})
    (sentence,) = _found(bag, _camchain(tmp_path / "focal.yaml", other, imu))
    assert "focal length of the left camera" in sentence
    assert "focal.yaml is used" in sentence
    T_left_right = se3.inverse(stereo.T_body_left_camera) @ stereo.T_body_right_camera
    T_left_right[:3, 3] *= 1.5
    other = stereo.model_copy(update={"body_right_camera": matrix4(stereo.T_body_left_camera @ T_left_right)})
    (sentence,) = _found(bag, _camchain(tmp_path / "baseline.yaml", other, imu))
    assert "baseline" in sentence
    assert "0.075 m" in sentence


def test_two_mountings_of_the_body_imu_are_named_where_both_are_given(bag: Path) -> None:
    robot = cv.load_robot("daisy")
    rolled = robot.imu.model_copy(update={"rotation_body_imu_rpy_rad": (0.3, 0.0, 0.0)})
    rolled = ImuCalibration(**rolled.model_dump())
    recording = cv.open(bag, robot=robot.model_copy(update={"imu": rolled}))
    (finding,) = [each for each in recording.inspect().findings if each.kind in _KINDS]
    assert finding.kind == "imu_mountings_disagree"
    assert f"{np.degrees(0.3):.0f} deg" in finding.sentence

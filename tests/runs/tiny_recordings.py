# SPDX-License-Identifier: BSD-3-Clause
"""Tiny recordings: a film without a robot, and any sensors of a body at rest."""

from pathlib import Path

import numpy as np

from coclo_vio.datasets import images
from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.writer import write_euroc_folder
from coclo_vio.geometry import se3
from coclo_vio.robot.description import load_robot
from coclo_vio.values.calibration import CameraCalibration, ImuCalibration, StereoCalibration, matrix4
from coclo_vio.values.measurements import (
    CameraImuSample,
    EncodedStereoFrame,
    ImuSample,
    JointSample,
    Measurement,
)
from coclo_vio.values.trajectory import GroundTruth, Trajectory

FILM_START_NS = 1_700_000_000_000_000_000
BODY_IMU = ImuCalibration(gyroscope_noise_density=3e-4)
CAMERA_IMU = ImuCalibration(position_body_m=(0.2, 0.0, 0.1))
_STILL_NS = range(0, 200_000_000, 10_000_000)
_LEVEL = np.array([0.0, 0.0, 9.81])


def tiny_cameras() -> StereoCalibration:
    """A rectified pair of 8 x 6 pixels with a baseline of 0.05 m at the body's origin."""
    lens = CameraCalibration(width_px=8, height_px=6, focal_px=(5.0, 5.0), principal_point_px=(3.5, 2.5))
    T_body_right = se3.transform(np.eye(3), np.array([0.05, 0.0, 0.0]))
    return StereoCalibration(
        left=lens, right=lens, body_left_camera=matrix4(np.eye(4)), body_right_camera=matrix4(T_body_right)
    )


def tiny_frames(stamps_ns: range, brightness: int = 0) -> list[EncodedStereoFrame]:
    data = images.encoded(np.full((6, 8), brightness, dtype=np.uint8), "png")
    return [EncodedStereoFrame(stamp_ns, data, data, "png") for stamp_ns in stamps_ns]


def write_film(folder: Path) -> None:
    """Two seconds of dark images at 10 Hz, four of an IMU and of a body at rest; no robot."""
    stamps_ns = range(FILM_START_NS, FILM_START_NS + 4_000_000_000, 100_000_000)
    still = Trajectory(np.array(stamps_ns), np.tile(np.eye(4), (len(stamps_ns), 1, 1)))
    contents = RecordingContents(
        load_robot("daisy"),
        [ImuSample(stamp_ns, np.zeros(3), np.array([0.0, 0.0, 9.81])) for stamp_ns in stamps_ns],
        ground_truth=GroundTruth(still, True, "truth"),
        stereo=tiny_cameras(),
        frames=tiny_frames(stamps_ns[:20]),
    )
    write_euroc_folder(folder, contents)


def imu() -> list[Measurement]:
    return [ImuSample(stamp_ns, np.zeros(3), _LEVEL) for stamp_ns in _STILL_NS]


def camera_imu() -> list[Measurement]:
    return [CameraImuSample(stamp_ns, np.zeros(3), _LEVEL) for stamp_ns in _STILL_NS]


def joints() -> list[Measurement]:
    """Of a Daisy."""
    return [JointSample(stamp_ns, *np.zeros((3, 18))) for stamp_ns in _STILL_NS]


def write_still(folder: Path, measurements: list[Measurement], *, has_cameras: bool = True) -> Path:
    """A fifth of a second of these samples, with the calibration of both IMUs; with cameras or without."""
    contents = RecordingContents(
        load_robot("daisy"),
        sorted(measurements, key=lambda sample: sample.stamp_ns),
        imu=BODY_IMU,
        camera_imu=CAMERA_IMU,
        stereo=tiny_cameras() if has_cameras else None,
        frames=tiny_frames(_STILL_NS[::5], 90) if has_cameras else (),
    )
    write_euroc_folder(folder, contents)
    return folder

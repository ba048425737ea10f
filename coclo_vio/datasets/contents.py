# SPDX-License-Identifier: BSD-3-Clause
"""What the writers write: everything a recording may hold, whatever the format."""

from collections.abc import Iterable
from dataclasses import dataclass

from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.calibration import ImuCalibration, StereoCalibration
from coclo_vio.values.measurements import EncodedStereoFrame, Measurement
from coclo_vio.values.trajectory import GroundTruth


@dataclass(frozen=True, slots=True)
class RecordingContents:
    """A recording on its way to the disk; ``measurements`` and ``frames`` are streamed once.

    Attributes:
        robot: whose joints and legs the measurements are of, in the order of its legs.
        measurements: samples of all sensors but the cameras, in time order.
        ground_truth: the reference trajectory of the body, stamped by the clock of whoever watched.
        imu: mounting and noise of the body's IMU.
        camera_imu: mounting and noise of the camera's IMU.
        stereo: lenses and mounting of the cameras.
        frames: images as they are to be stored, in time order.
    """

    robot: RobotDescription
    measurements: Iterable[Measurement]
    ground_truth: GroundTruth | None = None
    imu: ImuCalibration | None = None
    camera_imu: ImuCalibration | None = None
    stereo: StereoCalibration | None = None
    frames: Iterable[EncodedStereoFrame] = ()

# SPDX-License-Identifier: BSD-3-Clause
"""The input of the writers: all that a recording may hold, in any format."""

from collections.abc import Iterable
from dataclasses import dataclass

from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.calibration import ImuCalibration, StereoCalibration
from coclo_vio.values.measurements import EncodedStereoFrame, Measurement
from coclo_vio.values.trajectory import GroundTruth


@dataclass(frozen=True, slots=True)
class RecordingContents:
    """A recording to be written; ``measurements`` and ``frames`` are streamed once.

    Attributes:
        robot: the robot of the measurements; joints and legs are in its order.
        measurements: samples of all sensors but the cameras, in time order.
        ground_truth: the reference trajectory of the body, stamped by the clock of the tracking system.
        imu: mounting and noise of the body's IMU.
        camera_imu: mounting and noise of the camera's IMU.
        stereo: intrinsics and mounting of the cameras.
        frames: encoded images, in time order.
    """

    robot: RobotDescription
    measurements: Iterable[Measurement]
    ground_truth: GroundTruth | None = None
    imu: ImuCalibration | None = None
    camera_imu: ImuCalibration | None = None
    stereo: StereoCalibration | None = None
    frames: Iterable[EncodedStereoFrame] = ()

# SPDX-License-Identifier: BSD-3-Clause
"""A part of the bundled sample in memory, to be changed and written in any format."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import takewhile
from pathlib import Path
from typing import Any, Literal, Self

from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.images import encoded
from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.rosbag.writing.bag_writer import write_bag
from coclo_vio.datasets.sample import sample_path
from coclo_vio.datasets.writer import ALL_JOINT_READINGS, RecordedJoints, write_euroc_folder, write_leg_log
from coclo_vio.robot.description import RobotDescription, load_robot
from coclo_vio.values.calibration import ImuCalibration, StereoCalibration
from coclo_vio.values.measurements import (
    ALL_SENSORS,
    EncodedStereoFrame,
    FootForceSample,
    ImuSample,
    JointSample,
    Measurement,
    StereoFrame,
)
from coclo_vio.values.trajectory import GroundTruth
from coclo_vio.values.units import NS_PER_S

Form = Literal["bag", "folder", "leg log"]
_STEREO_FRAMES = 45  # of the part, from its beginning: images are large
_LEG_LOG_SENSORS = (ImuSample, JointSample, FootForceSample)


@dataclass(frozen=True, slots=True, eq=False)
class Content:
    """Samples, images, calibrations and ground truth of a recording.

    Attributes:
        measurements: of all sensors but the cameras, in time order.
        frames: images, in time order.
        truth: the reference trajectory.
        imu: calibration of the body's IMU.
        camera_imu: of the camera's IMU.
        stereo: of the cameras.
        joints: which readings of the joints are written.
        robot: the robot.
        description: what a user has of the robot, where it is another.
    """

    measurements: Sequence[Measurement]
    frames: Sequence[StereoFrame]
    truth: GroundTruth | None
    imu: ImuCalibration | None
    camera_imu: ImuCalibration | None
    stereo: StereoCalibration | None
    joints: RecordedJoints
    robot: RobotDescription
    description: RobotDescription | None = None

    def changed(self, kind: type, change: Callable[[Any], Measurement | None]) -> Self:
        """The same with all samples of a kind changed; None leaves one out. In time order again."""
        samples = [change(each) if type(each) is kind else each for each in self.measurements]
        kept = sorted((each for each in samples if each is not None), key=lambda each: each.stamp_ns)
        return replace(self, measurements=kept)

    def without_frames(self) -> Self:
        """The same without images and their calibration."""
        return replace(self, frames=(), stereo=None)

    def write(self, folder: Path, form: Form) -> Path:
        """Write it as a bag, an EuRoC folder or a leg log; returns the path to open.

        Raises:
            DatasetError: it cannot be written.
        """
        contents = RecordingContents(
            self.robot,
            self.measurements,
            self.truth,
            self.imu,
            self.camera_imu,
            self.stereo,
            [
                EncodedStereoFrame(each.stamp_ns, encoded(each.left, "png"), encoded(each.right, "png"), "png")
                for each in self.frames
            ],
        )
        if form == "bag":
            folder.mkdir(parents=True, exist_ok=True)
            return write_bag(folder / "recording.mcap", contents, joints=self.joints)
        if form == "folder":
            write_euroc_folder(folder, contents, joints=self.joints)
            return folder
        samples = [each for each in self.measurements if type(each) in _LEG_LOG_SENSORS]
        write_leg_log(folder, self.robot, samples, self.truth, joints=self.joints)
        return folder


@lru_cache(maxsize=2)
def sample_content(start_s: float = 4.0, length_s: float = 12.0, *, has_frames: bool = True) -> Content:
    """A part of the bundled recording in which the robot walks.

    Args:
        start_s: beginning of the part, s.
        length_s: its length, s.
        has_frames: whether images are decoded.
    """
    robot = load_robot("daisy")
    recording = open_dataset(sample_path(), robot)
    begin_ns = next(recording.measurements()).stamp_ns + round(start_s * NS_PER_S)
    end_ns = begin_ns + round(length_s * NS_PER_S)

    def part(sensors: frozenset[type]) -> list[Any]:
        early = takewhile(lambda sample: sample.stamp_ns < end_ns, recording.measurements(sensors))
        return [sample for sample in early if sample.stamp_ns >= begin_ns]

    truth = recording.ground_truth()
    return Content(
        part(ALL_SENSORS - {StereoFrame}),
        part(frozenset({StereoFrame}))[:_STEREO_FRAMES] if has_frames else (),
        None if truth is None else replace(truth, trajectory=truth.trajectory.between(begin_ns, end_ns)),
        recording.imu_calibration() or robot.imu,
        recording.camera_imu_calibration(),
        recording.stereo_calibration() if has_frames else None,
        ALL_JOINT_READINGS,
        robot,
    )

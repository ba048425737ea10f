# SPDX-License-Identifier: BSD-3-Clause
"""A robot of two legs, a short random log of it, with cameras too, and equality of measurements."""

import dataclasses
from collections.abc import Callable, Iterable

import numpy as np
import pytest

from coclo_vio.datasets import images
from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.sequencer import merge_streams, sort_measurements
from coclo_vio.geometry import se3, so3
from coclo_vio.robot.description import LegDescription, RobotDescription
from coclo_vio.values.calibration import CameraCalibration, ImuCalibration, StereoCalibration, matrix4
from coclo_vio.values.measurements import (
    CameraImuSample,
    EncodedStereoFrame,
    FootForceSample,
    ImuSample,
    JointSample,
    Measurement,
    StereoFrame,
)
from coclo_vio.values.trajectory import GroundTruth, Trajectory


@pytest.fixture
def biped() -> RobotDescription:
    legs = tuple(
        LegDescription(name=leg, joints=(f"{leg}_hip_joint", f"{leg}_knee_joint"), foot_frame=f"{leg}_foot")
        for leg in ("left", "right")
    )
    aliases = {joint.removesuffix("_joint"): joint for leg in legs for joint in leg.joints}
    return RobotDescription(name="biped", urdf="biped.urdf", legs=legs, joint_aliases=aliases)


@pytest.fixture
def log() -> list[Measurement]:
    """Joints and forces at 100 Hz, IMU at 200 Hz, NaN in a joint and in a force; stamps that a float would round."""
    rng = np.random.default_rng(7)
    start_ns = 1_403_715_273_262_142_977
    samples: list[Measurement] = []
    for i in range(40):
        stamp_ns = start_ns + i * 5_000_001
        force, position = rng.normal(size=2), rng.normal(size=4)
        force[1 if i == 10 else []] = np.nan
        position[2 if i == 20 else []] = np.nan
        if i % 2 == 0:
            samples.append(FootForceSample(stamp_ns, force))
        samples.append(ImuSample(stamp_ns, rng.normal(size=3), rng.normal(size=3)))
        if i % 2 == 0:
            samples.append(JointSample(stamp_ns, position, rng.normal(size=4), rng.normal(size=4)))
    return samples


@pytest.fixture
def full_recording(biped: RobotDescription, log: list[Measurement]) -> RecordingContents:
    """The log with the camera's IMU, five pairs of images, ground truth and all calibrations."""
    rng = np.random.default_rng(11)
    start_ns = log[0].stamp_ns
    camera_imu = [CameraImuSample(start_ns + i * 4_000_003, *rng.normal(size=(2, 3))) for i in range(50)]
    frames = []
    for i in range(5):
        left, right = (images.encoded(rng.integers(0, 256, (12, 16), dtype=np.uint8), "png") for _ in range(2))
        frames.append(EncodedStereoFrame(start_ns + i * 40_000_007, left, right, "png"))
    poses = se3.transform(so3.exp(rng.normal(size=(20, 3))), rng.normal(size=(20, 3)))
    truth = Trajectory(start_ns - 5_000_000 + np.arange(20) * 10_000_019, poses)
    lens = CameraCalibration(width_px=16, height_px=12, focal_px=(9.5, 9.25), principal_point_px=(7.5, 5.5))
    T_body_left = se3.transform(so3.exp(np.array([-1.2, 1.1, -1.3])), np.array([0.3, 0.025, 0.1]))
    T_left_right = se3.transform(np.eye(3), np.array([0.05, 0.0, 0.0]))
    stereo = StereoCalibration(
        left=lens,
        right=lens,
        body_left_camera=matrix4(T_body_left),
        body_right_camera=matrix4(T_body_left @ T_left_right),
    )
    return RecordingContents(
        robot=biped,
        measurements=list(sort_measurements([*log, *camera_imu])),
        ground_truth=GroundTruth(truth, has_stamps=True, source="made"),
        imu=ImuCalibration(position_body_m=(0.1, -0.2, 0.3), rotation_body_imu_rpy_rad=(0.4, -0.5, 2.6)),
        camera_imu=ImuCalibration(position_body_m=(0.3, 0.0, 0.1), rotation_body_imu_rpy_rad=(-1.57, 0.1, -1.5)),
        stereo=stereo,
        frames=frames,
    )


@pytest.fixture
def decoded_stream() -> Callable[[RecordingContents], list[Measurement]]:
    """The expected measurements of a reader: all samples and the decoded images, merged."""

    def stream(contents: RecordingContents) -> list[Measurement]:
        frames = [
            StereoFrame(frame.stamp_ns, *(images.decoded(data, "made") for data in (frame.left, frame.right)))
            for frame in contents.frames
        ]
        return list(merge_streams([contents.measurements, frames]))

    return stream


@pytest.fixture
def assert_same() -> Callable[[Iterable[Measurement], Iterable[Measurement]], None]:
    """Equality of two streams: the same types in the same order, every value equal to the last bit, NaN with NaN."""

    def compare(got: Iterable[Measurement], expected: Iterable[Measurement]) -> None:
        got, expected = list(got), list(expected)
        assert [type(sample) for sample in got] == [type(sample) for sample in expected]
        for mine, theirs in zip(got, expected, strict=True):
            assert mine.stamp_ns == theirs.stamp_ns
            for field in dataclasses.fields(mine):
                np.testing.assert_array_equal(getattr(mine, field.name), getattr(theirs, field.name), field.name)

    return compare

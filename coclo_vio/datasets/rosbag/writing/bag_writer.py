# SPDX-License-Identifier: BSD-3-Clause
"""A recording written as a rosbag, streamed in time order.

=================================================== ====================== ===========================================
``/joint_states``                                   JointState             by name; NaN is a joint without a reading
``/imu``, ``/camera/imu``                           Imu                    covariance = density^2 * rate of the topic
``/foot_force/<leg>``                               WrenchStamped          ``force.z``; a message a leg, at one stamp;
                                                                           or entries of ``/joint_states``
``/camera/infra1/image_rect_raw/compressed``        CompressedImage        left camera, bytes as encoded; infra2: right
``/camera/infra1/camera_info``                      CameraInfo             with each image; P of a rectified pair's
                                                                           right camera holds the baseline
``/vicon/<robot>/<robot>``                          TransformStamped       ground truth, T_vicon_body
``/tf_static``                                      TFMessage              base_link (the body) to imu_link and the
                                                                           camera's optical frames
=================================================== ====================== ===========================================

Stamps are exact, in the header as in the bag. A bag has no place for an IMU's bias walks, for the offset of the
camera's clock and for ground truth's velocity: these are left out.
"""

import heapq
from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np

from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.rosbag.writing.messages import BagMessages
from coclo_vio.datasets.rosbag.writing.new_bag import new_bag
from coclo_vio.datasets.writer import ALL_JOINT_READINGS, RecordedJoints
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import CameraCalibration, ImuCalibration, StereoCalibration
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.measurements import (
    CameraImuSample,
    EncodedStereoFrame,
    FootForceSample,
    ImuSample,
    InertialReading,
    JointSample,
    Measurement,
    StereoFrame,
)
from coclo_vio.values.units import NS_PER_S

BODY_FRAME = "base_link"
IMU_FRAME = "imu_link"
CAMERA_IMU_FRAME = "camera_imu_optical_frame"
CAMERA_FRAMES = ("camera_infra1_optical_frame", "camera_infra2_optical_frame")
VICON_FRAME = "vicon"

_CAMERA_TOPICS = ("/camera/infra1", "/camera/infra2")
_IMU_TOPICS = {ImuSample: ("/imu", IMU_FRAME), CameraImuSample: ("/camera/imu", CAMERA_IMU_FRAME)}
_RATE_SAMPLES = 2000  # first samples, from which the rate of an IMU is computed
_RECTIFIED_TOLERANCE = 1e-6

Message = tuple[int, str, Any]  # stamp in ns, topic, message


def write_bag(path: Path, contents: RecordingContents, *, joints: RecordedJoints = ALL_JOINT_READINGS) -> Path:
    """Write ``contents`` as a bag.

    Args:
        path: ends in ``.bag`` (ROS 1), ``.mcap`` or ``.db3`` (ROS 2, one file), or has no suffix (ROS 2 folder).
        contents: what to write; streamed.
        joints: which of the joints' readings to write.

    Returns:
        ``path``.

    Raises:
        DatasetError: the path exists, has another suffix or cannot be written, or the ground truth has no stamps.
        TimestampError: a stamp that ROS cannot hold.
    """
    truth = contents.ground_truth
    if truth is not None and not truth.has_stamps:
        raise DatasetError("a bag cannot hold ground truth without stamps; write a leg log instead")
    with new_bag(path) as bag:
        trial = _Trial(contents, BagMessages(bag), joints)
        for number, (stamp_ns, topic, message) in enumerate(trial.messages()):
            if number == 0 and (mountings := trial.mountings(stamp_ns)):
                bag.write("/tf_static", stamp_ns, trial.make.tf(mountings), is_latched=True)
            bag.write(topic, stamp_ns, message)
    return path


class _Trial:
    """Contents as messages."""

    def __init__(self, contents: RecordingContents, make: BagMessages, joints: RecordedJoints) -> None:
        self._contents = contents
        self._joints = joints
        self._variances: dict[type, tuple[float, float]] = {}
        self._feet: FootForceSample | None = None  # the last one, to be written with the joints of its stamp
        self.make = make

    def messages(self) -> Iterator[Message]:
        """All messages in time order as far as the measurements are."""
        streams = (self._of_ground_truth(), self._of_measurements(), self._of_frames())
        return heapq.merge(*streams, key=lambda message: message[0])

    def mountings(self, stamp_ns: int) -> list[Any]:
        """The known mountings of the sensors, as transforms from the body."""
        known: list[tuple[str, Array]] = []
        if self._contents.imu is not None:
            known.append((IMU_FRAME, self._contents.imu.T_body_imu))
        if self._contents.camera_imu is not None:
            known.append((CAMERA_IMU_FRAME, self._contents.camera_imu.T_body_imu))
        stereo = self._contents.stereo
        if stereo is not None:
            known += zip(CAMERA_FRAMES, (stereo.T_body_left_camera, stereo.T_body_right_camera), strict=True)
        return [self.make.transform(stamp_ns, BODY_FRAME, frame, T_body_frame) for frame, T_body_frame in known]

    def _of_ground_truth(self) -> Iterator[Message]:
        truth, name = self._contents.ground_truth, self._contents.robot.name
        if truth is not None:
            for stamp_ns, pose in zip(truth.trajectory.stamps_ns.tolist(), truth.trajectory.T_world_body, strict=True):
                message = self.make.transform(stamp_ns, VICON_FRAME, BODY_FRAME, pose)
                yield stamp_ns, f"/vicon/{name}/{name}", message

    def _of_measurements(self) -> Iterator[Message]:
        samples = iter(self._contents.measurements)
        head = list(islice(samples, _RATE_SAMPLES))
        rates_hz = _imu_rates_hz(head)
        for kind, imu in ((ImuSample, self._contents.imu), (CameraImuSample, self._contents.camera_imu)):
            self._variances[kind] = _variances(imu, rates_hz.get(kind, 0.0))
        for sample in chain(head, samples):
            for topic, message in self._of_measurement(sample):
                yield sample.stamp_ns, topic, message

    def _of_measurement(self, sample: Measurement) -> Iterator[tuple[str, Any]]:
        robot, joints = self._contents.robot, self._joints
        match sample:
            case ImuSample() | CameraImuSample():
                topic, frame = _IMU_TOPICS[type(sample)]
                yield topic, self.make.imu(frame, sample, *self._variances[type(sample)])
            case JointSample():
                message = self.make.joints(
                    BODY_FRAME,
                    robot.joint_names,
                    sample,
                    with_velocity=joints.with_velocity,
                    with_effort=joints.with_effort,
                    feet=self._feet_entries(sample) if joints.with_feet else {},
                )
                yield "/joint_states", message
            case FootForceSample() if joints.with_feet:
                self._feet = sample
            case FootForceSample():
                for leg, force in zip(robot.legs, sample.force.tolist(), strict=True):
                    yield f"/foot_force/{leg.name}", self.make.foot_force(sample.stamp_ns, leg.foot_frame, force)
            case StereoFrame():
                raise DatasetError("a bag is written from encoded images, passed as `frames`; this one is decoded")

    def _feet_entries(self, sample: JointSample) -> dict[str, float]:
        """The foot forces at the stamp of a joint sample, which follows them, by the names of the feet."""
        feet = self._feet
        if feet is None or feet.stamp_ns != sample.stamp_ns:
            return {leg.foot_frame: np.nan for leg in self._contents.robot.legs}
        return {
            leg.foot_frame: force for leg, force in zip(self._contents.robot.legs, feet.force.tolist(), strict=True)
        }

    def _of_frames(self) -> Iterator[Message]:
        stereo = self._contents.stereo
        for frame in self._contents.frames:
            for topic, message in self._of_frame(frame, stereo):
                yield frame.stamp_ns, topic, message

    def _of_frame(self, frame: EncodedStereoFrame, stereo: StereoCalibration | None) -> Iterator[tuple[str, Any]]:
        cameras: tuple[CameraCalibration | None, ...] = (None, None) if stereo is None else (stereo.left, stereo.right)
        baselines_m = (0.0, 0.0 if stereo is None else _baseline_if_rectified(stereo))
        files = (frame.left, frame.right)
        for topic, frame_id, data, camera, baseline_m in zip(
            _CAMERA_TOPICS, CAMERA_FRAMES, files, cameras, baselines_m, strict=True
        ):
            if camera is not None:
                yield f"{topic}/camera_info", self.make.camera_info(frame.stamp_ns, frame_id, camera, baseline_m)
            image = self.make.image(frame.stamp_ns, frame_id, data, frame.encoding)
            yield f"{topic}/image_rect_raw/compressed", image


def _imu_rates_hz(samples: Iterable[Measurement]) -> dict[type, float]:
    """Readings a second of each IMU, by the median of its steps; none for an IMU with fewer than two readings."""
    stamps: defaultdict[type, list[int]] = defaultdict(list)
    for sample in samples:
        if isinstance(sample, InertialReading):
            stamps[type(sample)].append(sample.stamp_ns)
    medians = {kind: float(np.median(np.diff(stamps_ns))) for kind, stamps_ns in stamps.items() if len(stamps_ns) > 1}
    return {kind: NS_PER_S / step_ns for kind, step_ns in medians.items() if step_ns > 0.0}


def _variances(imu: ImuCalibration | None, rate_hz: float) -> tuple[float, float]:
    """Variances of a sampled reading of gyroscope and accelerometer: density^2 times the rate; 0 where unknown."""
    if imu is None:
        return 0.0, 0.0
    return imu.gyroscope_noise_density**2 * rate_hz, imu.accelerometer_noise_density**2 * rate_hz


def _baseline_if_rectified(stereo: StereoCalibration) -> float:
    """Position of the right camera on the left one's x axis, m; 0 where the pair is not rectified."""
    T_left_right = se3.inverse(stereo.T_body_left_camera) @ stereo.T_body_right_camera
    beside = np.eye(4)
    beside[0, 3] = T_left_right[0, 3]
    is_rectified = (
        stereo.left == stereo.right
        and stereo.left.distortion == "none"
        and np.allclose(T_left_right, beside, rtol=0.0, atol=_RECTIFIED_TOLERANCE)
    )
    return float(T_left_right[0, 3]) if is_rectified else 0.0

# SPDX-License-Identifier: BSD-3-Clause
"""The messages of a recording as a robot would send them: those of a ROS 2 bag, or made of any other recording."""

import struct
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from coclo_vio.api.recording import Recording, open_recording
from coclo_vio.datasets.images import encoded
from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.rosbag.reader import is_rosbag
from coclo_vio.datasets.rosbag.storage.bag_file import BagFile
from coclo_vio.datasets.rosbag.storage.type_definitions import TypeDefinitions
from coclo_vio.datasets.rosbag.writing.bag_writer import write_bag
from coclo_vio.live.unitree import LOW_STATE, TOPIC
from coclo_vio.values.arrays import IntArray
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.measurements import ALL_SENSORS as _ALL
from coclo_vio.values.measurements import (
    LEG_SENSORS,
    EncodedStereoFrame,
    FootForceSample,
    ImuSample,
    JointSample,
    StereoFrame,
)
from coclo_vio.values.units import NS_PER_S

_STAMP = struct.Struct("<iI")
_MOTORS = 20


class RecordedMessage(NamedTuple):
    """A message of a recording: topic, type, time, and CDR."""

    topic: str
    msgtype: str
    at_ns: int
    data: bytes


@contextmanager
def recorded_messages(path: Path, robot: str | None, types: TypeDefinitions) -> Iterator[Iterator[RecordedMessage]]:
    """The messages of a recording in the order of their arrival; those of types that are not known are left out.

    Args:
        path: of a recording.
        robot: its name, where it is not a ROS 2 bag and has legs.
        types: that are known.

    Raises:
        DatasetError: it cannot be read.
    """
    if is_rosbag(path) and not (bag := BagFile(path, allow_partial=True)).is_ros1:
        yield _of_bag(bag, types)
        return
    with tempfile.TemporaryDirectory(prefix="coclo-vio-") as folder:
        made = _as_bag(open_recording(path, robot), Path(folder) / "recording.mcap")
        yield _of_bag(BagFile(made, allow_partial=True), types)


def low_states(path: Path, robot: str | None, types: TypeDefinitions) -> Iterator[RecordedMessage]:
    """A recording of a quadruped as Unitree's messages, one for each joint sample.

    Raises:
        DatasetError: it cannot be read, or the robot has more joints than there are motors.
    """
    recording = open_recording(path, robot)
    imu: ImuSample | None = None
    feet = np.zeros(4, dtype=np.int64)
    make = types.types
    for sample in recording.measurements(LEG_SENSORS):
        match sample:
            case ImuSample():
                imu = sample
            case FootForceSample():
                feet = np.nan_to_num(sample.force[:4]).astype(np.int64)
            case JointSample() if imu is not None:
                message = _low_state(make, sample, imu, feet)
                yield RecordedMessage(TOPIC, LOW_STATE, sample.stamp_ns, types.serialized(message))


def restamped(message: RecordedMessage, types: TypeDefinitions, shift_ns: int) -> bytes:
    """The bytes of a message with the stamp of its header shifted; unchanged without a header."""
    data = message.data
    if not types.has_header(message.msgtype) or len(data) < 12 or data[1] & 1 == 0:
        return data
    seconds, nanoseconds = _STAMP.unpack_from(data, 4)
    seconds, nanoseconds = divmod(seconds * NS_PER_S + nanoseconds + shift_ns, NS_PER_S)
    return data[:4] + _STAMP.pack(seconds, nanoseconds) + data[12:]


def _of_bag(bag: BagFile, types: TypeDefinitions) -> Iterator[RecordedMessage]:
    known = {name: topic.msgtype for name, topic in bag.topics.items() if topic.msgtype in types}
    for message in bag.messages(known.keys()):
        yield RecordedMessage(message.topic, known[message.topic], message.received_ns, message.data)


def _as_bag(recording: Recording, path: Path) -> Path:
    if recording.robot is None:
        raise DatasetError(f"{recording.path} is no bag of ROS 2: name its robot with --robot")
    calibration = recording.calibration

    def frames() -> Iterator[EncodedStereoFrame]:
        for frame in recording.measurements(frozenset({StereoFrame})):
            if isinstance(frame, StereoFrame):
                left, right = (encoded(image, "png") for image in (frame.left, frame.right))
                yield EncodedStereoFrame(frame.stamp_ns, left, right, "png")

    contents = RecordingContents(
        recording.robot,
        recording.measurements(_ALL - {StereoFrame}),
        None,
        calibration.imu,
        calibration.camera_imu,
        calibration.stereo,
        frames(),
    )
    return write_bag(path, contents)


def _low_state(make: dict[str, Any], joints: JointSample, imu: ImuSample, feet: IntArray) -> object:
    count = len(joints.position)
    if count > _MOTORS:
        raise DatasetError(f"the robot has {count} joints, more than the {_MOTORS} motors of {LOW_STATE}")
    package = "unitree_go/msg/"
    zero = np.zeros
    state = make[package + "IMUState"](
        np.array([1, 0, 0, 0], dtype=np.float32),
        imu.angular_velocity.astype(np.float32),
        imu.specific_force.astype(np.float32),
        zero(3, dtype=np.float32),
        0,
    )
    readings = np.zeros((3, _MOTORS))
    readings[:, :count] = np.nan_to_num(np.stack((joints.position, joints.velocity, joints.effort)))
    motors = [
        make[package + "MotorState"](1, q, dq, 0.0, tau, q, dq, 0.0, 0, 0, zero(2, dtype=np.uint32))
        for q, dq, tau in readings.T.tolist()
    ]
    battery = make[package + "BmsState"](
        0, 0, 0, 0, 0, 0, zero(2, dtype=np.uint8), zero(2, dtype=np.uint8), zero(15, dtype=np.uint16)
    )
    tick = joints.stamp_ns // 1_000_000 % 2**32
    words, bytes_of = zero(2, dtype=np.uint32), zero(40, dtype=np.uint8)
    head, counts = zero(2, dtype=np.uint8), feet.astype(np.int16)
    return make[package + "LowState"](
        head, 0, 0, words, words, 0, state, motors, battery, counts, counts, tick, bytes_of, 0, 0.0, 0, 0, 0.0, 0.0,
        zero(4, dtype=np.uint16), 0, 0,
    )  # fmt: skip

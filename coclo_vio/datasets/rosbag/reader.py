# SPDX-License-Identifier: BSD-3-Clause
"""A rosbag as a recording: ROS 1 (.bag) and ROS 2 (.mcap, .db3, a folder with metadata.yaml), without ROS.

What is read for what is guessed from types and names or named in ``dataset.rosbag`` (``config``), and told by
``RosBag.topics``. One pass streams; nothing but a second of messages is held.
"""

from collections import deque
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from coclo_vio.datasets.columns import ColumnNames
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.joint_velocity import fill_velocities
from coclo_vio.datasets.read_report import STREAM_NAMES, ReadReport, ReadTally, StreamReport
from coclo_vio.datasets.rosbag.calibration import BagCalibration
from coclo_vio.datasets.rosbag.glance import JOINT_STATE, glance_at
from coclo_vio.datasets.rosbag.poses import read_frames, read_truth
from coclo_vio.datasets.rosbag.roles import find_roles, notes_on
from coclo_vio.datasets.rosbag.stereo import RawPair
from coclo_vio.datasets.rosbag.storage.bag_file import BagFile
from coclo_vio.datasets.rosbag.storage.files import LOOKS_FOR, is_rosbag
from coclo_vio.datasets.rosbag.stream import BagStream, Item
from coclo_vio.datasets.rosbag.timing import BagClock
from coclo_vio.datasets.rosbag.topics import TopicChoice
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.calibration import ImuCalibration, StereoCalibration
from coclo_vio.values.errors import DatasetError, TimestampError, TopicNotFound
from coclo_vio.values.measurements import ALL_SENSORS, LEG_SENSORS, JointSample, Measurement, StereoFrame
from coclo_vio.values.trajectory import GroundTruth

__all__ = ["LOOKS_FOR", "RosBag", "TopicChoice", "is_rosbag", "joint_names"]

_ROLES = ("imu", "camera_imu", "left_image", "right_image", "left_info", "right_info")


class RosBag:
    """A bag of ROS 1 or ROS 2.

    Invariant: ``measurements`` starts from the beginning each time it is called.

    Attributes:
        name: what the recording is called in reports.
    """

    format_name = "rosbag"

    def __init__(self, path: Path, robot: RobotDescription | None, config: DatasetConfig) -> None:
        """Find the topics; without a robot joints and feet are left unread.

        Raises:
            TopicNotFound: a topic that the configuration names is not there, or the joints' names are others than the
                robot's and partial reading is not allowed.
            DatasetError: the bag is damaged and partial reading is not allowed, or the configuration does not fit.
        """
        self.name = path.resolve().name if path.is_dir() else path.stem
        self._robot, self._config = robot, config
        self._bag = BagFile(path, allow_partial=config.allow_partial)
        self._seen = glance_at(self._bag, config.rosbag.types, config.rosbag.joint_entries)
        self._roles = find_roles(self._seen, robot, config.rosbag)
        if self._roles.joints is not None and self._roles.joints.are_others and not config.allow_partial:
            raise self._without_joints()
        self._counted: dict[str, StreamReport | None] = {}
        self._dropped: dict[str, int] = {}
        self._notes: dict[str, None] = dict.fromkeys(notes_on(self._roles))
        self._truth: tuple[GroundTruth | None, ReadReport] | None = None
        self._calibration: BagCalibration | None = None
        self._calibration_tally = self._new_tally()

    def topics(self) -> tuple[TopicChoice, ...]:
        """Which topic plays which role, why, and which others of its type there are."""
        return self._roles.choices

    def matched_joints(self) -> tuple[str, ...]:
        """The robot's joints that the bag has, by the robot's names."""
        joints = self._roles.joints
        if joints is None:
            return ()
        return tuple(
            name for name, is_there in zip(joints.entries.joint_names, joints.is_there, strict=True) if is_there
        )

    def measurements(self, sensors: frozenset[type] = LEG_SENSORS) -> Iterator[Measurement]:
        """All samples of ``sensors`` in time order, streamed; only their topics are opened.

        Raises:
            TopicNotFound: joints are asked for, and there are none.
            TimestampError: stamps go back within a topic.
            DatasetError: the bag breaks off, a message or an image cannot be read, or there is no sample at all.

        With ``allow_partial`` what can be read is read, and what was left out is told in the report.
        """
        joints = self._roles.joints
        if JointSample in sensors and joints is not None and joints.complaint and not self._config.allow_partial:
            raise self._without_joints()
        tally = self._new_tally()
        for item in self._stream(sensors, tally, is_tolerant=self._config.allow_partial):
            sample = self._decoded(item, tally)
            if sample is not None:
                yield sample
        self._keep(sensors, tally)
        if sensors >= LEG_SENSORS and not self._roles.kinds - sensors and not tally.report().streams:
            raise self._nothing(tally)

    def ground_truth(self) -> GroundTruth | None:
        """The reference trajectory, read once, or None where the bag has none.

        Raises:
            TimestampError: stamps go back, or there is no complete pose.
        """
        if self._truth is None:
            self._truth = self._read_truth(is_tolerant=self._config.allow_partial)
        return self._truth[0]

    def imu_calibration(self) -> ImuCalibration | None:
        """Mounting (static transforms) and noise (covariances) of the IMU, or None where neither is said.

        Raises:
            CalibrationMissing: a file of Kalibr is at fault.
        """
        return self._calibrated().imu("imu")

    def camera_imu_calibration(self) -> ImuCalibration | None:
        """Mounting and noise of the camera's IMU, or None where its mounting is not said.

        Raises:
            CalibrationMissing: a file of Kalibr is at fault.
        """
        return self._calibrated().imu("camera_imu")

    def stereo_calibration(self) -> StereoCalibration | None:
        """Lenses and mountings of the cameras, or None where the bag does not say both and no camchain is given.

        Raises:
            CalibrationMissing: a camchain or a CameraInfo is at fault.
        """
        return self._calibrated().stereo()

    def report(self) -> ReadReport:
        """What the bag holds; reads through what no finished ``measurements`` has read yet, decoding no image.

        Does not fail on what can be told: missing joints, stamps that go back, a break are notes and counts.

        Raises:
            DatasetError: there is no sample at all.
        """
        rest = frozenset(kind for kind in ALL_SENSORS if STREAM_NAMES[kind] not in self._counted)
        if rest & self._roles.kinds:
            tally = self._new_tally()
            for item in self._stream(rest, tally, is_tolerant=True):
                _count(item, tally)
            self._keep(rest, tally)
        streams = tuple(stream for _, stream in sorted(self._counted.items()) if stream is not None)
        if not streams:
            raise self._nothing(self._new_tally())
        truth = self._truth_report()
        notes = dict.fromkeys((*self._notes, *truth.notes, *self._calibration_tally.notes))
        if self._bag.damage is not None:
            notes[f"{self._bag.damage}: read up to there"] = None
        return ReadReport(self.format_name, streams, {**self._dropped, **truth.dropped}, tuple(notes))

    def _stream(self, sensors: frozenset[type], tally: ReadTally, *, is_tolerant: bool) -> Iterator[Item]:
        """Samples in order, velocities filled in where the bag has none; image pairs are not decoded."""
        clock = self._clock(tally, is_tolerant=is_tolerant)
        config, robot = self._config, self._robot
        reader = BagStream(self._bag, self._roles, robot, config.rosbag, clock, tally, drops_broken=is_tolerant)
        stream = reader.in_order(sensors, sorts=config.sort)
        joints = self._roles.joints
        if joints is None or joints.has_velocity.all():
            return stream
        is_absent = np.logical_not(joints.has_velocity)
        return fill_velocities(stream, is_absent, config.joint_velocity)  # type: ignore[arg-type]

    def _decoded(self, item: Item, tally: ReadTally) -> Measurement | None:
        if not isinstance(item, RawPair):
            _count(item, tally)
            return item
        try:
            frame = item.decoded(self._bag)
        except DatasetError:
            if not self._config.allow_partial:
                raise
            tally.dropped[f"{item.left.topic}: pair of images that cannot be decoded"] += 1
            return None
        tally.count(StereoFrame, item.stamp_ns)
        return frame

    def _clock(self, tally: ReadTally, *, is_tolerant: bool) -> BagClock:
        return BagClock(
            self._bag,
            uses_header=self._config.rosbag.clock == "header",
            drops_backward=is_tolerant,
            keeps_backward=self._config.sort,
            tally=tally,
        )

    def _read_truth(self, *, is_tolerant: bool) -> tuple[GroundTruth | None, ReadReport]:
        tally = self._new_tally()
        topic = self._roles.topic("ground_truth")
        if topic is None:
            return None, tally.report()
        clock = self._clock(tally, is_tolerant=is_tolerant)
        try:
            truth = read_truth(self._bag, topic, self._config.rosbag, clock, tally)
        except TimestampError as error:
            if not is_tolerant:
                raise
            tally.note(f"no ground truth is read: {error}")
            truth = None
        return truth, tally.report()

    def _truth_report(self) -> ReadReport:
        try:
            self.ground_truth()
        except TimestampError as error:
            tally = self._new_tally()
            tally.note(f"no ground truth is read: {error}")
            return tally.report()
        return self._new_tally().report() if self._truth is None else self._truth[1]

    def _calibrated(self) -> BagCalibration:
        if self._calibration is None:
            config = self._config.rosbag
            self._calibration = BagCalibration(
                self._seen,
                {role: self._roles.topic(role) for role in _ROLES},
                read_frames(self._bag, config.topics.tf_static),
                self._robot,
                config,
                self._calibration_tally,
            )
        return self._calibration

    def _keep(self, sensors: frozenset[type], tally: ReadTally) -> None:
        """Remember what a finished pass counted."""
        report = tally.report()
        for kind in sensors:
            self._counted[STREAM_NAMES[kind]] = report.stream(STREAM_NAMES[kind])
        self._dropped.update(report.dropped)
        self._notes.update(dict.fromkeys(report.notes))

    def _without_joints(self) -> TopicNotFound:
        complaint = "" if self._roles.joints is None else self._roles.joints.complaint
        return TopicNotFound(f"{self._bag.path}: {complaint}; --allow-partial (dataset.allow_partial) reads the rest")

    def _nothing(self, tally: ReadTally) -> DatasetError:
        left_out = dict(tally.report().dropped) or "none"
        damage = "" if self._bag.damage is None else f"; {self._bag.damage}"
        return DatasetError(f"{self._bag.path} holds no sample; messages left out: {left_out}{damage}")

    def _new_tally(self) -> ReadTally:
        return ReadTally(self.format_name, self._config.gap_s)


def joint_names(path: Path, columns: ColumnNames) -> tuple[Path, tuple[str, ...]]:
    """The bag, and the names of all joints in it; those of messages without names are not known.

    Raises:
        DatasetError: the bag is damaged.
    """
    bag = BagFile(path, allow_partial=True)
    seen = glance_at(bag, {})
    return path, tuple(sorted({name for topic in seen.of_type(JOINT_STATE) for name in seen.entries.get(topic, ())}))


def _count(item: Item, tally: ReadTally) -> None:
    if isinstance(item, RawPair):
        tally.count(StereoFrame, item.stamp_ns)
    else:
        deque(tally.watch([item]), maxlen=0)

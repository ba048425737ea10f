# SPDX-License-Identifier: BSD-3-Clause
"""The reader of rosbags: ROS 1 (.bag) and ROS 2 (.mcap, .db3, a folder with metadata.yaml), without ROS.

The topics are inferred from types and names or named in ``dataset.rosbag`` (``config``); ``RosBag.topics`` lists them.
A pass streams the bag and holds one second of messages.
"""

from collections import deque
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from coclo_vio.datasets.columns import ColumnNames
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.ground_truth import read_ground_truth, tum_files
from coclo_vio.datasets.joint_velocity import fill_velocities
from coclo_vio.datasets.read_report import STREAM_NAMES, ReadReport, ReadTally, StreamReport
from coclo_vio.datasets.rosbag.bag_calibration import BagCalibration
from coclo_vio.datasets.rosbag.bag_preview import preview_of
from coclo_vio.datasets.rosbag.conversion import Item, MessageConverter
from coclo_vio.datasets.rosbag.field_paths import FieldsConfig
from coclo_vio.datasets.rosbag.foreign_types import hints
from coclo_vio.datasets.rosbag.mapped_messages import MappedMessages, with_topics
from coclo_vio.datasets.rosbag.message_types import JOINT_STATE
from coclo_vio.datasets.rosbag.poses import read_frames, read_truth
from coclo_vio.datasets.rosbag.stereo_pairing import RawPair
from coclo_vio.datasets.rosbag.storage.bag_file import BagFile
from coclo_vio.datasets.rosbag.storage.files import LAYOUT, is_rosbag
from coclo_vio.datasets.rosbag.stream import BagStream
from coclo_vio.datasets.rosbag.timing import BagClock
from coclo_vio.datasets.rosbag.topic_choice import TopicChoice
from coclo_vio.datasets.rosbag.topic_roles import choose_roles, notes_of
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.calibration import ImuCalibration, StereoCalibration
from coclo_vio.values.errors import DatasetError, TimestampError, TopicNotFound, listing
from coclo_vio.values.measurements import ALL_SENSORS, LEG_SENSORS, JointSample, Measurement, StereoFrame
from coclo_vio.values.trajectory import GroundTruth

__all__ = ["LAYOUT", "RosBag", "TopicChoice", "is_rosbag", "joint_names"]

_MOST_TOPICS = 15


class RosBag:
    """A bag of ROS 1 or ROS 2.

    Invariant: ``measurements`` starts from the beginning each time it is called.

    Attributes:
        name: name of the recording in reports.
    """

    format_name = "rosbag"

    def __init__(self, path: Path, robot: RobotDescription | None, config: DatasetConfig) -> None:
        """Find the topics; without a robot joints and foot forces are not read.

        Raises:
            TopicNotFound: a topic that the configuration names is not in the bag, or joints of the robot are not among
                the bag's and partial reading is not allowed.
            DatasetError: the bag is damaged and partial reading is not allowed, or the configuration does not fit.
        """
        self.name = path.resolve().name if path.is_dir() else path.stem
        config = config.model_copy(update={"rosbag": with_topics(config.rosbag, robot)})
        self._path, self._robot, self._config = path, robot, config
        bag = BagFile(path, allow_partial=config.allow_partial)
        self._bag = MappedMessages(bag, config.rosbag, robot, allow_partial=config.allow_partial)
        self._preview = preview_of(self._bag, config.rosbag.types, config.rosbag.joint_entries)
        self._roles = choose_roles(self._preview, robot, config.rosbag)
        if self._roles.joints is not None and self._roles.joints.has_other_names and not config.allow_partial:
            raise self._missing_joints()
        self._counted: dict[str, StreamReport | None] = {}
        self._dropped: dict[str, int] = {}
        self._notes: dict[str, None] = dict.fromkeys((*notes_of(self._roles), *self._hints()))
        self._truth: tuple[GroundTruth | None, ReadReport] | None = None
        self._calibration: BagCalibration | None = None
        self._calibration_tally = self._new_tally()

    def _hints(self) -> list[str]:
        """How messages of other types could be read, where they are all there is of a sensor."""
        has_all = self._roles.topic("imu") is not None and self._roles.choice("joints").topic is not None
        return [] if has_all or self._config.rosbag.fields != FieldsConfig() else hints(self._preview.types)

    def topics(self) -> tuple[TopicChoice, ...]:
        """The topic of every role, why it was chosen, and the other topics of its type."""
        return self._roles.choices

    def matched_joints(self) -> tuple[str, ...]:
        """Those of the robot's joints that the bag has, by the robot's names."""
        joints = self._roles.joints
        if joints is None:
            return ()
        return tuple(name for name, has_it in zip(joints.entries.joint_names, joints.is_present, strict=True) if has_it)

    def measurements(self, sensors: frozenset[type] = LEG_SENSORS) -> Iterator[Measurement]:
        """All samples of ``sensors`` in time order, streamed; only their topics are opened.

        Raises:
            TopicNotFound: joints are requested and some are missing.
            TimestampError: stamps go back within a topic.
            DatasetError: the bag is cut off, a message or an image cannot be read, or there is no sample at all.

        With ``allow_partial`` defects are left out and counted in the report.
        """
        joints = self._roles.joints
        if JointSample in sensors and joints is not None and joints.problem and not self._config.allow_partial:
            raise self._missing_joints()
        tally = self._new_tally()
        for item in self._stream(sensors, tally, drops_defects=self._config.allow_partial):
            sample = self._decoded(item, tally)
            if sample is not None:
                yield sample
        self._store(sensors, tally)
        if sensors >= LEG_SENSORS and not self._roles.sensors - sensors and not tally.report().streams:
            raise self._no_sample(tally)

    def ground_truth(self) -> GroundTruth | None:
        """The reference trajectory, read once, or None where the bag has none.

        Raises:
            TimestampError: stamps go back, or there is no complete pose.
        """
        if self._truth is None:
            self._truth = self._read_truth(drops_defects=self._config.allow_partial)
        return self._truth[0]

    def imu_calibration(self) -> ImuCalibration | None:
        """Mounting (static transforms) and noise (covariances) of the IMU, or None where the bag has neither.

        Raises:
            CalibrationMissing: a file of Kalibr is malformed or does not fit.
        """
        return self._calibrated().imu("imu")

    def camera_imu_calibration(self) -> ImuCalibration | None:
        """Mounting and noise of the camera's IMU, or None where its mounting is unknown.

        Raises:
            CalibrationMissing: a file of Kalibr is malformed or does not fit.
        """
        return self._calibrated().imu("camera_imu")

    def stereo_calibration(self) -> StereoCalibration | None:
        """Intrinsics and mountings of the cameras, or None where the bag lacks one and no camchain is configured.

        Raises:
            CalibrationMissing: a camchain or a CameraInfo is malformed or does not fit.
        """
        return self._calibrated().stereo()

    def calibration_conflicts(self) -> tuple[str, ...]:
        """Where two sources have different numbers for the cameras, a sentence each.

        Raises:
            CalibrationMissing: a calibration is malformed.
        """
        return self._calibrated().conflicts()

    def report(self) -> ReadReport:
        """What the bag holds; reads the sensors that no finished ``measurements`` has read yet, decoding no image.

        Missing joints, stamps that go back and damage are notes and counts here, not errors.

        Raises:
            DatasetError: there is no sample at all.
        """
        rest = frozenset(sensor for sensor in ALL_SENSORS if STREAM_NAMES[sensor] not in self._counted)
        if rest & self._roles.sensors:
            tally = self._new_tally()
            for item in self._stream(rest, tally, drops_defects=True):
                _count(item, tally)
            self._store(rest, tally)
        streams = tuple(stream for _, stream in sorted(self._counted.items()) if stream is not None)
        if not streams:
            raise self._no_sample(self._new_tally())
        truth = self._truth_report()
        notes = dict.fromkeys((*self._notes, *truth.notes, *self._calibration_tally.notes))
        notes.update(dict.fromkeys(self._bag.notes))
        if self._bag.damage is not None:
            notes[f"{self._bag.damage}: read up to the damage"] = None
        return ReadReport(self.format_name, streams, {**self._dropped, **truth.dropped}, tuple(notes))

    def _stream(self, sensors: frozenset[type], tally: ReadTally, *, drops_defects: bool) -> Iterator[Item]:
        """Samples in order, with estimated velocities where the bag has none; image pairs are not decoded."""
        clock = self._clock(tally, drops_defects=drops_defects)
        config, robot = self._config, self._robot
        converter = MessageConverter(
            self._bag, self._roles, robot, config.rosbag, clock, tally, sensors=sensors, drops_broken=drops_defects
        )
        stream = BagStream(self._bag, converter, config.rosbag, tally).in_order(sorts=config.sort)
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
            tally.dropped[f"{item.left.topic}: image pair cannot be decoded"] += 1
            return None
        tally.count(StereoFrame, item.stamp_ns)
        return frame

    def _clock(self, tally: ReadTally, *, drops_defects: bool) -> BagClock:
        return BagClock(
            self._bag,
            uses_header=self._config.rosbag.clock == "header",
            drops_backward=drops_defects,
            keeps_backward=self._config.sort,
            tally=tally,
        )

    def _read_truth(self, *, drops_defects: bool) -> tuple[GroundTruth | None, ReadReport]:
        tally = self._new_tally()
        topic = self._roles.topic("ground_truth")
        if topic is None:
            return self._truth_beside(tally), tally.report()
        clock = self._clock(tally, drops_defects=drops_defects)
        try:
            truth = read_truth(self._bag, topic, self._config.rosbag, clock, tally)
        except TimestampError as error:
            if not drops_defects:
                raise
            tally.note(f"ground truth is not read: {error}")
            truth = None
        return truth, tally.report()

    def _truth_beside(self, tally: ReadTally) -> GroundTruth | None:
        """Ground truth in a file of TUM lines in the bag's folder, where the recording is a folder."""
        texts = tum_files(self._path) if self._path.is_dir() else []
        return read_ground_truth(texts[0], self._config.columns, tally) if texts else None

    def _truth_report(self) -> ReadReport:
        try:
            self.ground_truth()
        except TimestampError as error:
            tally = self._new_tally()
            tally.note(f"ground truth is not read: {error}")
            return tally.report()
        return self._new_tally().report() if self._truth is None else self._truth[1]

    def _calibrated(self) -> BagCalibration:
        if self._calibration is None:
            config = self._config.rosbag
            self._calibration = BagCalibration(
                self._preview,
                self._roles.calibrated_topics(),
                read_frames(self._bag, config.topics.tf_static),
                self._robot,
                config,
                self._calibration_tally,
            )
        return self._calibration

    def _store(self, sensors: frozenset[type], tally: ReadTally) -> None:
        """Store the counts of a finished pass."""
        report = tally.report()
        for sensor in sensors:
            self._counted[STREAM_NAMES[sensor]] = report.stream(STREAM_NAMES[sensor])
        self._dropped.update(report.dropped)
        self._notes.update(dict.fromkeys(report.notes))

    def _missing_joints(self) -> TopicNotFound:
        problem = "" if self._roles.joints is None else "; ".join([self._roles.joints.problem or "", *self._hints()])
        return TopicNotFound(f"{self._bag.origin}: {problem}; --allow-partial (dataset.allow_partial) reads the rest")

    def _no_sample(self, tally: ReadTally) -> DatasetError:
        left_out = dict(tally.report().dropped)
        parts = [note for note in self._notes if not note.startswith(("no ground truth", "joints and foot forces"))]
        joints = self._preview.of_type(JOINT_STATE)
        if self._robot is None and joints:
            has_names = any(self._preview.entries.get(topic) for topic in joints)
            order = "" if has_names else ", and the order of its joints in dataset.rosbag.joint_entries"
            parts.insert(0, f"the joints on {listing(joints)} are not read: name the robot (--robot){order}")
        parts += [f"messages left out: {left_out}"] if left_out else []
        parts += [] if self._bag.damage is None else [self._bag.damage]
        topics = listing((f"{name} ({topic.msgtype})" for name, topic in self._bag.topics.items()), _MOST_TOPICS)
        return DatasetError(
            f"{self._bag.origin} holds no sample that is read: {'; '.join(parts)}; its topics are {topics}"
        )

    def _new_tally(self) -> ReadTally:
        return ReadTally(self.format_name, self._config.gap_s)


def joint_names(path: Path, columns: ColumnNames) -> tuple[Path, tuple[str, ...]]:
    """The bag, and the names of all joints in it; messages without names add none.

    Raises:
        DatasetError: the bag is damaged.
    """
    bag = BagFile(path, allow_partial=True)
    preview = preview_of(bag, {})
    names = {name for topic in preview.of_type(JOINT_STATE) for name in preview.entries.get(topic, ())}
    return path, tuple(sorted(names))


def _count(item: Item, tally: ReadTally) -> None:
    if isinstance(item, RawPair):
        tally.count(StereoFrame, item.stamp_ns)
    else:
        deque(tally.watch([item]), maxlen=0)

# SPDX-License-Identifier: BSD-3-Clause
"""From the first messages of a wire to an estimator: topics by role, calibrations, what is still missing."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from coclo_vio.api.online import make_estimator
from coclo_vio.api.recording import open_recording
from coclo_vio.datasets.joint_velocity import JointVelocityEstimator
from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.datasets.rosbag.bag_calibration import BagCalibration
from coclo_vio.datasets.rosbag.bag_preview import preview_of
from coclo_vio.datasets.rosbag.conversion import MessageConverter
from coclo_vio.datasets.rosbag.mapped_messages import MappedMessages, with_topics
from coclo_vio.datasets.rosbag.message_types import CAMERA_INFO, IMAGES
from coclo_vio.datasets.rosbag.poses import read_frames
from coclo_vio.datasets.rosbag.storage.arrived_messages import ArrivedMessages
from coclo_vio.datasets.rosbag.timing import BagClock
from coclo_vio.datasets.rosbag.topic_roles import TopicRoles, choose_roles
from coclo_vio.live.wire import READ_TYPES, Wants
from coclo_vio.online.guarded_estimator import GuardedEstimator
from coclo_vio.robot.description import RobotDescription
from coclo_vio.runs.equipment import Equipment
from coclo_vio.runs.modes.mode import Mode
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.arrays import BoolArray
from coclo_vio.values.calibration import SensorCalibrations
from coclo_vio.values.errors import ConfigError, DatasetError, listing
from coclo_vio.values.measurements import LEG_SENSORS, CameraImuSample, ImuSample, JointSample, Measurement, StereoFrame


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """An estimator, and what turns the messages of a wire into its measurements.

    Attributes:
        estimator: a fresh one behind the guard.
        config: that of the run, with the IMU's calibration of the wire where that counts.
        sensors: what it reads.
        leg_names: of the robot whose legs it follows.
        messages: decodes messages; None of a source that gives measurements.
        converter: makes measurements of messages; None of a source that gives measurements.
        tally: counts what is left out.
        roles: the topics that are read, by role.
    """

    estimator: GuardedEstimator
    config: RunConfig
    sensors: frozenset[type]
    leg_names: tuple[str, ...]
    messages: MappedMessages | None
    converter: MessageConverter | None
    tally: ReadTally
    roles: Mapping[str, tuple[str, ...]]


def wanted_topics(config: RunConfig) -> frozenset[str]:
    """The topics that are read whatever their type: those that the configuration names, and static transforms."""
    rosbag = config.dataset.rosbag
    topics = rosbag.topics
    named = {topic for topic in topics.model_dump(exclude={"joints", "foot_force"}).values() if topic}
    named |= {*(topics.joints or ()), *(topics.foot_force or {}).values(), *rosbag.types}
    fields = (rosbag.fields.imu, rosbag.fields.camera_imu, rosbag.fields.joints, rosbag.fields.foot_force)
    return frozenset(named | {field.topic for field in fields if field is not None})


def wants_of(config: RunConfig, mode: Mode) -> Wants:
    """Whether messages on a topic of a type are read before the topics of the sensors are chosen."""
    named = wanted_topics(config)
    types = READ_TYPES if mode.has_cameras else READ_TYPES - {*IMAGES, CAMERA_INFO}

    def wants(topic: str, msgtype: str) -> bool:
        return topic in named or msgtype in types

    return wants


def given_calibrations(path: Path | None, config: RunConfig) -> tuple[SensorCalibrations, RunConfig]:
    """The calibrations of a recording; or the configuration with a camchain of Kalibr.

    Args:
        path: of a recording, or of a YAML file of Kalibr; None for neither.
        config: of the run.

    Raises:
        CocloError: it cannot be read.
    """
    if path is None:
        return SensorCalibrations(), config
    if path.suffix.lower() in (".yaml", ".yml"):
        return SensorCalibrations(), config.with_settings([f"dataset.rosbag.kalibr.camchain={path}"])
    return open_recording(path, config.robot).calibration, config


def prepared_of_messages(
    arrived: ArrivedMessages,
    mode: Mode,
    config: RunConfig,
    given: SensorCalibrations,
    pictures_every: int | None = None,
) -> Prepared:
    """An estimator for what has arrived.

    Args:
        arrived: the messages.
        mode: to run.
        config: of the run.
        given: calibrations that go before those of the messages.
        pictures_every: the estimator draws every n-th frame; none if None.

    Raises:
        CocloError: something that the mode needs is missing.
    """
    robot = config.robot if mode.has_legs else None
    rosbag = with_topics(config.dataset.rosbag, robot)
    messages = MappedMessages(arrived, rosbag, robot, allow_partial=True)
    tally = ReadTally(arrived.origin, config.dataset.gap_s)
    preview = preview_of(messages, rosbag.types, rosbag.joint_entries)
    roles = choose_roles(preview, robot, rosbag)
    _check(mode, roles, arrived)
    frames = read_frames(messages, rosbag.topics.tf_static)
    calibration = BagCalibration(preview, roles.calibrated_topics(), frames, robot, rosbag, tally)
    known = SensorCalibrations(
        given.stereo or (calibration.stereo() if mode.has_cameras else None),
        given.imu or calibration.imu("imu"),
        given.camera_imu or calibration.imu("camera_imu"),
    )
    estimator, resolved, sensors = _estimator(mode, config, known, roles.sensors, pictures_every)
    clock = BagClock(
        messages, uses_header=rosbag.clock == "header", drops_backward=True, keeps_backward=True, tally=tally
    )
    converter = MessageConverter(messages, roles, robot, rosbag, clock, tally, sensors=sensors, drops_broken=True)
    if roles.joints is not None:
        _fill_velocities(estimator, resolved, ~roles.joints.has_velocity)
    chosen = {choice.role: choice.topics for choice in roles.choices if choice.topics}
    return Prepared(estimator, resolved, sensors, _legs(robot), messages, converter, tally, chosen)


def prepared_of_measurements(
    found: frozenset[type],
    origin: str,
    mode: Mode,
    config: RunConfig,
    given: SensorCalibrations,
    pictures_every: int | None = None,
) -> Prepared:
    """An estimator for a source that gives measurements.

    Args:
        found: the kinds that have come.
        origin: name of the source.
        mode: to run.
        config: of the run.
        given: calibrations.
        pictures_every: the estimator draws every n-th frame; none if None.

    Raises:
        CocloError: something that the mode needs is missing.
    """
    if mode.has_legs and JointSample not in found:
        raise DatasetError(f"{origin} has given no joint sample that is read; check the names of its columns")
    estimator, resolved, sensors = _estimator(mode, config, given, found | LEG_SENSORS, pictures_every)
    robot = config.robot if mode.has_legs else None
    tally = ReadTally(origin, config.dataset.gap_s)
    if robot is not None:
        _fill_velocities(estimator, resolved, np.zeros(len(robot.joint_names), dtype=np.bool_))
    return Prepared(estimator, resolved, sensors, _legs(robot), None, None, tally, {"log": (origin,)})


def _fill_velocities(estimator: GuardedEstimator, config: RunConfig, is_absent: BoolArray) -> None:
    """Have velocities of joints estimated once the guard has put the samples in order.

    Args:
        estimator: that gets them.
        config: whether all are estimated, and how.
        is_absent: joints whose velocities do not come, (joints,).
    """
    if config.dataset.corrections.joints.velocity == "from_position":
        is_absent = np.ones_like(is_absent)
    if is_absent.any():
        estimator.prepare_with(
            partial(_with_velocity, JointVelocityEstimator(config.dataset.joint_velocity), is_absent)
        )


def _with_velocity(by: JointVelocityEstimator, is_absent: BoolArray, sample: Measurement) -> Measurement:
    if not isinstance(sample, JointSample):
        return sample
    estimated = by.push(sample.stamp_ns, sample.position)
    return sample.with_velocity(np.where(is_absent, estimated, sample.velocity))


def _legs(robot: RobotDescription | None) -> tuple[str, ...]:
    return () if robot is None else robot.leg_names


def _estimator(
    mode: Mode, config: RunConfig, known: SensorCalibrations, found: frozenset[type], pictures_every: int | None
) -> tuple[GuardedEstimator, RunConfig, frozenset[type]]:
    """The estimator, the configuration with the IMU of the wire where that counts, and the sensors that are read."""
    resolved = config.on_recording(known.imu)
    imu = known.imu if resolved.robot is None else None
    sensors = found if known.camera_imu is not None else found - {CameraImuSample}
    calibration = SensorCalibrations(known.stereo, imu, known.camera_imu)
    estimator = make_estimator(
        mode.name,
        robot=resolved.robot,
        calibration=calibration,
        config=resolved,
        sensors=sensors,
        pictures_every=pictures_every,
    )
    body_imu = imu if resolved.robot is None else resolved.robot.imu
    equipment = Equipment(None, body_imu, known.camera_imu, known.stereo, sensors, "the wire")
    return estimator, resolved, mode.sensors_of(equipment) & sensors


def _check(mode: Mode, roles: TopicRoles, arrived: ArrivedMessages) -> None:
    """See that the sensors are there that the mode cannot do without.

    Raises:
        ConfigError: legs without a robot.
        DatasetError: one is missing.
    """
    seen = listing((f"{name} ({topic.msgtype})" for name, topic in arrived.topics.items()), 15)
    if mode.has_legs:
        if roles.joints is None:
            raise ConfigError(f"the mode {mode.name} follows legs: name the robot with --robot")
        if roles.joints.problem is not None:
            raise DatasetError(f"{arrived.origin}: {roles.joints.problem}")
        if ImuSample not in roles.sensors:
            raise DatasetError(
                f"{arrived.origin}: no topic has the body's IMU; the topics seen are {seen}; name it in "
                "dataset.rosbag.topics.imu"
            )
    if mode.has_cameras and StereoFrame not in roles.sensors:
        raise DatasetError(
            f"{arrived.origin}: no two topics are a left and a right image; the topics seen are {seen}; name them in "
            "dataset.rosbag.topics.left_image and right_image"
        )

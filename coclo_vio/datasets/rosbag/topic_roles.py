# SPDX-License-Identifier: BSD-3-Clause
"""The topics that are read of one bag for one robot, role by role, and what the bag lacks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from coclo_vio.datasets.rosbag import message_types
from coclo_vio.datasets.rosbag.bag_preview import BagPreview
from coclo_vio.datasets.rosbag.config import RosbagConfig
from coclo_vio.datasets.rosbag.joints import (
    FootEntry,
    JointEntries,
    choose_joint_topics,
    foot_entries,
    missing_joints,
)
from coclo_vio.datasets.rosbag.reading_parts import span_ns
from coclo_vio.datasets.rosbag.topic_choice import TopicChoice, TopicChooser
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.arrays import BoolArray
from coclo_vio.values.errors import listing
from coclo_vio.values.measurements import CameraImuSample, FootForceSample, ImuSample, JointSample, StereoFrame

_CALIBRATED = ("imu", "camera_imu", "left_image", "right_image", "left_info", "right_info")


@dataclass(frozen=True, slots=True, eq=False)
class BagJoints:
    """The joints of a robot in a bag.

    Attributes:
        entries: finds them in a message.
        topics: the topics that hold them.
        is_present: which joints the bag has, (joints,).
        has_velocity: which of them come with a velocity, (joints,).
        has_names: whether the bag names any joint.
        problem: what is missing, as a sentence, or None.
    """

    entries: JointEntries
    topics: tuple[str, ...]
    is_present: BoolArray
    has_velocity: BoolArray
    has_names: bool
    problem: str | None

    @property
    def has_other_names(self) -> bool:
        """Whether the bag has joints with names, and some of the robot's are not among them."""
        return self.problem is not None and self.has_names


@dataclass(frozen=True, slots=True, eq=False)
class TopicRoles:
    """The topics that are read of a bag.

    Attributes:
        choices: the topic of every role, with the reason.
        joints: None without a robot.
        legs_by_topic: by wrench topic, the index of the leg whose foot it measures.
        foot_entries: by leg, the entry of the joint messages that holds its foot force.
        parts: by topic, name of the part and stamp of its first messages (see ``BagPreview``).
    """

    choices: tuple[TopicChoice, ...]
    joints: BagJoints | None
    legs_by_topic: Mapping[str, int]
    foot_entries: Mapping[str, FootEntry]
    parts: Mapping[str, tuple[tuple[str, int], ...]]

    def span_ns(self, topics: Sequence[str]) -> int:
        """How far apart the messages on ``topics`` come that are parts of one reading, ns."""
        return span_ns([part for topic in topics for part in self.parts.get(topic, ())])

    def topic(self, role: str) -> str | None:
        """The topic of a role, or None."""
        return self.choice(role).topic

    def acceleration_topic(self, role: str) -> str | None:
        """The topic of the accelerations of ``imu`` or ``camera_imu``, where they are not with the rates; or None."""
        topics = self.choice(role).topics
        return topics[1] if len(topics) > 1 else None

    def choice(self, role: str) -> TopicChoice:
        """The choice for a role."""
        return next(choice for choice in self.choices if choice.role == role)

    def calibrated_topics(self) -> dict[str, str | None]:
        """The topics by which sensors are calibrated, by role: images, their infos, IMUs and their accelerations."""
        return {role: self.topic(role) for role in _CALIBRATED} | {
            f"{role}_acceleration": self.acceleration_topic(role) for role in ("imu", "camera_imu")
        }

    @property
    def sensors(self) -> frozenset[type]:
        """The types of measurements that the bag has."""
        is_present = {
            ImuSample: self.topic("imu") is not None,
            CameraImuSample: self.topic("camera_imu") is not None,
            JointSample: self.joints is not None and bool(self.joints.topics),
            FootForceSample: bool(self.legs_by_topic or self.foot_entries),
            StereoFrame: self.topic("left_image") is not None and self.topic("right_image") is not None,
        }
        return frozenset(sensor for sensor, has_it in is_present.items() if has_it)


def choose_roles(preview: BagPreview, robot: RobotDescription | None, config: RosbagConfig) -> TopicRoles:
    """Choose the topic of every role.

    Raises:
        TopicNotFound: a topic that the configuration names is not in the bag.
        DatasetError: the configuration does not fit the robot.
    """
    chooser = TopicChooser(preview, config.topics, None if robot is None else robot.name)
    imu, camera_imu = chooser.imus()
    left, right = chooser.images()
    infos = chooser.infos(left, right)
    joints, joint_choice = (None, _unread(preview)) if robot is None else _joints(preview, robot, config, chooser)
    foot_choice, feet, entries = _feet(preview, robot, config, chooser, joint_choice)
    choices = (joint_choice, imu, camera_imu, left, right, *infos, chooser.ground_truth(), foot_choice)
    legs = () if robot is None else robot.leg_names
    return TopicRoles(choices, joints, {topic: legs.index(leg) for leg, topic in feet.items()}, entries, preview.parts)


def _joints(
    preview: BagPreview, robot: RobotDescription, config: RosbagConfig, chooser: TopicChooser
) -> tuple[BagJoints, TopicChoice]:
    entries = JointEntries(robot, config)
    available = preview.of_type(message_types.JOINT_STATE)
    choice = chooser.joint_topics()
    candidates = available if choice is None else choice.topics
    chosen, is_present = choose_joint_topics(entries, preview, candidates)
    if choice is None:
        reason = f"holds {int(is_present.sum())} of the {len(is_present)} joints of {robot.name}"
        choice = TopicChoice(
            "joints",
            tuple(chosen),
            message_types.JOINT_STATE if chosen else "",
            reason if available else "no JointState",
            tuple(topic for topic in available if topic not in chosen),
        )
    with_velocity = [name for topic in chosen for name in preview.entries_with_velocity.get(topic, ())]
    problem = missing_joints(entries, is_present, preview, candidates)
    has_names = any(preview.entries.get(topic) for topic in candidates)
    has_velocity = entries.found(with_velocity)
    return BagJoints(entries, tuple(chosen), is_present, has_velocity, has_names, problem), choice


def _feet(
    preview: BagPreview,
    robot: RobotDescription | None,
    config: RosbagConfig,
    chooser: TopicChooser,
    joints: TopicChoice,
) -> tuple[TopicChoice, dict[str, str], dict[str, FootEntry]]:
    """Foot forces from wrenches, otherwise from further entries of the joint messages."""
    choice, topics = chooser.foot_forces(robot)
    is_configured = config.foot_force_entries is not None
    if robot is None or (topics and not is_configured) or config.topics.foot_force is not None:
        return choice, topics, {}
    names = [name for topic in joints.topics for name in preview.entries.get(topic, ())]
    entries = foot_entries(robot, config, names)
    if not entries:
        return choice, topics, {}
    placed = ", ".join(f"{leg}: {entry.field}[{entry.key}]" for leg, entry in entries.items())
    why = "named in dataset.rosbag.foot_force_entries" if is_configured else "by their names"
    wrenches = preview.of_type(message_types.WRENCH)
    return TopicChoice("foot_force", joints.topics, joints.msgtype, f"{placed}; {why}", wrenches), {}, entries


def _unread(preview: BagPreview) -> TopicChoice:
    return TopicChoice("joints", (), "", "no robot was named", preview.of_type(message_types.JOINT_STATE))


def notes_of(roles: TopicRoles) -> list[str]:
    """Sentences on what the bag lacks, and on topics that could have been read instead."""
    notes = []
    joints = roles.joints
    if joints is None:
        notes.append("joints and foot forces are not read: no robot was named")
    elif joints.problem is not None:
        notes.append(joints.problem)
    elif not joints.has_velocity.all():
        absent = [name for name, has in zip(joints.entries.joint_names, joints.has_velocity, strict=True) if not has]
        whose = "" if len(absent) == len(joints.has_velocity) else f" of {listing(absent)}"
        notes.append(f"no joint velocity{whose} in the bag: estimated causally from the angles")
    for role in ("imu", "ground_truth"):
        choice = roles.choice(role)
        if choice.topic is None:
            notes.append(f"no {role.replace('_', ' ')}: {choice.reason}")
    for role in ("imu", "camera_imu"):
        acceleration = roles.acceleration_topic(role)
        if acceleration is not None:
            notes.append(
                f"{role}: rates of {roles.topic(role)} and accelerations of {acceleration} are joined, the "
                "accelerations interpolated to the stamps of the rates"
            )
    if roles.choice("camera_imu").topic is None and roles.choice("camera_imu").reason.startswith("only half"):
        notes.append(f"no camera imu: {roles.choice('camera_imu').reason}")
    taken = {topic for choice in roles.choices for topic in choice.topics}
    for role in ("imu", "ground_truth"):
        choice = roles.choice(role)
        unread = [topic for topic in choice.others if topic not in taken]
        if choice.topic is not None and unread:
            notes.append(f"{role}: {choice.topic} is read, not {listing(unread)}")
    return notes

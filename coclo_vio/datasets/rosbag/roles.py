# SPDX-License-Identifier: BSD-3-Clause
"""The roles in one bag for one robot: which topics are read for what, and what is missing."""

from collections.abc import Mapping
from dataclasses import dataclass

from coclo_vio.datasets.rosbag import glance
from coclo_vio.datasets.rosbag.config import RosbagConfig
from coclo_vio.datasets.rosbag.glance import Glance
from coclo_vio.datasets.rosbag.joints import (
    FootEntry,
    JointEntries,
    choose_joint_topics,
    complaint_of_joints,
    foot_entries,
)
from coclo_vio.datasets.rosbag.topics import TopicChoice, TopicGuess
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.arrays import BoolArray
from coclo_vio.values.errors import listing
from coclo_vio.values.measurements import CameraImuSample, FootForceSample, ImuSample, JointSample, StereoFrame


@dataclass(frozen=True, slots=True, eq=False)
class BagJoints:
    """The joints of a robot in a bag.

    Attributes:
        entries: finds them in a message.
        topics: where they are.
        is_there: which joints are anywhere, (joints,).
        has_velocity: which of them come with a velocity, (joints,).
        has_names: whether the bag names any joint.
        complaint: what is missing, as a sentence, or None.
    """

    entries: JointEntries
    topics: tuple[str, ...]
    is_there: BoolArray
    has_velocity: BoolArray
    has_names: bool
    complaint: str | None

    @property
    def are_others(self) -> bool:
        """Whether the bag has joints with names, and some of the robot's are not among them."""
        return self.complaint is not None and self.has_names


@dataclass(frozen=True, slots=True, eq=False)
class BagRoles:
    """What is read of a bag.

    Attributes:
        choices: the topic of every role, with the reason.
        joints: None without a robot.
        legs_by_topic: the leg whose foot a wrench topic measures, by its number.
        foot_entries: where the joint messages hold foot forces, by leg.
    """

    choices: tuple[TopicChoice, ...]
    joints: BagJoints | None
    legs_by_topic: Mapping[str, int]
    foot_entries: Mapping[str, FootEntry]

    def topic(self, role: str) -> str | None:
        """The topic of a role, or None."""
        return self.choice(role).topic

    def choice(self, role: str) -> TopicChoice:
        """What was chosen for a role."""
        return next(choice for choice in self.choices if choice.role == role)

    @property
    def kinds(self) -> frozenset[type]:
        """The sensors that the bag has."""
        is_there = {
            ImuSample: self.topic("imu") is not None,
            CameraImuSample: self.topic("camera_imu") is not None,
            JointSample: self.joints is not None and bool(self.joints.topics),
            FootForceSample: bool(self.legs_by_topic or self.foot_entries),
            StereoFrame: self.topic("left_image") is not None and self.topic("right_image") is not None,
        }
        return frozenset(kind for kind, is_so in is_there.items() if is_so)


def find_roles(seen: Glance, robot: RobotDescription | None, config: RosbagConfig) -> BagRoles:
    """Choose the topics.

    Raises:
        TopicNotFound: a topic that the configuration names is not there.
        DatasetError: the configuration does not fit the robot.
    """
    guess = TopicGuess(seen, config.topics, None if robot is None else robot.name)
    imu, camera_imu = guess.imus()
    left, right = guess.images()
    infos = guess.infos(left, right)
    joints, joint_choice = (None, _unread(seen)) if robot is None else _joints(seen, robot, config, guess)
    foot_choice, feet, entries = _feet(seen, robot, config, guess, joint_choice)
    choices = (joint_choice, imu, camera_imu, left, right, *infos, guess.ground_truth(), foot_choice)
    legs = () if robot is None else robot.leg_names
    return BagRoles(choices, joints, {topic: legs.index(leg) for leg, topic in feet.items()}, entries)


def _joints(
    seen: Glance, robot: RobotDescription, config: RosbagConfig, guess: TopicGuess
) -> tuple[BagJoints, TopicChoice]:
    entries = JointEntries(robot, config)
    there = seen.of_type(glance.JOINT_STATE)
    choice = guess.joint_topics()
    looked_at = there if choice is None else choice.topics
    chosen, has = choose_joint_topics(entries, seen, looked_at)
    if choice is None:
        reason = f"holds {int(has.sum())} of the {len(has)} joints of {robot.name}"
        choice = TopicChoice(
            "joints",
            tuple(chosen),
            glance.JOINT_STATE if chosen else "",
            reason if there else "no JointState",
            tuple(topic for topic in there if topic not in chosen),
        )
    moving = [name for topic in chosen for name in seen.entries_with_velocity.get(topic, ())]
    complaint = complaint_of_joints(entries, has, seen, looked_at)
    has_names = any(seen.entries.get(topic) for topic in looked_at)
    return BagJoints(entries, tuple(chosen), has, entries.found(moving), has_names, complaint), choice


def _feet(
    seen: Glance, robot: RobotDescription | None, config: RosbagConfig, guess: TopicGuess, joints: TopicChoice
) -> tuple[TopicChoice, dict[str, str], dict[str, FootEntry]]:
    """Foot forces from wrenches, otherwise from further entries of the joint messages."""
    choice, topics = guess.foot_forces(robot)
    is_configured = config.foot_force_entries is not None
    if robot is None or (topics and not is_configured) or config.topics.foot_force is not None:
        return choice, topics, {}
    names = [name for topic in joints.topics for name in seen.entries.get(topic, ())]
    entries = foot_entries(robot, config, names)
    if not entries:
        return choice, topics, {}
    said = ", ".join(f"{leg}: {where.field}[{where.entry}]" for leg, where in entries.items())
    why = "named in dataset.rosbag.foot_force_entries" if is_configured else "by their names"
    wrenches = seen.of_type(glance.WRENCH)
    return TopicChoice("foot_force", joints.topics, joints.msgtype, f"{said}; {why}", wrenches), {}, entries


def _unread(seen: Glance) -> TopicChoice:
    return TopicChoice("joints", (), "", "no robot was named", seen.of_type(glance.JOINT_STATE))


def notes_on(roles: BagRoles) -> list[str]:
    """Sentences on what is not there, and on what could have been taken instead."""
    notes = []
    joints = roles.joints
    if joints is None:
        notes.append("joints and feet are left unread: no robot was named")
    elif joints.complaint is not None:
        notes.append(joints.complaint)
    elif not joints.has_velocity.all():
        absent = [name for name, has in zip(joints.entries.joint_names, joints.has_velocity, strict=True) if not has]
        whose = "" if len(absent) == len(joints.has_velocity) else f" of {listing(absent)}"
        notes.append(f"no joint velocity{whose} in the bag: estimated causally from the angles")
    for role in ("imu", "ground_truth"):
        choice = roles.choice(role)
        if choice.topic is None:
            notes.append(f"no {role.replace('_', ' ')}: {choice.reason}")
    taken = {topic for choice in roles.choices for topic in choice.topics}
    for role in ("imu", "ground_truth"):
        choice = roles.choice(role)
        left = [topic for topic in choice.others if topic not in taken]
        if choice.topic is not None and left:
            notes.append(f"{role}: {choice.topic} is read, not {listing(left)}")
    return notes

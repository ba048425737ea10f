# SPDX-License-Identifier: BSD-3-Clause
"""Messages in which fields of any type are read as Imu, JointState and WrenchStamped.

Each reading that ``dataset.rosbag.fields`` names becomes a topic of its own, such as ``/lowstate as imu``, beside those
of the bag. A message without a header has the time at which the origin received it.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from coclo_vio.datasets.rosbag.config import RosbagConfig
from coclo_vio.datasets.rosbag.field_paths import FieldsConfig, ImuFields, JointFields, numbers_at
from coclo_vio.datasets.rosbag.message_types import IMU, JOINT_STATE, WRENCH
from coclo_vio.datasets.rosbag.storage.message_set import BagTopic, MessageSet, RawMessage
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import DatasetError, TopicNotFound, listing

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_UNKNOWN = np.zeros(9)


@dataclass(frozen=True, slots=True)
class _Header:
    frame_id: str


@dataclass(frozen=True, slots=True)
class _Vector:
    x: float
    y: float
    z: float


@dataclass(frozen=True, slots=True)
class _Imu:
    """The fields of Imu that are read."""

    header: _Header
    angular_velocity: _Vector
    linear_acceleration: _Vector
    angular_velocity_covariance: Array = field(default_factory=lambda: _UNKNOWN)
    linear_acceleration_covariance: Array = field(default_factory=lambda: _UNKNOWN)


@dataclass(frozen=True, slots=True)
class _JointState:
    """The fields of JointState that are read."""

    header: _Header
    name: list[str]
    position: Array
    velocity: Array
    effort: Array


@dataclass(frozen=True, slots=True)
class _Wrench:
    force: _Vector


@dataclass(frozen=True, slots=True)
class _WrenchStamped:
    """The fields of WrenchStamped that are read."""

    header: _Header
    wrench: _Wrench


@dataclass(frozen=True, slots=True)
class _Role:
    """A reading in the messages of a topic: its type, and which leg's where it is a foot force."""

    topic: str
    msgtype: str
    fields: Any
    leg: int = 0


class MappedMessages(MessageSet):
    """Those of another set, with topics made of fields beside its own."""

    def __init__(
        self, source: MessageSet, config: RosbagConfig, robot: RobotDescription | None, *, allow_partial: bool
    ) -> None:
        """List the topics.

        Raises:
            TopicNotFound: a topic of ``config.fields`` is not among those of the source.
        """
        self._all = source
        super().__init__(source.origin, is_ros1=source.is_ros1, allow_partial=allow_partial)
        self.topics, self.notes = dict(source.topics), source.notes
        self._robot = robot
        self._roles = _roles(config.fields, robot)
        self._has_header: dict[str, bool] = {}
        self._decoded: tuple[str, bytes, Any] = ("", b"", None)
        for name, role in self._roles.items():
            if role.topic not in self.topics:
                raise TopicNotFound(
                    f"{self.origin} has no topic {role.topic}, which dataset.rosbag.fields names; those there are: "
                    f"{listing(self.topics)}"
                )
            self.topics[name] = BagTopic(name, role.msgtype, self.topics[role.topic].count)

    @property
    def damage(self) -> str | None:
        """What is damaged in the source, which may be found as it is read."""
        return self._all.damage

    @damage.setter
    def damage(self, sentence: str | None) -> None:
        """Damage that is found is that of the source."""
        if sentence is not None:
            self._all.damage = sentence

    def messages(self, names: Collection[str]) -> Iterator[RawMessage]:
        """Those of the source; a message is passed on once for each topic that is made of its fields.

        Raises:
            DatasetError: the source is damaged and partial reading is not allowed.
        """
        carriers = self.carriers(names)
        if carriers == set(names):
            yield from self._all.messages(names)
            return
        for message in self._all.messages(carriers):
            yield from self.expanded(message, names)

    def carriers(self, names: Collection[str]) -> frozenset[str]:
        """The topics of the source whose messages belong to the topics ``names``, or have their fields."""
        return frozenset(self._roles[name].topic if name in self._roles else name for name in names)

    def expanded(self, message: RawMessage, names: Collection[str]) -> Iterator[RawMessage]:
        """The message once for each of the topics ``names`` to which it belongs or that is made of its fields."""
        if message.topic in names:
            yield message
        for name, role in self._roles.items():
            if role.topic == message.topic and name in names:
                yield message._replace(topic=name)

    def typed(self, topic: str) -> "tuple[str, Typestore]":
        """The type of a topic of the source and its message definitions."""
        return self._all.typed(topic)

    def decoded(self, topic: str, data: bytes) -> Any:
        """As ``MessageSet.decoded``; of a topic made of fields a message with those that are read of its type.

        Raises:
            DatasetError: the bytes do not fit the type, or the type has no such fields.
        """
        role = self._roles.get(topic)
        if role is None:
            return self._all.decoded(topic, data)
        message = self._source(role.topic, data)
        header = getattr(message, "header", None)
        frame = str(getattr(header, "frame_id", ""))
        match role.fields:
            case ImuFields() as imu:
                rate, force = (_three(message, path, role.topic) for path in (imu.gyroscope, imu.accelerometer))
                return _Imu(_Header(imu.frame or frame), rate, force)
            case JointFields() as joints:
                return self._joints(message, joints, frame)
        forces = numbers_at(message, role.fields.force, role.topic)
        if role.leg >= len(forces):
            raise DatasetError(
                f"{role.fields.force} of the messages on {role.topic} holds {len(forces)} forces, fewer than there are "
                "legs; name its legs in dataset.rosbag.fields.foot_force.legs"
            )
        return _WrenchStamped(_Header(frame), _Wrench(_Vector(0.0, 0.0, float(forces[role.leg]))))

    def header_stamp_ns(self, topic: str, data: bytes) -> int:
        """As ``MessageSet.header_stamp_ns``; 0 for a message without a header."""
        role = self._roles.get(topic)
        if role is None:
            return self._all.header_stamp_ns(topic, data)
        return self._all.header_stamp_ns(role.topic, data) if self._with_header(role.topic, data) else 0

    def is_stamped_on_arrival(self, message: RawMessage) -> bool:
        """Whether the message has no header, so that its time is that of its arrival."""
        role = self._roles.get(message.topic)
        return role is not None and not self._with_header(role.topic, message.data)

    def _with_header(self, topic: str, data: bytes) -> bool:
        if topic not in self._has_header:
            first = next(iter(vars_of(self._source(topic, data))), "")
            self._has_header[topic] = first == "header"
            if first != "header":
                self.notes.append(
                    f"the messages on {topic} have no header: they are stamped with the time at which they were "
                    "received"
                )
        return self._has_header[topic]

    def _source(self, topic: str, data: bytes) -> Any:
        """The message of the source, decoded once for all topics that are made of it."""
        known, of, message = self._decoded
        if known != topic or of is not data:
            message = self._all.decoded(topic, data)
            self._decoded = topic, data, message
        return message

    def _joints(self, message: Any, joints: JointFields, frame: str) -> _JointState:
        readings = [
            np.zeros(0) if path is None else numbers_at(message, path, joints.topic)
            for path in (joints.position, joints.velocity, joints.effort)
        ]
        names = list(joints.names or (() if self._robot is None else self._robot.joint_names))
        if names and len(names) != len(readings[0]):
            raise DatasetError(
                f"{joints.position} of the messages on {joints.topic} holds {len(readings[0])} angles, but there are "
                f"{len(names)} names of joints; correct dataset.rosbag.fields.joints"
            )
        return _JointState(_Header(frame), names, *readings)


def with_topics(config: RosbagConfig, robot: RobotDescription | None) -> RosbagConfig:
    """The configuration with the topics made of fields in their roles, and a topic of each foot."""
    roles = _roles(config.fields, robot)
    if not roles:
        return config
    topics: dict[str, Any] = {}
    feet: dict[str, str] = {}
    for name, role in roles.items():
        match role.msgtype:
            case "sensor_msgs/msg/Imu":
                topics[name.rpartition(" ")[2]] = name
            case "sensor_msgs/msg/JointState":
                topics["joints"] = (name,)
            case _:
                feet[name.rpartition(" ")[2]] = name
    topics |= {"foot_force": feet} if feet else {}
    changes = {"topics": config.topics.model_copy(update=topics)}
    return config.model_copy(update=changes | ({"foot_force_component": "z"} if feet else {}))


def vars_of(message: Any) -> tuple[str, ...]:
    """The names of a message's fields, in order."""
    return tuple(name for name in getattr(message, "__dataclass_fields__", ()) if not name.startswith("__"))


def _roles(config: FieldsConfig, robot: RobotDescription | None) -> dict[str, _Role]:
    roles = {}
    for name, imu in (("imu", config.imu), ("camera_imu", config.camera_imu)):
        if imu is not None:
            roles[f"{imu.topic} as {name}"] = _Role(imu.topic, IMU, imu)
    if config.joints is not None:
        roles[f"{config.joints.topic} as joints"] = _Role(config.joints.topic, JOINT_STATE, config.joints)
    feet = config.foot_force
    if feet is not None:
        for number, leg in enumerate(feet.legs or (() if robot is None else robot.leg_names)):
            roles[f"{feet.topic} as foot {leg}"] = _Role(feet.topic, WRENCH, feet, number)
    return roles


def _three(message: Any, path: str, topic: str) -> _Vector:
    numbers = numbers_at(message, path, topic)
    if len(numbers) != 3:
        raise DatasetError(
            f"{path} of the messages on {topic} holds {len(numbers)} numbers, not the 3 of an IMU; correct "
            "dataset.rosbag.fields"
        )
    return _Vector(*(float(number) for number in numbers))

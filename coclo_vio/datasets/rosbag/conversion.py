# SPDX-License-Identifier: BSD-3-Clause
"""Measurements from ROS messages, one at a time: the one converter of bags and of wires.

Which message holds which reading is in ``TopicRoles``; parts of a reading that come apart are joined.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.datasets.rosbag.config import RosbagConfig
from coclo_vio.datasets.rosbag.imu_bytes import ImuReader
from coclo_vio.datasets.rosbag.imu_halves import ImuUnion
from coclo_vio.datasets.rosbag.joints import read_feet, wrench_force
from coclo_vio.datasets.rosbag.reading_parts import ReadingAssembler, tolerance_ns
from coclo_vio.datasets.rosbag.stereo_pairing import RawImage, RawPair, StereoPairer
from coclo_vio.datasets.rosbag.storage.message_set import MessageSet, RawMessage
from coclo_vio.datasets.rosbag.timing import BagClock
from coclo_vio.datasets.rosbag.topic_roles import TopicRoles
from coclo_vio.datasets.sequencer import order_key
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.arrays import BoolArray, is_finite
from coclo_vio.values.errors import DatasetError, shortened
from coclo_vio.values.measurements import (
    CameraImuSample,
    FootForceSample,
    ImuSample,
    JointSample,
    Measurement,
    StereoFrame,
)
from coclo_vio.values.units import NS_PER_S

_UNLIKE = (AttributeError, TypeError, ValueError, IndexError, OverflowError)  # a message with other fields
_NO_PIXEL = np.zeros((1, 1), dtype=np.uint8)
_STEREO_RANK = order_key(StereoFrame(0, _NO_PIXEL, _NO_PIXEL))[1]

Item = Measurement | RawPair
_Handler = Callable[[RawMessage, int], Iterator[Item]]


class MessageConverter:
    """Samples of the chosen sensors from messages; image pairs are not yet decoded.

    Attributes:
        topics: those whose messages it takes.
    """

    def __init__(
        self,
        messages: MessageSet,
        roles: TopicRoles,
        robot: RobotDescription | None,
        config: RosbagConfig,
        clock: BagClock,
        tally: ReadTally,
        *,
        sensors: frozenset[type],
        drops_broken: bool,
    ) -> None:
        """Prepare the conversion.

        Args:
            messages: decodes them.
            roles: the topic of every role.
            robot: describes joints and legs.
            config: tolerances, signs and names.
            clock: stamps the messages.
            tally: counts what is left out.
            sensors: those that are read.
            drops_broken: leave out messages that cannot be decoded; otherwise they are an error.
        """
        self._messages, self._roles, self._config, self._clock, self._tally = messages, roles, config, clock, tally
        self._legs = () if robot is None else robot.leg_names
        self._drops_broken = drops_broken
        expected_legs = np.array([i in roles.legs_by_topic.values() for i in range(len(self._legs))], dtype=np.bool_)
        expected_joints = np.zeros(0, dtype=np.bool_) if roles.joints is None else roles.joints.is_present
        self._spans = {
            "joints": roles.span_ns(() if roles.joints is None else roles.joints.topics),
            "foot forces": roles.span_ns(tuple(roles.legs_by_topic)),
        }
        self._feet = self._assembler(expected_legs, self._spans["foot forces"])
        self._joints = self._assembler(expected_joints, self._spans["joints"])
        self._imu = ImuReader(messages)
        self._unions: list[ImuUnion] = []
        self._pairs = StereoPairer(roles.topic("left_image") or "", round(config.pair_tolerance_s * NS_PER_S), tally)
        self._handlers = self._handlers_of(sensors)
        self.topics = frozenset(self._handlers)

    def push(self, message: RawMessage) -> Iterator[Item]:
        """The samples that a message on one of ``topics`` completes.

        Raises:
            DatasetError: it cannot be decoded, or its stamp goes back, unless such messages are dropped.
        """
        stamp_ns = self._clock.stamp_ns(message)
        if stamp_ns is not None:
            for handler in self._handlers[message.topic]:
                yield from self._read(handler, message, stamp_ns)

    def finish(self) -> Iterator[Item]:
        """The readings that are still incomplete at the end; notes on them go to the tally."""
        for stamp_ns, force in self._feet.finish():
            yield FootForceSample(stamp_ns, force)
        for stamp_ns, values in self._joints.finish():
            yield JointSample(stamp_ns, *values)
        for assembler, (what, span) in zip((self._joints, self._feet), self._spans.items(), strict=True):
            assembler.describe(what, span, self._tally)
        for union in self._unions:
            union.finish()
        self._pairs.finish()

    def _assembler(self, is_expected: BoolArray, span: int) -> ReadingAssembler:
        pair_ns, parts_s = round(self._config.pair_tolerance_s * NS_PER_S), self._config.parts_tolerance_s
        tolerance = tolerance_ns(span, pair_ns) if parts_s is None else round(parts_s * NS_PER_S)
        return ReadingAssembler(is_expected, tolerance)

    def _handlers_of(self, sensors: frozenset[type]) -> dict[str, list[_Handler]]:
        """The handlers of the messages of each topic that is read."""
        roles = self._roles
        found: dict[str, list[_Handler]] = {}
        read = sensors & roles.sensors
        if FootForceSample in read:
            for topic in roles.legs_by_topic or roles.choice("foot_force").topics:
                found.setdefault(topic, []).append(self._wrench if roles.legs_by_topic else self._feet_of_joints)
        for sensor, role in ((ImuSample, "imu"), (CameraImuSample, "camera_imu")):
            if sensor in read:
                self._add_imu(found, sensor, role)
        if JointSample in read and roles.joints is not None:
            for topic in roles.joints.topics:
                found.setdefault(topic, []).append(self._joint_state)
        if StereoFrame in read:
            for role in ("left_image", "right_image"):
                found.setdefault(roles.topic(role) or "", []).append(self._image)
        return found

    def _add_imu(
        self, found: dict[str, list[_Handler]], sensor: type[ImuSample] | type[CameraImuSample], role: str
    ) -> None:
        topic, acceleration = self._roles.topic(role) or "", self._roles.acceleration_topic(role)
        if acceleration is None:
            found.setdefault(topic, []).append(self._inertial(sensor))
            return
        union = ImuUnion(topic, self._tally)
        self._unions.append(union)
        found.setdefault(topic, []).append(self._half(sensor, union, is_rate=True))
        found.setdefault(acceleration, []).append(self._half(sensor, union, is_rate=False))

    def _half(self, sensor: type[ImuSample] | type[CameraImuSample], union: ImuUnion, *, is_rate: bool) -> _Handler:
        def handle(message: RawMessage, stamp_ns: int) -> Iterator[Item]:
            rate, force = self._imu.read(message.topic, message.data)
            reading = rate if is_rate else force
            if not is_finite(reading):
                self._tally.dropped[f"{message.topic}: IMU reading empty or NaN"] += 1
                return
            complete = union.add_rate(stamp_ns, reading) if is_rate else union.add_acceleration(stamp_ns, reading)
            for at_ns, whole_rate, whole_force in complete:
                yield sensor(at_ns, whole_rate, whole_force)

        return handle

    def _read(self, handler: _Handler, message: RawMessage, stamp_ns: int) -> Iterator[Item]:
        try:
            yield from handler(message, stamp_ns)
        except DatasetError:
            if not self._drops_broken:
                raise
            self._tally.dropped[f"{message.topic}: message cannot be decoded"] += 1
        except (
            AttributeError,
            TypeError,
            ValueError,
            IndexError,
            OverflowError,
        ) as error:  # other fields than the first
            if not self._drops_broken:
                raise DatasetError(
                    f"{self._messages.origin}: a message on {message.topic} at {stamp_ns} ns is not like the first of "
                    f"its topic ({shortened(error)}); --allow-partial (dataset.allow_partial) leaves it out"
                ) from error
            self._tally.dropped[f"{message.topic}: message is not like the first of its topic"] += 1

    def _decoded(self, message: RawMessage) -> Any:
        return self._messages.decoded(message.topic, message.data)

    def _inertial(self, sensor: type[ImuSample] | type[CameraImuSample]) -> _Handler:
        def handle(message: RawMessage, stamp_ns: int) -> Iterator[Item]:
            rate, force = self._imu.read(message.topic, message.data)
            if is_finite(rate) and is_finite(force):
                yield sensor(stamp_ns, rate, force)
            else:
                self._tally.dropped[f"{message.topic}: IMU reading empty or NaN"] += 1

        return handle

    def _joint_state(self, message: RawMessage, stamp_ns: int) -> Iterator[Item]:
        if self._roles.joints is None:
            return
        values, is_present = self._roles.joints.entries.read(self._decoded(message))
        if not is_present.any():
            return
        for complete_ns, complete in self._joints.push(stamp_ns, self._clock.match_ns(message), values, is_present):
            yield JointSample(complete_ns, *complete)

    def _feet_of_joints(self, message: RawMessage, stamp_ns: int) -> Iterator[Item]:
        joint_state = self._decoded(message)
        force = read_feet(joint_state, self._roles.foot_entries, self._legs, self._config.joint_entries)
        if not np.isnan(force).all():
            yield FootForceSample(stamp_ns, force)

    def _wrench(self, message: RawMessage, stamp_ns: int) -> Iterator[Item]:
        leg = self._roles.legs_by_topic[message.topic]
        is_present = np.arange(len(self._legs)) == leg
        value = wrench_force(self._decoded(message), self._config.foot_force_component)
        force = np.where(is_present, value, np.nan)
        for complete_ns, complete in self._feet.push(stamp_ns, self._clock.match_ns(message), force, is_present):
            yield FootForceSample(complete_ns, complete)

    def _image(self, message: RawMessage, stamp_ns: int) -> Iterator[Item]:
        yield from self._pairs.push(RawImage(stamp_ns, self._clock.match_ns(message), message.topic, message.data))


def item_key(item: Item) -> tuple[int, int]:
    """The place of an item among those of its time, as ``order_key`` has it."""
    return (item.stamp_ns, _STEREO_RANK) if isinstance(item, RawPair) else order_key(item)

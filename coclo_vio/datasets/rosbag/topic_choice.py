# SPDX-License-Identifier: BSD-3-Clause
"""The topic that is read for each role: as configured, otherwise inferred from types and names, always with a reason.

Typical names: RealSense (``/camera/infra1/image_rect_raw``, ``/camera/imu``), EuRoC (``/cam0/image_raw``, ``/imu0``),
Cerberus (``/hardware_a1/joint_foot``, ``/hardware_a1/imu``), ``vicon_bridge`` (``/vicon/<robot>/<robot>``).
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from coclo_vio.datasets.rosbag import message_types
from coclo_vio.datasets.rosbag.bag_preview import BagPreview
from coclo_vio.datasets.rosbag.config import NO_TOPIC, RosbagTopics
from coclo_vio.datasets.rosbag.imu_halves import BOTH, nearest_by_name
from coclo_vio.datasets.rosbag.message_types import IMAGES, POSES
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.errors import TopicNotFound, listing

_CONFIGURED = "named in dataset.rosbag.topics"
_OF_FIELDS = "fields named in dataset.rosbag.fields"
_JOINED = "rates and accelerations are on two topics and are joined"
_LEFT_OUT = "left out in dataset.rosbag.topics"
_CAMERA = re.compile(r"camera|(?<![a-z])cam\d*(?![a-z])|realsense|d4[0-9]5|t265|infra|(?<![a-z])(zed|oak|mynt)")
_NO_STEREO = re.compile(r"depth(?!_?cam)|colou?r|rgb|mask|disparity|theora|confidence")
_TRUTH = re.compile(r"vicon|mocap|optitrack|qualisys|vrpn|natnet|ground_?truth|(?<![a-z])gt(?![a-z])|leica|phasespace")
_SIDES = (
    ("infra1", "infra2"),
    ("left", "right"),
    ("cam0", "cam1"),
    ("camera0", "camera1"),
    ("cam_0", "cam_1"),
    ("fisheye1", "fisheye2"),
    ("cam1", "cam2"),
)


@dataclass(frozen=True, slots=True)
class TopicChoice:
    """The topic chosen for a role, and why.

    Attributes:
        role: ``joints``, ``imu``, ``camera_imu``, ``left_image``, ``right_image``, ``left_info``, ``right_info``,
            ``ground_truth`` or ``foot_force``.
        topics: the chosen topics; several where joints or feet are spread over topics, rates and accelerations of an
            IMU where they are on two; none where none fits.
        msgtype: their type, empty without a topic.
        reason: why these, or why none.
        others: further topics of a type that fits.
    """

    role: str
    topics: tuple[str, ...]
    msgtype: str
    reason: str
    others: tuple[str, ...]

    @property
    def topic(self) -> str | None:
        """The topic (the first of several), or None."""
        return self.topics[0] if self.topics else None


class TopicChooser:
    """Chooses the topics of a bag role by role."""

    def __init__(self, preview: BagPreview, configured: RosbagTopics, robot_name: str | None) -> None:
        self._preview = preview
        self._configured = configured
        self._robot_name = robot_name

    def imus(self) -> tuple[TopicChoice, TopicChoice]:
        """The body's IMU and the camera's, distinguished by topic name and frame.

        One whose rates and accelerations are on two topics has both, the rates first.

        Raises:
            TopicNotFound: a configured topic is not in the bag, or has only half of an IMU and no other has the rest.
        """
        available = self._preview.of_type(message_types.IMU)
        of_camera = [topic for topic in available if _CAMERA.search(f"{topic} {self._preview.frame(topic)}".lower())]
        of_body = [topic for topic in available if topic not in of_camera]
        configured = {self._configured.imu, self._configured.camera_imu}
        choices = []
        for role, candidates, why, why_none in (
            ("imu", of_body, "not a camera's by name and frame", "only IMUs of a camera"),
            ("camera_imu", of_camera, "a camera's by its name or frame", "none has a camera's name or frame"),
        ):
            choice = self._from_config(role, getattr(self._configured, role), (message_types.IMU,))
            free = [topic for topic in candidates if topic not in configured]
            if choice is not None:
                choice = self._whole_imu(choice)
            elif not available:
                choice = self._chosen(role, [], available, "no topic is of type Imu")
            else:
                choice = self._inferred_imu(role, free, why, why_none)
            choices.append(choice)
        return choices[0], choices[1]

    def _inferred_imu(self, role: str, candidates: Sequence[str], why: str, why_none: str) -> TopicChoice:
        """A complete IMU among the candidates, otherwise two halves of one, otherwise what is missing."""
        halves = self._preview.halves
        available = self._preview.of_type(message_types.IMU)
        complete = sorted((topic for topic in candidates if halves[topic].is_complete), key=self._imu_rank)
        if complete:
            return self._whole_imu(self._chosen(role, complete[:1], available, why))
        rates = [topic for topic in candidates if halves[topic].has_rates]
        for topic in sorted(rates, key=self._imu_rank):
            other = self._accelerations_of(role, topic, candidates)
            if other is not None:
                return self._chosen(role, [topic, other], available, f"{_JOINED}; {why}")
        if candidates:
            lacks = "; ".join(f"{topic} has {halves[topic].absent} ({halves[topic].why})" for topic in candidates)
            return self._chosen(role, [], available, f"only half of one: {lacks}")
        return self._chosen(role, [], available, why_none)

    def _whole_imu(self, choice: TopicChoice) -> TopicChoice:
        """A chosen IMU with the topic of its other half, where it has only one.

        Raises:
            TopicNotFound: there is no such topic.
        """
        role, topic = choice.role, choice.topic
        explicit = getattr(self._configured, f"{role}_acceleration")
        self._from_config(f"{role}_acceleration", explicit, (message_types.IMU,))
        halves = BOTH if topic is None else self._preview.halves[topic]
        if topic is None or (halves.is_complete and not explicit):
            return choice
        available = self._preview.of_type(message_types.IMU)
        pair: tuple[str | None, str | None]
        if halves.has_rates:
            pair = topic, self._accelerations_of(role, topic, available)
        else:
            with_rates = [other for other in available if self._preview.halves[other].has_rates and other != topic]
            alone = [other for other in with_rates if not self._preview.halves[other].is_complete]
            pair = nearest_by_name(topic, alone) if halves.has_accelerations else None, topic
        if pair[0] is None or pair[1] is None:
            raise TopicNotFound(
                f"the Imu messages on {topic} have {halves.absent} ({halves.why}), and no other topic is half an IMU "
                f"that has them: name a whole IMU in dataset.rosbag.topics.{role}, or its accelerations in "
                f"dataset.rosbag.topics.{role}_acceleration; the Imu topics are: {listing(available)}"
            )
        return self._chosen(role, [str(one) for one in pair], available, f"{_JOINED}; {choice.reason}")

    def _accelerations_of(self, role: str, topic: str, candidates: Sequence[str]) -> str | None:
        """The topic with the accelerations to the rates on ``topic``: as configured, otherwise a half by its name."""
        configured = getattr(self._configured, f"{role}_acceleration")
        if configured is not None:
            return configured or None
        halves = self._preview.halves
        alone = [one for one in candidates if halves[one].has_accelerations and not halves[one].has_rates]
        return nearest_by_name(topic, alone)

    def images(self) -> tuple[TopicChoice, TopicChoice]:
        """The left and the right image, whose names differ in one part (infra1/infra2, left/right, cam0/cam1).

        Raises:
            TopicNotFound: a configured topic is not in the bag.
        """
        available = [topic for topic in self._preview.of_type(*IMAGES) if not _NO_STEREO.search(topic.lower())]
        left = self._from_config("left_image", self._configured.left_image, IMAGES)
        right = self._from_config("right_image", self._configured.right_image, IMAGES)
        pairs = [
            pair
            for pair in self._pairs(available)
            if (left is None or left.topic == pair[0]) and (right is None or right.topic == pair[1])
        ]
        best = min(pairs, key=self._pair_rank) if pairs else None
        why = "a pair by name" if best else "no two image topics whose names differ as left and right"
        return (
            left or self._chosen("left_image", [best[0]] if best else [], available, why),
            right or self._chosen("right_image", [best[1]] if best else [], available, why),
        )

    def infos(self, left: TopicChoice, right: TopicChoice) -> tuple[TopicChoice, TopicChoice]:
        """The CameraInfo beside each image.

        Raises:
            TopicNotFound: a configured topic is not in the bag.
        """
        available = self._preview.of_type(message_types.CAMERA_INFO)
        choices = []
        for role, image in (("left_info", left), ("right_info", right)):
            choice = self._from_config(role, getattr(self._configured, role), (message_types.CAMERA_INFO,))
            if choice is None:
                beside = [info for info in available if _is_beside(info, image.topic)]
                beside = sorted(beside, key=len, reverse=True)[:1]
                why = "beside its image" if beside else "none beside its image"
                choice = self._chosen(role, beside, available, why)
            choices.append(choice)
        if choices[0].topics and choices[0].topics == choices[1].topics and self._configured.left_info is None:
            why = "the only CameraInfo cannot be that of both images"
            choices = [self._chosen(choice.role, [], available, why) for choice in choices]
        return choices[0], choices[1]

    def ground_truth(self) -> TopicChoice:
        """The poses of the body from a tracking system, by the system's name; the robot's name goes first.

        Raises:
            TopicNotFound: the configured topic is not in the bag.
        """
        choice = self._from_config("ground_truth", self._configured.ground_truth, POSES)
        if choice is not None:
            return choice
        available = self._preview.of_type(*POSES)
        named = sorted((topic for topic in available if _TRUTH.search(topic.lower())), key=self._truth_rank)
        why = "the name of a tracking system" if named else "no pose with the name of a tracking system"
        return self._chosen("ground_truth", named[:1], available, why)

    def foot_forces(self, robot: RobotDescription | None) -> tuple[TopicChoice, dict[str, str]]:
        """The wrench of each leg's foot, by the leg's name in the topic's; the topics by leg.

        Raises:
            TopicNotFound: a configured topic is not in the bag, or its leg is none of the robot's.
        """
        configured = self._configured.foot_force
        available = self._preview.of_type(message_types.WRENCH)
        if robot is None:
            return self._chosen("foot_force", [], available, "no robot was named"), {}
        if configured is None:
            found = {leg: topic for leg in robot.leg_names if (topic := _of_leg(leg, available)) is not None}
            why = "the legs' names" if found else "no wrench with the name of a leg"
        else:
            found, why = configured, _reason_of(next(iter(configured.values()))) if configured else _LEFT_OUT
            unknown = set(configured) - set(robot.leg_names)
            if unknown:
                raise TopicNotFound(
                    f"dataset.rosbag.topics.foot_force names the legs {listing(unknown)}; "
                    f"the legs of {robot.name} are {listing(robot.leg_names)}"
                )
            for topic in configured.values():
                self._from_config("foot_force", topic, (message_types.WRENCH,))
        return self._chosen("foot_force", list(found.values()), available, why), found

    def joint_topics(self) -> TopicChoice | None:
        """The joints' topics as configured; None where they are to be inferred from the joints they hold.

        Raises:
            TopicNotFound: a configured topic is not in the bag.
        """
        configured = self._configured.joints
        if configured is None:
            return None
        for topic in configured:
            self._from_config("joints", topic, (message_types.JOINT_STATE,))
        why = _reason_of(configured[0]) if configured else _LEFT_OUT
        return self._chosen("joints", configured, self._preview.of_type(message_types.JOINT_STATE), why)

    def _from_config(self, role: str, topic: str | None, msgtypes: Sequence[str]) -> TopicChoice | None:
        if topic is None:
            return None
        available = self._preview.of_type(*msgtypes)
        if topic == NO_TOPIC:
            return self._chosen(role, [], available, _LEFT_OUT)
        if topic not in available:
            msgtype = self._preview.types.get(topic)
            problem = f"has no message on {topic}" if msgtype is None else f"has {topic}, but as {msgtype}"
            raise TopicNotFound(
                f"the bag {problem}, which dataset.rosbag.topics names as {role} ({' or '.join(msgtypes)}); "
                f"the topics of that type are: {listing(available)}"
            )
        return self._chosen(role, [topic], available, _reason_of(topic))

    def _chosen(self, role: str, topics: Sequence[str], available: Sequence[str], reason: str) -> TopicChoice:
        msgtype = self._preview.types[topics[0]] if topics else ""
        if topics and len(available) == 1 and reason not in (_CONFIGURED, _OF_FIELDS):
            reason = f"the only one of its type; {reason}"
        others = tuple(topic for topic in available if topic not in topics)
        return TopicChoice(role, tuple(topics), msgtype, reason, others)

    def _imu_rank(self, topic: str) -> tuple[bool, int, str]:
        is_plain = re.search(r"(^|/)imu\d?(/data)?$", topic) is not None
        return not is_plain, -self._preview.counts[topic], topic

    def _truth_rank(self, topic: str) -> tuple[bool, int, str]:
        has_name = self._robot_name is not None and self._robot_name.lower() in topic.lower()
        return not has_name, -self._preview.counts[topic], topic

    def _pair_rank(self, pair: tuple[str, str]) -> tuple[bool, bool, bool, str]:
        most = max(self._preview.counts[topic] for topic in self._preview.of_type(*IMAGES))
        is_sparse = self._preview.counts[pair[0]] < 0.9 * most
        is_compressed = self._preview.types[pair[0]] == message_types.COMPRESSED_IMAGE
        return is_sparse, "rect" not in pair[0], is_compressed, pair[0]

    def _pairs(self, available: Sequence[str]) -> list[tuple[str, str]]:
        return [
            (left, right)
            for left in available
            for left_part, right_part in _SIDES
            if left_part in left and (right := left.replace(left_part, right_part)) in available
            if self._preview.types[left] == self._preview.types[right]
        ]


def _reason_of(topic: str) -> str:
    """Why a configured topic is read: no name of ROS has blanks, those of topics made of fields do."""
    return _OF_FIELDS if " " in topic else _CONFIGURED


def _is_beside(info: str, image: str | None) -> bool:
    """Whether ``/a/b/camera_info`` is of ``/a/b/image`` or of something further below ``/a/b``."""
    return image is not None and image.startswith(info.rpartition("/")[0] + "/")


def _of_leg(leg: str, available: Sequence[str]) -> str | None:
    named = [t for t in available if re.search(rf"(?<![a-z0-9]){re.escape(leg.lower())}(?![a-z0-9])", t.lower())]
    return min(named, key=lambda t: (re.search("foot|force|contact", t.lower()) is None, t), default=None)

# SPDX-License-Identifier: BSD-3-Clause
"""Which topic of a bag plays which role: as configured, otherwise guessed from types and names, always with a reason.

Typical names: RealSense (``/camera/infra1/image_rect_raw``, ``/camera/imu``), EuRoC (``/cam0/image_raw``, ``/imu0``),
Cerberus (``/hardware_a1/joint_foot``, ``/hardware_a1/imu``), ``vicon_bridge`` (``/vicon/<robot>/<robot>``).
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from coclo_vio.datasets.rosbag import glance
from coclo_vio.datasets.rosbag.config import NO_TOPIC, RosbagTopics
from coclo_vio.datasets.rosbag.glance import Glance
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.errors import TopicNotFound, listing

IMAGES = (glance.IMAGE, glance.COMPRESSED_IMAGE)
POSES = (glance.TRANSFORM, glance.POSE, glance.POSE_WITH_COVARIANCE, glance.ODOMETRY)

_CONFIGURED = "named in dataset.rosbag.topics"
_NONE_ASKED = "left out in dataset.rosbag.topics"
_CAMERA = re.compile(r"camera|(?<![a-z])cam\d*(?![a-z])|realsense|d4[0-9]5|t265|infra|(?<![a-z])(zed|oak|mynt)")
_HALF_IMU = re.compile(r"/(accel|gyro)/(sample|imu_info)")
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
    """The topic that plays a role, and why.

    Attributes:
        role: ``joints``, ``imu``, ``camera_imu``, ``left_image``, ``right_image``, ``left_info``, ``right_info``,
            ``ground_truth`` or ``foot_force``.
        topics: what was chosen; several where joints or feet are spread over several topics, none where there is none.
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
        """The one topic (the first of several), or None."""
        return self.topics[0] if self.topics else None


class TopicGuess:
    """Chooses topics one role at a time."""

    def __init__(self, seen: Glance, given: RosbagTopics, robot_name: str | None) -> None:
        self._seen = seen
        self._given = given
        self._robot_name = robot_name

    def imus(self) -> tuple[TopicChoice, TopicChoice]:
        """The body's IMU and the camera's, told apart by topic name and frame.

        Raises:
            TopicNotFound: a configured topic is not there.
        """
        there = self._seen.of_type(glance.IMU)
        whole = [topic for topic in there if not _HALF_IMU.search(topic.lower())]
        of_camera = [topic for topic in whole if _CAMERA.search(f"{topic} {self._seen.frame(topic)}".lower())]
        taken = {self._given.imu, self._given.camera_imu}
        choices = []
        for role, candidates, yes, no in (
            (
                "imu",
                [t for t in whole if t not in of_camera],
                "not a camera's by name and frame",
                "none but a camera's",
            ),
            ("camera_imu", of_camera, "a camera's by its name or frame", "none has a camera's name or frame"),
        ):
            choice = self._configured(role, getattr(self._given, role), (glance.IMU,))
            if choice is None and not there:
                choice = self._chosen(role, [], there, "no topic is of type Imu")
            elif choice is None:
                free = sorted((t for t in candidates if t not in taken), key=self._imu_rank)
                choice = self._chosen(role, free[:1], there, yes if free else no)
            choices.append(choice)
        return choices[0], choices[1]

    def images(self) -> tuple[TopicChoice, TopicChoice]:
        """The left and the right image, whose names differ in one word (infra1/infra2, left/right, cam0/cam1).

        Raises:
            TopicNotFound: a configured topic is not there.
        """
        there = [topic for topic in self._seen.of_type(*IMAGES) if not _NO_STEREO.search(topic.lower())]
        left = self._configured("left_image", self._given.left_image, IMAGES)
        right = self._configured("right_image", self._given.right_image, IMAGES)
        pairs = [
            pair
            for pair in self._pairs(there)
            if (left is None or left.topic == pair[0]) and (right is None or right.topic == pair[1])
        ]
        best = min(pairs, key=self._pair_rank) if pairs else None
        why = "a pair by name" if best else "no two image topics that differ as left and right do"
        return (
            left or self._chosen("left_image", [best[0]] if best else [], there, why),
            right or self._chosen("right_image", [best[1]] if best else [], there, why),
        )

    def infos(self, left: TopicChoice, right: TopicChoice) -> tuple[TopicChoice, TopicChoice]:
        """The CameraInfo beside each image.

        Raises:
            TopicNotFound: a configured topic is not there.
        """
        there = self._seen.of_type(glance.CAMERA_INFO)
        choices = []
        for role, image in (("left_info", left), ("right_info", right)):
            choice = self._configured(role, getattr(self._given, role), (glance.CAMERA_INFO,))
            if choice is None:
                beside = [info for info in there if _is_beside(info, image.topic)]
                beside = sorted(beside, key=len, reverse=True)[:1]
                choice = self._chosen(role, beside, there, "beside its image" if beside else "none beside its image")
            choices.append(choice)
        if choices[0].topics and choices[0].topics == choices[1].topics and self._given.left_info is None:
            return tuple(  # type: ignore[return-value]
                self._chosen(choice.role, [], there, "one CameraInfo cannot be that of both") for choice in choices
            )
        return choices[0], choices[1]

    def ground_truth(self) -> TopicChoice:
        """The poses of the body as somebody else saw them: by the name of a tracking system, the robot's name first.

        Raises:
            TopicNotFound: the configured topic is not there.
        """
        choice = self._configured("ground_truth", self._given.ground_truth, POSES)
        if choice is not None:
            return choice
        there = self._seen.of_type(*POSES)
        named = sorted((t for t in there if _TRUTH.search(t.lower())), key=self._truth_rank)
        why = "the name of a tracking system" if named else "no pose with the name of a tracking system"
        return self._chosen("ground_truth", named[:1], there, why)

    def foot_forces(self, robot: RobotDescription | None) -> tuple[TopicChoice, dict[str, str]]:
        """The wrench of each leg's foot, by the leg's name in the topic's; the topics by leg.

        Raises:
            TopicNotFound: a configured topic is not there, or its leg is none of the robot's.
        """
        given = self._given.foot_force
        there = self._seen.of_type(glance.WRENCH)
        if robot is None:
            return self._chosen("foot_force", [], there, "no robot was named"), {}
        if given is None:
            found = {leg: topic for leg in robot.leg_names if (topic := _of_leg(leg, there)) is not None}
            why = "the legs' names" if found else "no wrench with the name of a leg"
        else:
            found, why = given, _CONFIGURED if given else _NONE_ASKED
            strangers = set(given) - set(robot.leg_names)
            if strangers:
                raise TopicNotFound(
                    f"dataset.rosbag.topics.foot_force names the legs {listing(strangers)}; "
                    f"the legs of {robot.name} are {listing(robot.leg_names)}"
                )
            for topic in given.values():
                self._configured("foot_force", topic, (glance.WRENCH,))
        return self._chosen("foot_force", list(found.values()), there, why), found

    def joint_topics(self) -> TopicChoice | None:
        """The joints' topics as configured, None where they are to be guessed by the joints they hold.

        Raises:
            TopicNotFound: a configured topic is not there.
        """
        given = self._given.joints
        if given is None:
            return None
        for topic in given:
            self._configured("joints", topic, (glance.JOINT_STATE,))
        why = _CONFIGURED if given else _NONE_ASKED
        return self._chosen("joints", given, self._seen.of_type(glance.JOINT_STATE), why)

    def _configured(self, role: str, topic: str | None, msgtypes: Sequence[str]) -> TopicChoice | None:
        if topic is None:
            return None
        there = self._seen.of_type(*msgtypes)
        if topic == NO_TOPIC:
            return self._chosen(role, [], there, _NONE_ASKED)
        if topic not in there:
            kind = self._seen.types.get(topic)
            what = f"has no message on {topic}" if kind is None else f"has {topic}, but as {kind}"
            raise TopicNotFound(
                f"the bag {what}, which dataset.rosbag.topics wants as {role} ({' or '.join(msgtypes)}); "
                f"of that type there are: {listing(there)}"
            )
        return self._chosen(role, [topic], there, _CONFIGURED)

    def _chosen(self, role: str, topics: Sequence[str], there: Sequence[str], reason: str) -> TopicChoice:
        msgtype = self._seen.types[topics[0]] if topics else ""
        if topics and len(there) == 1 and reason != _CONFIGURED:
            reason = f"the only one of its type; {reason}"
        return TopicChoice(role, tuple(topics), msgtype, reason, tuple(t for t in there if t not in topics))

    def _imu_rank(self, topic: str) -> tuple[bool, int, str]:
        is_plain = re.search(r"(^|/)imu\d?(/data)?$", topic) is not None
        return not is_plain, -self._seen.counts[topic], topic

    def _truth_rank(self, topic: str) -> tuple[bool, int, str]:
        has_name = self._robot_name is not None and self._robot_name.lower() in topic.lower()
        return not has_name, -self._seen.counts[topic], topic

    def _pair_rank(self, pair: tuple[str, str]) -> tuple[bool, bool, bool, str]:
        most = max(self._seen.counts[topic] for topic in self._seen.of_type(*IMAGES))
        is_sparse = self._seen.counts[pair[0]] < 0.9 * most
        is_compressed = self._seen.types[pair[0]] == glance.COMPRESSED_IMAGE
        return is_sparse, "rect" not in pair[0], is_compressed, pair[0]

    def _pairs(self, there: Sequence[str]) -> list[tuple[str, str]]:
        return [
            (topic, other)
            for topic in there
            for left, right in _SIDES
            if left in topic and (other := topic.replace(left, right)) in there
            if self._seen.types[topic] == self._seen.types[other]
        ]


def _is_beside(info: str, image: str | None) -> bool:
    """Whether ``/a/b/camera_info`` is of ``/a/b/image`` or of something further below ``/a/b``."""
    return image is not None and image.startswith(info.rpartition("/")[0] + "/")


def _of_leg(leg: str, there: Sequence[str]) -> str | None:
    named = [t for t in there if re.search(rf"(?<![a-z0-9]){re.escape(leg.lower())}(?![a-z0-9])", t.lower())]
    return min(named, key=lambda t: (re.search("foot|force|contact", t.lower()) is None, t), default=None)

# SPDX-License-Identifier: BSD-3-Clause
"""How a rosbag is read: which topic plays which role, whose names its joints have, whose clock is believed.

Everything may be left out: topics are then guessed from their types and names (``topics``).
"""

from typing import Annotated, Literal

from pydantic import Field, field_validator

from coclo_vio.datasets.kalibr import KalibrConfig
from coclo_vio.values.calibration import Angle, Triple
from coclo_vio.values.config import StageConfig

NO_TOPIC = ""

_Topic = Annotated[str | None, Field(description="a topic; null guesses, an empty string reads none")]


class RosbagTopics(StageConfig):
    """Which topic plays which role. A role that is null is guessed, an empty string leaves it out."""

    joints: Annotated[
        tuple[str, ...] | None,
        Field(description="JointState topics, together they hold the joints; null guesses, an empty list reads none"),
    ] = None
    imu: _Topic = None
    camera_imu: _Topic = None
    left_image: _Topic = None
    right_image: _Topic = None
    left_info: _Topic = None
    right_info: _Topic = None
    ground_truth: _Topic = None
    foot_force: Annotated[
        dict[str, str] | None,
        Field(description="WrenchStamped topic of each leg; null guesses, an empty mapping reads none"),
    ] = None
    tf_static: Annotated[str, Field(description="topic of the mountings, TFMessage")] = "/tf_static"


class RosbagConfig(StageConfig):
    """What a reader of rosbags may be told."""

    topics: Annotated[RosbagTopics, Field(description="which topic plays which role")] = RosbagTopics()
    types: dict[str, str] = Field(
        default_factory=dict,
        description="topic: the type it is taken for, where the bag names one of its own with the same fields, "
        "such as sensor_msgs/msg/Imu",
    )
    clock: Annotated[
        Literal["header", "received"],
        Field(description="whose time is believed: the stamp in the message's header, or when the bag received it"),
    ] = "header"
    joint_names: dict[str, str] = Field(
        default_factory=dict, description="URDF joint name: its name in the bag, where they differ"
    )
    joint_signs: dict[str, Literal[-1, 1]] = Field(
        default_factory=dict, description="URDF joint name: -1 where the bag counts it the other way round"
    )
    joint_entries: Annotated[
        tuple[str, ...], Field(description="names of the entries of a JointState that carries none, in their order")
    ] = ()
    foot_force_entries: Annotated[
        dict[str, str] | str | None,
        Field(
            description="foot forces among the joints: leg: entry, such as FL: FL_foot or FL: effort[12]; or one range "
            "for all legs in the robot's order, such as effort[12:16]; null guesses by name, an empty string reads none"
        ),
    ] = None
    foot_force_component: Annotated[
        Literal["z", "norm"], Field(description="what of a WrenchStamped's force is the foot force")
    ] = "z"
    pair_tolerance_s: Annotated[
        float, Field(ge=0, le=1, description="stamps this close are one time: left and right image, parts of one robot")
    ] = 0.0005
    reorder_s: Annotated[
        float, Field(gt=0, le=60, description="messages are put in order over this span of the bag's time, s")
    ] = 1.0
    body_frame: Annotated[
        str | None, Field(description="name of the body in the mountings; null takes the robot's, base_link, ...")
    ] = None
    is_rectified: Annotated[
        bool | None,
        Field(description="whether images are rectified; null: where the topic's name says rect, not rect_raw"),
    ] = None
    object_position_body_m: Annotated[
        Triple, Field(description="origin of the tracked object (Vicon), body frame, m")
    ] = (0.0, 0.0, 0.0)
    rotation_body_object_rpy_rad: Annotated[
        tuple[Angle, Angle, Angle], Field(description="roll, pitch, yaw of R_body_object (R = Rz Ry Rx), rad")
    ] = (0.0, 0.0, 0.0)
    kalibr: Annotated[KalibrConfig, Field(description="calibration files of Kalibr, for what the bag lacks")] = (
        KalibrConfig()
    )

    @field_validator("types")
    @classmethod
    def _types_are_whole(cls, types: dict[str, str]) -> dict[str, str]:
        for topic, msgtype in types.items():
            if msgtype.count("/") != 2 or "/msg/" not in msgtype:
                raise ValueError(f"the type of {topic} must be written like sensor_msgs/msg/Imu, got {msgtype!r}")
        return types

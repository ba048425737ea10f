# SPDX-License-Identifier: BSD-3-Clause
"""How a rosbag is read: the topic of every role, the names of the joints, the clock.

All keys are optional: without them topics are inferred from their types and names (``topic_choice``).
"""

from typing import Annotated, Literal

from pydantic import Field, field_validator

from coclo_vio.datasets.kalibr import KalibrConfig
from coclo_vio.datasets.rosbag.field_paths import FieldsConfig
from coclo_vio.values.calibration import Angle, Triple
from coclo_vio.values.config import StageConfig

NO_TOPIC = ""

_Topic = Annotated[str | None, Field(description="a topic; null infers it, an empty string reads none")]


_Acceleration = Annotated[
    str | None,
    Field(description="the accelerations of that IMU, where its topic has only rates; null infers the topic"),
]


class RosbagTopics(StageConfig):
    """The topic of every role. A role that is null is inferred, an empty string leaves it out."""

    joints: Annotated[
        tuple[str, ...] | None,
        Field(description="JointState topics that together hold the joints; null infers, an empty list reads none"),
    ] = None
    imu: _Topic = None
    imu_acceleration: _Acceleration = None
    camera_imu: _Topic = None
    camera_imu_acceleration: _Acceleration = None
    left_image: _Topic = None
    right_image: _Topic = None
    left_info: _Topic = None
    right_info: _Topic = None
    ground_truth: _Topic = None
    foot_force: Annotated[
        dict[str, str] | None,
        Field(description="WrenchStamped topic of each leg; null infers, an empty mapping reads none"),
    ] = None
    tf_static: Annotated[str, Field(description="topic of the static transforms, TFMessage")] = "/tf_static"


class RosbagConfig(StageConfig):
    """Configuration of the rosbag reader."""

    topics: Annotated[RosbagTopics, Field(description="the topic of every role")] = RosbagTopics()
    types: dict[str, str] = Field(
        default_factory=dict,
        description="topic: the type to read it as, where the bag names a type of its own with the same fields, "
        "such as sensor_msgs/msg/Imu",
    )
    fields: Annotated[
        FieldsConfig, Field(description="readings in messages of any type, by the paths of their fields")
    ] = FieldsConfig()
    clock: Annotated[
        Literal["header", "received"],
        Field(description="source of the stamps: the message's header, or the time at which the bag received it"),
    ] = "header"
    joint_names: dict[str, str] = Field(
        default_factory=dict, description="URDF joint name: its name in the bag, where they differ"
    )
    joint_signs: dict[str, Literal[-1, 1]] = Field(
        default_factory=dict, description="URDF joint name: -1 where the bag has the opposite sign"
    )
    joint_entries: Annotated[
        tuple[str, ...],
        Field(
            description="names of the entries of a JointState, in order, where it has none or not one for each angle"
        ),
    ] = ()
    foot_force_entries: Annotated[
        dict[str, str] | str | None,
        Field(
            description="foot forces among the joints: leg: entry, such as FL: FL_foot or FL: effort[12]; or one range "
            "for all legs in the robot's order, such as effort[12:16]; null infers by name, an empty string reads none"
        ),
    ] = None
    foot_force_component: Annotated[
        Literal["z", "norm"], Field(description="the foot force of a WrenchStamped: z or norm of its force")
    ] = "z"
    pair_tolerance_s: Annotated[
        float,
        Field(ge=0, le=1, description="tolerance of equal stamps: left and right image, parts of a reading, s"),
    ] = 0.0005
    parts_tolerance_s: Annotated[
        float | None,
        Field(
            ge=0,
            le=1,
            description="joints, and feet, of several topics or messages are one sample where their stamps are within "
            "this, s; null: as far apart as the first messages are, 0.02 at most",
        ),
    ] = None
    reorder_s: Annotated[
        float, Field(gt=0, le=60, description="messages are sorted within this span of the bag's time, s")
    ] = 1.0
    body_frame: Annotated[
        str | None,
        Field(description="body frame in the static transforms; null: the robot's or base_link, base, ..."),
    ] = None
    is_rectified: Annotated[
        bool | None,
        Field(description="whether images are rectified; null: where the topic's name holds rect, not rect_raw"),
    ] = None
    object_position_body_m: Annotated[
        Triple, Field(description="origin of the tracked object (Vicon), body frame, m")
    ] = (0.0, 0.0, 0.0)
    rotation_body_object_rpy_rad: Annotated[
        tuple[Angle, Angle, Angle], Field(description="roll, pitch, yaw of R_body_object (R = Rz Ry Rx), rad")
    ] = (0.0, 0.0, 0.0)
    kalibr: Annotated[KalibrConfig, Field(description="calibration files of Kalibr")] = KalibrConfig()

    @field_validator("types")
    @classmethod
    def _types_are_complete(cls, types: dict[str, str]) -> dict[str, str]:
        for topic, msgtype in types.items():
            if msgtype.count("/") != 2 or "/msg/" not in msgtype:
                raise ValueError(f"the type of {topic} must be written like sensor_msgs/msg/Imu, got {msgtype!r}")
        return types

# SPDX-License-Identifier: BSD-3-Clause
"""Fields of messages of any type by path: which field of which topic is which reading, as configuration.

A path is the names of fields with dots between them, each with an index or a range where it is a list:
``imu_state.gyroscope``, ``motor_state[0:12].q``, ``data[6]``. It leads to a number, a list of numbers, or a vector with
x, y and z.
"""

import re
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field

from coclo_vio.values.arrays import Array
from coclo_vio.values.config import StageConfig
from coclo_vio.values.errors import DatasetError, listing, shortened

_PART = re.compile(r"(?P<name>[A-Za-z_]\w*)(?:\[(?P<start>\d{1,6})(?P<range>:(?P<stop>\d{1,6}))?\])?")


def _checked(path: str) -> str:
    for part in path.split("."):
        if _PART.fullmatch(part) is None:
            raise ValueError(f"a path is names with dots between them, such as motor_state[0:12].q; {part!r} is none")
    return path


FieldPath = Annotated[str, AfterValidator(_checked)]
_Topic = Annotated[str, Field(min_length=1, description="the topic, of any type")]


class ImuFields(StageConfig):
    """An IMU in messages of another type than Imu."""

    topic: _Topic
    gyroscope: Annotated[FieldPath, Field(description="3 angular velocities, rad/s")]
    accelerometer: Annotated[FieldPath, Field(description="3 specific forces, m/s^2")]
    frame: Annotated[str, Field(description="frame of its axes in the static transforms; empty for the body's")] = ""


class JointFields(StageConfig):
    """Joints in messages of another type than JointState."""

    topic: _Topic
    position: Annotated[FieldPath, Field(description="joint angles, rad")]
    velocity: Annotated[FieldPath | None, Field(description="joint velocities, rad/s; null: not recorded")] = None
    effort: Annotated[FieldPath | None, Field(description="joint torques, Nm; null: not recorded")] = None
    names: Annotated[
        tuple[str, ...], Field(description="names of the joints in the order of the fields; empty: the robot's order")
    ] = ()


class FootForceFields(StageConfig):
    """Foot forces in messages of another type than WrenchStamped."""

    topic: _Topic
    force: Annotated[FieldPath, Field(description="a force for each leg, in the unit of the robot's thresholds")]
    legs: Annotated[
        tuple[str, ...], Field(description="names of the legs in the order of the field; empty: the robot's order")
    ] = ()


class FieldsConfig(StageConfig):
    """Readings in messages of any type."""

    imu: Annotated[ImuFields | None, Field(description="the body's IMU")] = None
    camera_imu: Annotated[ImuFields | None, Field(description="the camera's IMU")] = None
    joints: Annotated[JointFields | None, Field(description="the joints")] = None
    foot_force: Annotated[FootForceFields | None, Field(description="the foot forces")] = None


def numbers_at(message: Any, path: str, topic: str) -> Array:
    """The numbers at a path of a message, (n,).

    Raises:
        DatasetError: there is no such field, or it holds no numbers; lists the fields there are.
    """
    values = [message]
    for part in path.split("."):
        match = _PART.fullmatch(part)
        values = [inner for value in values for inner in _inside(value, match, topic)] if match else []
    try:
        return np.array([number for value in values for number in _flat(value)], dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise DatasetError(
            f"{path} of the messages on {topic} holds no numbers; correct dataset.rosbag.fields"
        ) from error


def _inside(value: Any, match: re.Match[str], topic: str) -> Sequence[Any]:
    inner = getattr(value, match["name"], None)
    if inner is None:
        known = [field.name for field in fields(value) if not field.name.startswith("_")] if is_dataclass(value) else []
        raise DatasetError(
            f"the messages on {topic} have no field {match['name']} ({match[0]}); those there are: {listing(known)}; "
            "correct dataset.rosbag.fields"
        )
    if match["start"] is None:
        return [inner]
    start = int(match["start"])
    stop = int(match["stop"]) if match["range"] else start + 1
    if not hasattr(inner, "__len__") or not start < stop <= len(inner):
        length = len(inner) if hasattr(inner, "__len__") else "no"
        raise DatasetError(
            f"{shortened(match[0])} of the messages on {topic} is out of range: {match['name']} has {length} entries; "
            "correct dataset.rosbag.fields"
        )
    return list(inner[start:stop])


def _flat(value: Any) -> Sequence[Any]:
    if all(hasattr(value, axis) for axis in "xyz"):
        return [value.x, value.y, value.z]
    return list(value) if isinstance(value, np.ndarray | list | tuple) else [value]

# SPDX-License-Identifier: BSD-3-Clause
"""Readings straight from the bytes of Imu messages, in a tenth of the time of decoding whole messages.

Of a message ``sensor_msgs/Imu`` only the frame's name has no fixed length: header, orientation (4 numbers),
covariance (9), angular velocity (3), covariance (9), linear acceleration (3), covariance (9), all of 8 bytes.
"""

import struct
from dataclasses import fields
from typing import Any

import numpy as np

from coclo_vio.datasets.rosbag.storage.message_set import MessageSet
from coclo_vio.values.arrays import Array

_FIELDS = (
    "header",
    "orientation",
    "orientation_covariance",
    "angular_velocity",
    "angular_velocity_covariance",
    "linear_acceleration",
    "linear_acceleration_covariance",
)
_NUMBERS = 37
_RATE, _FORCE = slice(13, 16), slice(25, 28)
_RATE_VARIANCE, _FORCE_VARIANCE = 16, 28
_UNKNOWN = (0.0,)


class ImuReader:
    """The readings of the Imu messages of a bag.

    A topic whose type has other fields, and a message of another length than the layout has, are decoded as a whole.
    """

    def __init__(self, bag: MessageSet) -> None:
        self._bag = bag
        self._is_standard: dict[str, bool] = {}

    def read(self, topic: str, data: bytes) -> tuple[Array, Array]:
        """Angular velocity and linear acceleration, (3,) each, as in the message.

        Raises:
            DatasetError: the message does not decode as its type.
        """
        if self._is_standard.get(topic, False):
            numbers = numbers_of(data, is_ros1=self._bag.is_ros1)
            if numbers is not None:
                return numbers[_RATE], numbers[_FORCE]
        imu = self._bag.decoded(topic, data)
        if topic not in self._is_standard:
            self._is_standard[topic] = _has_standard_fields(imu)
        rate, force = imu.angular_velocity, imu.linear_acceleration
        return np.array([rate.x, rate.y, rate.z]), np.array([force.x, force.y, force.z])

    def variances(self, topic: str, data: bytes) -> tuple[float, float]:
        """The first elements of the covariances of angular velocity and linear acceleration, -1 for no reading.

        Raises:
            DatasetError: the message does not decode as its type.
        """
        numbers = numbers_of(data, is_ros1=self._bag.is_ros1) if self._is_standard.get(topic, False) else None
        if numbers is not None:
            return float(numbers[_RATE_VARIANCE]), float(numbers[_FORCE_VARIANCE])
        imu = self._bag.decoded(topic, data)
        rate, force = (getattr(imu, f"{name}_covariance", _UNKNOWN) for name in (_FIELDS[3], _FIELDS[5]))
        return float(rate[0]), float(force[0])


def numbers_of(data: bytes, *, is_ros1: bool) -> Array | None:
    """The 37 numbers after the header, (37,); None where the length is another or the encoding is not plain."""
    if is_ros1:
        if len(data) < 16:
            return None
        start, order = 16 + struct.unpack_from("<I", data, 12)[0], "<"
    else:
        if len(data) < 16 or data[0] != 0 or data[1] > 1:  # not CDR
            return None
        order = "<" if data[1] else ">"
        length = struct.unpack_from(f"{order}I", data, 12)[0]
        start = 4 + (12 + length + 7) // 8 * 8  # numbers are aligned to their size, counted from the fourth byte
    if len(data) != start + 8 * _NUMBERS:
        return None
    return np.frombuffer(data, dtype=f"{order}f8", count=_NUMBERS, offset=start)


def _has_standard_fields(imu: Any) -> bool:
    return _names(imu) == _FIELDS and _names(imu.header)[-2:] == ("stamp", "frame_id")


def _names(message: Any) -> tuple[str, ...]:
    return tuple(field.name for field in fields(message) if not field.name.startswith("__"))

# SPDX-License-Identifier: BSD-3-Clause
"""Measurements: frozen values, one class per sensor, stamped in integer nanoseconds.

Readers make them; filter, front end and smoother process them. Arrays are checked once, here, and are read-only.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import ClassVar, Literal

import numpy as np

from coclo_vio.values.arrays import Array, ByteImage, IntArray, checked, frozen, read_only
from coclo_vio.values.errors import TimestampError


def check_stamp(sample: "Measurement | InertialReading") -> None:
    """See that the stamp of a sample is an integer, as nanoseconds are.

    Raises:
        TimestampError: it is another type, such as float seconds.
    """
    stamp_ns = sample.stamp_ns
    if type(stamp_ns) is int:
        return
    if not isinstance(stamp_ns, int | np.integer) or isinstance(stamp_ns, bool):
        raise TimestampError(
            f"{type(sample).__name__}.stamp_ns must be integer nanoseconds, got {stamp_ns!r} "
            f"({type(stamp_ns).__name__}); of seconds it is round(seconds * 1e9)"
        )


class _Sample:
    """A stamp and arrays of one length, which go to another process as one piece and are not checked again there."""

    __slots__ = ()
    _ARRAYS: ClassVar[tuple[str, ...]]
    stamp_ns: int

    def __reduce__(self) -> tuple[Callable[..., object], tuple[type, int, bytes]]:
        arrays = (getattr(self, name) for name in self._ARRAYS)
        return _of_bytes, (type(self), self.stamp_ns, b"".join(array.tobytes() for array in arrays))


def _of_bytes(kind: type[_Sample], stamp_ns: int, packed: bytes) -> _Sample:
    sample = object.__new__(kind)
    frozen(sample, "stamp_ns", stamp_ns)
    arrays = np.frombuffer(packed).reshape(len(kind._ARRAYS), -1)
    for name, array in zip(kind._ARRAYS, arrays, strict=True):
        frozen(sample, name, array)
    return sample


@dataclass(frozen=True, slots=True, eq=False)
class InertialReading(_Sample):
    """One reading of an inertial measurement unit, in the frame of that unit.

    Attributes:
        stamp_ns: time in nanoseconds.
        angular_velocity: gyroscope, rad/s, (3,).
        specific_force: accelerometer, m/s^2, (3,); at rest it points up, with a norm of 9.81.

    Raises:
        ValueError: a wrong shape, or a reading that is not finite.
    """

    _ARRAYS = ("angular_velocity", "specific_force")

    stamp_ns: int
    angular_velocity: Array
    specific_force: Array

    def __post_init__(self) -> None:
        check_stamp(self)
        name = type(self).__name__
        frozen(self, "angular_velocity", checked(f"{name}.angular_velocity", self.angular_velocity, (3,)))
        frozen(self, "specific_force", checked(f"{name}.specific_force", self.specific_force, (3,)))


class ImuSample(InertialReading):
    """A reading of the body's IMU, in the imu frame."""

    __slots__ = ()


class CameraImuSample(InertialReading):
    """A reading of the camera's IMU, in the frame of that IMU; its vibration is the camera's, not the body's."""

    __slots__ = ()


@dataclass(frozen=True, slots=True, eq=False)
class JointSample(_Sample):
    """One reading of all leg joints, in the order of ``RobotModel.joint_names``.

    NaN marks a joint without a reading; its leg is left out, the others are used.

    Attributes:
        stamp_ns: time in nanoseconds.
        position: rad, (joints,).
        velocity: rad/s, (joints,).
        effort: Nm, (joints,), as measured: the motor's torque on the joint; all NaN on a robot that measures none.

    Raises:
        ValueError: arrays of different length, or an infinite reading.
    """

    _ARRAYS = ("position", "velocity", "effort")

    stamp_ns: int
    position: Array
    velocity: Array
    effort: Array

    def __post_init__(self) -> None:
        check_stamp(self)
        frozen(self, "position", checked("JointSample.position", self.position, (None,), allow_nan=True))
        shape = (len(self.position),)
        frozen(self, "velocity", checked("JointSample.velocity", self.velocity, shape, allow_nan=True))
        frozen(self, "effort", checked("JointSample.effort", self.effort, shape, allow_nan=True))

    def with_velocity(self, velocity: Array) -> "JointSample":
        """The same reading with other velocities, rad/s, (joints,).

        Raises:
            ValueError: another length, or an infinite velocity.
        """
        sample = object.__new__(JointSample)  # without the checks of what has been checked
        for name in ("stamp_ns", "position", "effort"):
            frozen(sample, name, getattr(self, name))
        shape = self.position.shape
        frozen(sample, "velocity", checked("JointSample.velocity", velocity, shape, allow_nan=True))
        return sample


@dataclass(frozen=True, slots=True, eq=False)
class FootForceSample(_Sample):
    """One reading of the foot sensors, in the order of the robot's legs.

    Attributes:
        stamp_ns: time in nanoseconds.
        force: normal force, (legs,), in the unit of the robot's contact thresholds (N or raw counts); NaN where a
            sensor has no reading.

    Raises:
        ValueError: not a vector, or an infinite reading.
    """

    _ARRAYS = ("force",)

    stamp_ns: int
    force: Array

    def __post_init__(self) -> None:
        check_stamp(self)
        frozen(self, "force", checked("FootForceSample.force", self.force, (None,), allow_nan=True))


@dataclass(frozen=True, slots=True, eq=False)
class StereoFrame:
    """Two grey images taken at the same time.

    Attributes:
        stamp_ns: time of the middle of the exposure, in nanoseconds.
        left: of the left camera, (rows, columns), uint8.
        right: of the right camera, the same shape, uint8.

    Raises:
        ValueError: an image is not grey with 8 bits, or the two differ in size.
    """

    stamp_ns: int
    left: ByteImage
    right: ByteImage

    def __post_init__(self) -> None:
        check_stamp(self)
        for side in ("left", "right"):
            image = getattr(self, side)
            if image.ndim != 2 or image.dtype != np.uint8:
                raise ValueError(
                    f"StereoFrame.{side} must be (rows, columns) of uint8, got {image.shape} {image.dtype}"
                )
            frozen(self, side, read_only(image))
        if self.left.shape != self.right.shape:
            raise ValueError(f"the left image is {self.left.shape}, the right one {self.right.shape}; they must agree")


@dataclass(frozen=True, slots=True)
class EncodedStereoFrame:
    """A stereo frame as two compressed image files.

    Attributes:
        stamp_ns: time of the middle of the exposure, in nanoseconds.
        left: file content of the left image, grey.
        right: file content of the right image, grey.
        encoding: format of the files.
    """

    stamp_ns: int
    left: bytes
    right: bytes
    encoding: Literal["png", "jpeg"]


class TrackingQuality(Enum):
    """How well a frame's points could be tracked."""

    HEALTHY = "healthy"
    DEGRADED = "degraded"
    LOST = "lost"


@dataclass(frozen=True, slots=True, eq=False)
class StereoTracks:
    """Tracks of points: their pixels in both images of a frame, and identities that persist from frame to frame.

    Pixels are those of rectified images: rows agree, and left minus right column is the disparity.

    Attributes:
        stamp_ns: time of the frame, in nanoseconds.
        track_ids: one per point, the same in every frame, never reused, (N,), int64.
        left_px: columns and rows in the left image, (N, 2).
        right_px: the same in the right image, (N, 2); NaN where the point is not matched there.
        ages: frames of the track so far, this one included, (N,), int64; ones by default.
        quality: how well points could be tracked.
        reason: why the quality is not healthy; empty where it is.

    Raises:
        ValueError: a wrong shape, a repeated identity, or a pixel that is not finite.
    """

    stamp_ns: int
    track_ids: IntArray
    left_px: Array
    right_px: Array
    ages: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    quality: TrackingQuality = TrackingQuality.HEALTHY
    reason: str = ""

    def __post_init__(self) -> None:
        check_stamp(self)
        frozen(self, "left_px", checked("StereoTracks.left_px", self.left_px, (None, 2)))
        count = len(self.left_px)
        frozen(self, "right_px", checked("StereoTracks.right_px", self.right_px, (count, 2), allow_nan=True))
        for name in ("track_ids", "ages"):
            values = np.array(getattr(self, name), dtype=np.int64)
            if name == "ages" and not len(values):
                values = np.ones(count, dtype=np.int64)
            if values.shape != (count,):
                raise ValueError(f"StereoTracks.{name} must have shape {(count,)}, got {values.shape}")
            values.flags.writeable = False
            frozen(self, name, values)
        if len(np.unique(self.track_ids)) != count:
            raise ValueError(f"StereoTracks.track_ids has a repeated identity at {self.stamp_ns} ns")

    def __len__(self) -> int:
        return len(self.track_ids)


@dataclass(frozen=True, slots=True, eq=False)
class BodyTwistSample:
    """Velocity of the body from an external source: wheel odometry, a flow sensor, a controller.

    Attributes:
        stamp_ns: time in nanoseconds.
        angular_velocity: rad/s, body frame, (3,).
        velocity: of the body origin, m/s, body frame, (3,).

    Raises:
        ValueError: a wrong shape, or a reading that is not finite.
    """

    stamp_ns: int
    angular_velocity: Array
    velocity: Array

    def __post_init__(self) -> None:
        check_stamp(self)
        for name in ("angular_velocity", "velocity"):
            frozen(self, name, checked(f"BodyTwistSample.{name}", getattr(self, name), (3,)))


Measurement = ImuSample | CameraImuSample | JointSample | FootForceSample | StereoFrame | StereoTracks | BodyTwistSample

IMAGE_SENSORS: frozenset[type] = frozenset({StereoFrame, StereoTracks})
IMU_SENSORS: frozenset[type] = frozenset({ImuSample, CameraImuSample})
LEG_SENSORS: frozenset[type] = frozenset({ImuSample, JointSample, FootForceSample})
VISION_SENSORS: frozenset[type] = frozenset({CameraImuSample, StereoFrame, StereoTracks, BodyTwistSample})
ALL_SENSORS = LEG_SENSORS | VISION_SENSORS

# SPDX-License-Identifier: BSD-3-Clause
"""ROS 1 or ROS 2 messages from the values of this package. Poses keep all digits of their quaternions."""

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Literal, Protocol

import numpy as np

from coclo_vio.datasets.images import ImageEncoding
from coclo_vio.datasets.rosbag.writing.new_bag import TF_MESSAGE
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import CameraCalibration
from coclo_vio.values.measurements import InertialReading, JointSample
from coclo_vio.values.units import NS_PER_S

_UNKNOWN = np.zeros(9)
_ABSENT = np.array([-1.0, *[0.0] * 8])
_EMPTY = np.zeros(0)


class MessageTypes(Protocol):
    """The message classes of one version of ROS; a ``NewBag`` has them, and the ``TypeDefinitions`` of a wire.

    Attributes:
        types: the classes by name, such as ``sensor_msgs/msg/Imu``.
    """

    types: dict[str, Any]

    @property
    def ros(self) -> Literal[1, 2]:
        """The version of ROS."""


class BagMessages:
    """Makes the messages of one bag or wire; each method is named after the message it makes."""

    def __init__(self, bag: MessageTypes) -> None:
        self._types = bag.types
        self._has_seq = bag.ros == 1

    def _make(self, msgtype: str, *fields: Any) -> Any:
        package, name = msgtype.split("/")
        return self._types[f"{package}/msg/{name}"](*fields)

    def header(self, stamp_ns: int, frame_id: str) -> Any:
        """Stamp, exact to the nanosecond, and frame."""
        seconds, nanoseconds = divmod(int(stamp_ns), NS_PER_S)
        stamp = self._types["builtin_interfaces/msg/Time"](seconds, nanoseconds)
        return self._make("std_msgs/Header", *([0] if self._has_seq else []), stamp, frame_id)

    def image(self, stamp_ns: int, frame_id: str, data: bytes, encoding: ImageEncoding) -> Any:
        """An image file as ``CompressedImage``."""
        pixels = np.frombuffer(data, dtype=np.uint8)
        return self._make("sensor_msgs/CompressedImage", self.header(stamp_ns, frame_id), encoding, pixels)

    def camera_info(self, stamp_ns: int, frame_id: str, intrinsics: CameraCalibration, baseline_m: float) -> Any:
        """Intrinsics; ``baseline_m`` is the distance of a rectified pair's right camera from the left one, otherwise 0.

        P = [K | (-fx baseline, 0, 0)], R = I, as ``sensor_msgs/CameraInfo`` defines them.
        """
        model, coefficients = _ros_distortion(intrinsics)
        projection = np.hstack((intrinsics.camera_matrix, np.zeros((3, 1))))
        projection[0, 3] = -intrinsics.focal_px[0] * baseline_m
        full_image = self._make("sensor_msgs/RegionOfInterest", 0, 0, 0, 0, False)
        K, R, P = (matrix.ravel() for matrix in (intrinsics.camera_matrix, np.eye(3), projection))
        header = self.header(stamp_ns, frame_id)
        height, width = intrinsics.height_px, intrinsics.width_px
        return self._make(
            "sensor_msgs/CameraInfo", header, height, width, model, coefficients, K, R, P, 0, 0, full_image
        )

    def imu(
        self, frame_id: str, reading: InertialReading, gyroscope_variance: float, accelerometer_variance: float
    ) -> Any:
        """A reading; its orientation is marked as absent, a variance of 0 means unknown."""
        return self._make(
            "sensor_msgs/Imu",
            self.header(reading.stamp_ns, frame_id),
            self._make("geometry_msgs/Quaternion", 0.0, 0.0, 0.0, 1.0),
            _ABSENT,
            self.vector(reading.angular_velocity),
            np.diag([gyroscope_variance] * 3).ravel() if gyroscope_variance else _UNKNOWN,
            self.vector(reading.specific_force),
            np.diag([accelerometer_variance] * 3).ravel() if accelerometer_variance else _UNKNOWN,
        )

    def joints(
        self,
        frame_id: str,
        names: Sequence[str],
        sample: JointSample,
        *,
        with_velocity: bool,
        with_effort: bool,
        feet: Mapping[str, float] = MappingProxyType({}),
    ) -> Any:
        """A joint sample; a reading that is not written is an empty array, as ``sensor_msgs/JointState`` defines it.

        The forces of ``feet`` are further entries of the torques, as in logs of a Go1; torques that are not written
        are NaN then.
        """
        zeros, unknown = np.zeros(len(feet)), np.full(len(names), np.nan)
        position = np.concatenate((sample.position, zeros))
        velocity = np.concatenate((sample.velocity, zeros)) if with_velocity else _EMPTY
        effort = sample.effort if with_effort else _EMPTY
        if feet:
            effort = np.concatenate((sample.effort if with_effort else unknown, list(feet.values())))
        header = self.header(sample.stamp_ns, frame_id)
        return self._make("sensor_msgs/JointState", header, [*names, *feet], position, velocity, effort)

    def foot_force(self, stamp_ns: int, frame_id: str, normal_force: float) -> Any:
        """The normal force on one foot as the z of a ``WrenchStamped``."""
        wrench = self._make("geometry_msgs/Wrench", self.vector([0.0, 0.0, normal_force]), self.vector([0.0] * 3))
        return self._make("geometry_msgs/WrenchStamped", self.header(stamp_ns, frame_id), wrench)

    def transform(self, stamp_ns: int, frame_id: str, child_frame_id: str, T_frame_child: Array) -> Any:
        """A ``TransformStamped``: maps child coordinates to the frame."""
        quaternion = self._make("geometry_msgs/Quaternion", *so3.to_quat_xyzw(T_frame_child[:3, :3]).tolist())
        transform = self._make("geometry_msgs/Transform", self.vector(T_frame_child[:3, 3]), quaternion)
        return self._make("geometry_msgs/TransformStamped", self.header(stamp_ns, frame_id), child_frame_id, transform)

    def transform_of_pose(self, header: Any, child_frame_id: str, pose: Any) -> Any:
        """A ``TransformStamped`` of a ``Pose`` that has been made already."""
        position = pose.position
        translation = self._make("geometry_msgs/Vector3", position.x, position.y, position.z)
        transform = self._make("geometry_msgs/Transform", translation, pose.orientation)
        return self._make("geometry_msgs/TransformStamped", header, child_frame_id, transform)

    def tf(self, transforms: Iterable[Any]) -> Any:
        """Transforms as one ``TFMessage``."""
        return self._types[TF_MESSAGE](list(transforms))

    def pose(self, T_frame_body: Array) -> Any:
        """A ``Pose``: maps body coordinates to the frame."""
        x, y, z = T_frame_body[:3, 3].tolist()
        quaternion = self._make("geometry_msgs/Quaternion", *so3.to_quat_xyzw(T_frame_body[:3, :3]).tolist())
        return self._make("geometry_msgs/Pose", self._make("geometry_msgs/Point", x, y, z), quaternion)

    def odometry(
        self,
        header: Any,
        child_frame_id: str,
        pose: tuple[Any, Array],
        twist: tuple[Any, Array],
    ) -> Any:
        """An ``Odometry`` of pose and twist with their covariances (6, 6), in ROS order."""
        with_covariance = (
            self._make(f"geometry_msgs/{name}WithCovariance", value, covariance.ravel())
            for name, (value, covariance) in (("Pose", pose), ("Twist", twist))
        )
        return self._make("nav_msgs/Odometry", header, child_frame_id, *with_covariance)

    def twist(self, linear: Array, angular: Array) -> Any:
        """A ``Twist``, m/s and rad/s."""
        return self._make("geometry_msgs/Twist", self.vector(linear), self.vector(angular))

    def diagnostics(self, stamp_ns: int, statuses: Iterable[tuple[int, str, str, Mapping[str, str]]]) -> Any:
        """A ``DiagnosticArray`` of statuses: level (0 fine, 1 warning, 2 error), name, sentence, values by key."""
        entries = [
            self._make(
                "diagnostic_msgs/DiagnosticStatus",
                level,
                name,
                sentence,
                "coclo_vio",
                [self._make("diagnostic_msgs/KeyValue", key, value) for key, value in values.items()],
            )
            for level, name, sentence, values in statuses
        ]
        return self._make("diagnostic_msgs/DiagnosticArray", self.header(stamp_ns, ""), entries)

    def path(self, stamp_ns: int, frame_id: str, stamped_poses: Iterable[tuple[int, Array]]) -> Any:
        """A ``Path`` through stamped poses (ns, (4, 4)) in the frame."""
        poses = [
            self._make("geometry_msgs/PoseStamped", self.header(at_ns, frame_id), self.pose(T))
            for at_ns, T in stamped_poses
        ]
        return self._make("nav_msgs/Path", self.header(stamp_ns, frame_id), poses)

    def vector(self, xyz: Array | Sequence[float]) -> Any:
        """A ``Vector3``."""
        return self._make("geometry_msgs/Vector3", *(float(value) for value in xyz))


def _ros_distortion(
    intrinsics: CameraCalibration,
) -> tuple[Literal["plumb_bob", "rational_polynomial", "equidistant"], Array]:
    """ROS's name of the model and its coefficients; no distortion is plumb_bob with zeros, as RealSense writes it."""
    if intrinsics.distortion == "none":
        return "plumb_bob", np.zeros(5)
    coefficients = np.array(intrinsics.distortion_coefficients, dtype=np.float64)
    if intrinsics.distortion == "equidistant":
        return "equidistant", coefficients
    return ("rational_polynomial" if len(coefficients) == 8 else "plumb_bob"), coefficients

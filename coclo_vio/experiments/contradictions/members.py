# SPDX-License-Identifier: BSD-3-Clause
"""The kinds of contradictions and their members: which change, written how, and the finding that names it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coclo_vio.experiments.contradictions import changes
from coclo_vio.experiments.contradictions import joint_changes as of
from coclo_vio.experiments.contradictions.changes import Change
from coclo_vio.experiments.contradictions.content import Content, Form
from coclo_vio.values.arrays import Array
from coclo_vio.values.measurements import CameraImuSample, ImuSample, JointSample, StereoFrame


@dataclass(frozen=True, slots=True)
class Member:
    """A recording of a kind.

    Attributes:
        kind: the kind of contradiction.
        name: what is wrong in it.
        form: how it is written.
        change: from the sound recording.
        finding: kind of the finding that has to name it.
        needs_images: whether images are needed for it.
        is_error: whether a run has to be refused.
        in_full: whether only the full diagnosis of ``doctor`` finds it.
        is_truth: whether it is the ground truth, without which a run goes on.
    """

    kind: str
    name: str
    form: Form
    change: Change
    finding: str
    needs_images: bool = False
    is_error: bool = True
    in_full: bool = False
    is_truth: bool = False

    def write(self, content: Content, folder: Path) -> Path:
        """Write the changed content in the member's form; returns the path to open."""
        return content.write(folder, self.form)


_IMU = "IMU against physics"
_CAMERAS = "stereo pairs that are none"
_CALIBRATION = "calibrations that cannot be"
_CLOCKS = "clocks"
_JOINTS = "joint readings that cannot be"
_ROBOT = "description against its URDF"
_TRUTH = "ground truth that cannot be meant so"
_LEFT_RIGHT = (1, 0, 3, 2, 5, 4)


def _in_degrees_a_second(position: Array, velocity: Array, effort: Array) -> tuple[Array, Array, Array]:
    return position, np.asarray(np.rad2deg(velocity)), effort


MEMBERS: tuple[Member, ...] = (
    Member(_IMU, "body accelerations in g", "bag", changes.imu(ImuSample, force=changes.in_g), "imu_acceleration_unit"),
    Member(
        _IMU,
        "camera accelerations in g",
        "folder",
        changes.imu(CameraImuSample, force=changes.in_g),
        "camera_imu_acceleration_unit",
    ),
    Member(_IMU, "body gravity removed", "leg log", changes.without_gravity(ImuSample), "imu_gravity_removed"),
    Member(
        _IMU, "camera gravity removed", "bag", changes.without_gravity(CameraImuSample), "camera_imu_gravity_removed"
    ),
    Member(_IMU, "body rates in deg/s", "leg log", changes.imu(ImuSample, rate=changes.in_degrees), "imu_rate_unit"),
    Member(
        _IMU,
        "camera rates in deg/s",
        "bag",
        changes.imu(CameraImuSample, rate=changes.in_degrees),
        "camera_imu_rate_unit",
    ),
    Member(_IMU, "body axes NED", "bag", changes.turned(ImuSample, "x -y -z"), "imu_axes"),
    Member(_IMU, "body axes turned by 90 deg", "leg log", changes.turned(ImuSample, "y -x z"), "imu_axes"),
    Member(
        _IMU, "camera axes turned by 90 deg", "folder", changes.turned(CameraImuSample, "y -x z"), "camera_imu_axes"
    ),
    Member(
        _IMU, "body acceleration sign", "folder", changes.imu(ImuSample, force=np.negative), "imu_acceleration_sign"
    ),
    Member(
        _IMU,
        "camera acceleration sign",
        "bag",
        changes.imu(CameraImuSample, force=np.negative),
        "camera_imu_acceleration_sign",
    ),
    Member(_IMU, "body rates all zero", "leg log", changes.imu(ImuSample, rate=np.zeros_like), "imu_rate_constant"),
    Member(_CAMERAS, "left and right interchanged", "bag", changes.swapped_images, "images_swapped", needs_images=True),
    Member(
        _CAMERAS, "left and right interchanged", "folder", changes.swapped_images, "images_swapped", needs_images=True
    ),
    Member(
        _CAMERAS,
        "images of another camera",
        "bag",
        changes.other_images,
        "no_stereo_pair",
        needs_images=True,
        is_error=False,
    ),
    Member(
        _CAMERAS, "half the calibrated resolution", "folder", changes.half_resolution, "image_size", needs_images=True
    ),
    Member(_CALIBRATION, "baseline of 0", "folder", changes.baseline(0.0), "baseline", needs_images=True),
    Member(_CALIBRATION, "baseline in millimetres", "bag", changes.baseline(1000.0), "baseline", needs_images=True),
    Member(_CALIBRATION, "baseline negative", "folder", changes.baseline(-1.0), "baseline", needs_images=True),
    Member(_CALIBRATION, "focal length in millimetres", "bag", changes.other_lens, "focal_length", needs_images=True),
    Member(_CLOCKS, "stamps in microseconds", "leg log", changes.stamps_in_microseconds, "stamp_unit"),
    Member(_CLOCKS, "stamps in microseconds", "bag", changes.stamps_in_microseconds, "stamp_unit"),
    Member(_CLOCKS, "images by uptime", "folder", changes.since_start, "streams_apart", needs_images=True),
    Member(_CLOCKS, "joints by another epoch", "leg log", changes.late(JointSample, -1e6), "streams_apart"),
    Member(
        _CLOCKS,
        "images 0.2 s late",
        "bag",
        changes.late(StereoFrame, 0.2),
        "stereo_delay",
        needs_images=True,
        in_full=True,
    ),
    Member(_CLOCKS, "joints 0.1 s late", "leg log", changes.late(JointSample, 0.1), "joints_delay", in_full=True),
    Member(
        _CLOCKS,
        "camera IMU 0.06 s late",
        "folder",
        changes.late(CameraImuSample, 0.06),
        "camera_imu_delay",
        in_full=True,
    ),
    Member(_JOINTS, "torques zero", "bag", of.joints(lambda p, v, t: (p, v, 0.0 * t)), "torque_zero"),
    Member(
        _JOINTS,
        "torques absent",
        "leg log",
        of.joints(lambda p, v, t: (p, v, np.nan * t)),
        "contact_kinematic",
        is_error=False,
    ),
    Member(_JOINTS, "torques negated", "leg log", of.joints(lambda p, v, t: (p, v, -t)), "torque_sign"),
    Member(_JOINTS, "velocities zero", "bag", of.joints(lambda p, v, t: (p, 0.0 * v, t)), "joint_velocity_zero"),
    Member(
        _JOINTS,
        "velocities in deg/s",
        "folder",
        of.joints(lambda p, v, t: (p, np.rad2deg(v), t)),
        "joint_velocity_unit",
    ),
    Member(
        _JOINTS,
        "angles and velocities in degrees",
        "leg log",
        of.joints(lambda p, v, t: (np.rad2deg(p), np.rad2deg(v), t)),
        "joint_position_unit",
    ),
    Member(_JOINTS, "angles never move", "bag", of.still, "joints_still"),
    Member(_JOINTS, "sign of one joint", "bag", of.negated(3), "joint_order"),
    Member(_JOINTS, "left and right legs interchanged", "leg log", of.ordered(*_LEFT_RIGHT), "joint_order"),
    Member(_ROBOT, "no such URDF", "bag", of.described(urdf="no_such.urdf"), "robot_urdf_missing"),
    Member(_ROBOT, "a joint of each leg left out", "leg log", of.without_last_joints, "robot_joint_in_no_leg"),
    Member(
        _TRUTH,
        "quaternions w x y z",
        "bag",
        of.truth(of.scalar_first),
        "truth_quaternion_order",
        is_truth=True,
    ),
    Member(_TRUTH, "millimetres", "leg log", of.truth(lambda R, p: (R, 1e3 * p)), "truth_length_unit", is_truth=True),
    Member(_TRUTH, "single poses far away", "folder", of.truth(of.jumping), "truth_jumps", is_truth=True),
    Member(_TRUTH, "lost to the origin", "bag", of.truth(of.lost), "truth_lost", is_error=False, is_truth=True),
)

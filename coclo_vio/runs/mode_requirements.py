# SPDX-License-Identifier: BSD-3-Clause
"""What a mode lacks of its needs in a recording, in words for a reader."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from coclo_vio.datasets.read_report import ReadReport
from coclo_vio.robot.description import RobotDescription
from coclo_vio.runs.modes.mode import Mode, Need
from coclo_vio.values.calibration import ImuCalibration, SensorCalibrations, StereoCalibration
from coclo_vio.values.units import NS_PER_S

_MAX_CAMERA_ANGLE_DEG = 45.0


@dataclass(frozen=True, slots=True, eq=False)
class Holdings:
    """What an inspection found, as far as modes need it.

    Attributes:
        robot: whose joints were looked for, None where none is known.
        report: streams of the recording.
        missing_joints: joints of the robot that the recording lacks.
        has_joints: whether it has any of the robot's joints.
        has_effort: whether any torque is measured.
        calibrations: of the recording.
        allows_partial: whether legs whose joints are missing are left out.
        robot_hint: what to give where no robot is known.
        fits_urdf: whether the robot's description fits its URDF.
    """

    robot: RobotDescription | None
    report: ReadReport
    missing_joints: tuple[str, ...]
    has_joints: bool
    has_effort: bool
    calibrations: SensorCalibrations
    allows_partial: bool
    robot_hint: str
    fits_urdf: bool = True

    def has(self, stream: str) -> bool:
        """Whether the recording has samples of a stream."""
        return self.report.stream(stream) is not None

    @property
    def image_stream(self) -> str:
        """The stream of the cameras."""
        return "stereo_tracks" if self.has("stereo_tracks") else "stereo"

    @property
    def vision_imus(self) -> dict[str, ImuCalibration | None]:
        """The IMUs that could go with the cameras, the cameras' own first, and their calibrations."""
        imu = self.calibrations.imu
        if imu is None and self.robot is not None:
            imu = self.robot.imu
        known = {"camera_imu": self.calibrations.camera_imu, "imu": imu}
        return {name: calibration for name, calibration in known.items() if self.has(name)}


def missing_needs(mode: Mode, holdings: Holdings) -> tuple[str, ...]:
    """What a mode lacks of what it cannot do without; nothing for a mode that is ready."""
    found: list[str] = []
    streams: list[str] = []
    for need in Need:
        if need in mode.needs:
            found += _MISSING[need](holdings)
            streams += _streams(need, holdings)
    for other in streams[1:]:
        found += _never_together(holdings.report, streams[0], other)
    return tuple(found)


def camera_angle_deg(stereo: StereoCalibration) -> float:
    """The angle between the optical axes of the two cameras, degrees."""
    left, right = stereo.T_body_left_camera[:3, 2], stereo.T_body_right_camera[:3, 2]
    return float(np.rad2deg(np.arccos(np.clip(left @ right, -1.0, 1.0))))


def _streams(need: Need, holdings: Holdings) -> tuple[str, ...]:
    """The streams that a need is met by, the one that leads first."""
    match need:
        case Need.LEGS:
            return ("joints", "imu")
        case Need.CAMERAS:
            return (holdings.image_stream,)
        case Need.IMU:
            return tuple(name for name, known in holdings.vision_imus.items() if known is not None)[:1]
        case Need.BODY_TWIST:
            return ("body_twist",)


def _missing_legs(holdings: Holdings) -> Iterator[str]:
    robot, missing = holdings.robot, holdings.missing_joints
    if robot is None:
        yield holdings.robot_hint
    elif not holdings.fits_urdf:
        yield f"a description of {robot.name} that fits its URDF (see problems)"
    elif missing and not (holdings.allows_partial and holdings.has_joints):
        yield f"{len(missing)} of {robot.name}'s {len(robot.joint_names)} joints"
    elif not holdings.has("joints"):
        yield "joint samples"
    elif robot.contact.source == "torque" and not holdings.has_effort and holdings.has("foot_force"):
        yield f"joint torques, from which {robot.name}'s contacts are estimated"
    elif robot.contact.source == "force_sensor" and not holdings.has("foot_force") and holdings.has_effort:
        yield f"foot forces, from which {robot.name}'s contacts are estimated"
    if not holdings.has("imu"):
        yield "the body's IMU"


def _missing_cameras(holdings: Holdings) -> Iterator[str]:
    stereo = holdings.calibrations.stereo
    if not holdings.has(holdings.image_stream):
        yield "stereo images"
    if stereo is None:
        yield "calibration of the cameras"
    elif camera_angle_deg(stereo) >= _MAX_CAMERA_ANGLE_DEG:
        yield "cameras that look in the same direction"


def _missing_imu(holdings: Holdings) -> Iterator[str]:
    imus = holdings.vision_imus
    if not imus:
        is_half = any("only half of one" in note for note in holdings.report.notes)
        yield "the other half of its IMU (see notes)" if is_half else "an IMU"
    elif all(calibration is None for calibration in imus.values()):
        yield "the mounting of its IMU"


def _missing_body_twist(holdings: Holdings) -> Iterator[str]:
    if not holdings.has("body_twist"):
        yield "a body twist: the body's velocities, measured by another source"


_MISSING = {
    Need.LEGS: _missing_legs,
    Need.CAMERAS: _missing_cameras,
    Need.IMU: _missing_imu,
    Need.BODY_TWIST: _missing_body_twist,
}


def _never_together(report: ReadReport, one: str, other: str) -> tuple[str, ...]:
    """A sentence where two streams were never recorded at the same time."""
    first, second = report.stream(one), report.stream(other)
    if first is None or second is None:
        return ()
    apart_s = (max(first.start_ns, second.start_ns) - min(first.end_ns, second.end_ns)) / NS_PER_S
    return (f"{one} and {other} at one time: their stamps are {apart_s:.3g} s apart",) if apart_s > 0.0 else ()

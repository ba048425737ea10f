# SPDX-License-Identifier: BSD-3-Clause
"""The IMU of a robot for its description: rotation, position, noise, with what to check."""

from collections.abc import Sequence

import numpy as np

from coclo_vio.adoption.adoption import AdoptedField
from coclo_vio.adoption.imu_mounting import ImuMounting, find_mounting, scale_of_force
from coclo_vio.adoption.read_log import ReadLog
from coclo_vio.adoption.recorded_legs import RecordedLegs
from coclo_vio.adoption.stance_motion import FeetMotion, standing_pairs
from coclo_vio.datasets.corrections import ACCELERATION_UNITS
from coclo_vio.robot.imu_check import imu_links, roll_pitch_yaw
from coclo_vio.robot.leg_search import FoundLeg
from coclo_vio.robot.urdf_tree import UrdfTree
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.calibration import ImuCalibration
from coclo_vio.values.units import NS_PER_S

_UP = np.array([0.0, 0.0, 1.0])
_EVIDENT = 2.0  # times the default's noise at rest: another value is written
_FLAT_JOINTS = 5  # a leg of so many joints without a round foot has a flat one
_LATE_S = 0.002
_SLOW_S = 0.25  # swaying at rest is slower than that, noise is faster

Found = tuple[ImuCalibration, list[AdoptedField], list[str]]


def find_imu(tree: UrdfTree, read: ReadLog, legs: Sequence[FoundLeg], is_stance: BoolArray) -> Found:
    """Mounting and noise of the IMU; the URDF's where the data agree with it."""
    recorded, motion = read.recorded, read.motion
    if not recorded.has_imu:
        reason = "the log has no IMU"
        return ImuCalibration(), [AdoptedField("imu", "none", 0.0, reason)], [f"imu: {reason}"]
    body = read.robot.description.body_frame or tree.root
    links = imu_links(tree, body)
    pairs = standing_pairs(motion, is_stance, _UP)
    found = find_mounting(
        recorded,
        motion,
        is_stance,
        pairs,
        flat_normals=_flat_normals(legs, motion, is_stance),
        known={name: mounting[:3, :3] for name, mounting in links.items()},
    )
    roll, pitch, yaw = (float(f"{angle:.6f}") + 0.0 for angle in roll_pitch_yaw(found.rotation))
    values: dict[str, object] = {"rotation_body_imu_rpy_rad": (roll, pitch, yaw)}
    fields = [_rotation_field(found, (roll, pitch, yaw))]
    position = links.get(found.source) if found.source in links else None
    if position is not None:
        x, y, z = (float(f"{value:.6f}") + 0.0 for value in position[:3, 3])
        values["position_body_m"] = (x, y, z)
        text = f"{x:g}, {y:g}, {z:g}"
        fields.append(AdoptedField("imu.position_body_m", text, 0.9, f"the link {found.source} of the URDF"))
    else:
        reason = "the URDF has no IMU in this attitude: measure where it is in the body frame"
        fields.append(AdoptedField("imu.position_body_m", "0, 0, 0", 0.3, reason))
    noise = _gyroscope_noise(recorded)
    if noise is not None:
        values["gyroscope_noise_density"] = noise
        reason = "scatter of the gyroscope at rest"
        fields.append(AdoptedField("imu.gyroscope_noise_density", f"{noise:g}", 0.8, reason))
    return ImuCalibration.parse(values, "adoption"), fields, _notes(found)


def _rotation_field(found: ImuMounting, angles: tuple[float, float, float]) -> AdoptedField:
    measured = ", ".join(f"{angle:.3f}" for angle in roll_pitch_yaw(found.measured))
    if found.source == "measured":
        reason = f"measured, {measured} rad, and near to no axis of the body and no IMU of the URDF: check it"
    else:
        which = "along the axes of the body" if found.source == "axes" else f"the URDF's {found.source}"
        reason = f"{which}, {np.degrees(found.apart_rad):.1f} degrees from what was measured ({measured} rad)"
    if not found.is_heading_known:
        reason += "; the log has too little turning to measure the heading: record some turns, or check it"
    if not found.is_tilt_known:
        reason += "; the feet span no plane, so the tilt is that of an upright body: check it"
    return AdoptedField(
        "imu.rotation_body_imu_rpy_rad", ", ".join(f"{angle:g}" for angle in angles), found.confidence, reason
    )


def _notes(found: ImuMounting) -> list[str]:
    notes = []
    unit = scale_of_force(found.force_mps2)
    if found.is_gyroscope_in_degrees:
        notes.append("the gyroscope reads deg/s: set dataset.corrections.imu.rate_unit=deg/s")
    if unit == "without gravity":
        notes.append(
            f"the accelerometer reads {found.force_mps2:.3g} at rest, so gravity was removed from it: record the "
            "specific force itself, by which attitude is known"
        )
    elif unit is not None:
        setting = f"set dataset.corrections.imu.acceleration_unit={unit}"
        cure = setting if unit in ACCELERATION_UNITS else "convert it to m/s^2"
        notes.append(f"the accelerometer reads {found.force_mps2:.3g} at rest, its unit is {unit}: {cure}")
    if found.delay_s is not None and found.delay_s > _LATE_S:
        notes.append(
            f"the gyroscope is {1e3 * found.delay_s:.0f} ms behind the joints: filter.robust.imu_delay_s may be set to "
            f"{found.delay_s:.3f}; the filter estimates it by itself"
        )
    return notes


def _flat_normals(legs: Sequence[FoundLeg], motion: FeetMotion, is_stance: BoolArray) -> Array | None:
    """The axis of each flat foot that points up while it stands, (legs, 3); None where feet are not flat."""
    are_flat = all(
        leg.foot_kind == "flat" or (leg.foot_kind != "sphere" and len(leg.joints) >= _FLAT_JOINTS) for leg in legs
    )
    if not are_flat:
        return None
    normals = []
    for leg in range(len(legs)):
        rows = is_stance[:, leg] if is_stance[:, leg].any() else np.ones(len(is_stance), dtype=np.bool_)
        up_foot = np.nanmean(motion.rotation[rows, leg, 2], axis=0)  # body z in the axes of the foot
        axis = int(np.argmax(np.abs(up_foot)))
        normals.append(np.sign(up_foot[axis]) * np.eye(3)[axis])
    return np.array(normals)


def _gyroscope_noise(recorded: RecordedLegs) -> float | None:
    """Noise density at rest, rad/s/sqrt(Hz); None without rest, or where it is that of the default."""
    is_rest = recorded.is_rest()
    if is_rest.sum() < 50:
        return None
    rows = np.flatnonzero(is_rest[np.searchsorted(recorded.joint_ns, recorded.imu_ns).clip(0, len(is_rest) - 1)])
    rate_hz = NS_PER_S / max(float(np.median(np.diff(recorded.imu_ns))), 1.0)
    width = max(int(_SLOW_S * rate_hz), 3)
    if len(rows) < 2 * width:
        return None
    readings = recorded.angular_velocity[rows]
    blocks = readings[: len(readings) // width * width].reshape(-1, width, 3)
    density = float(np.median(blocks.std(axis=1)) / np.sqrt(rate_hz))
    default = ImuCalibration().gyroscope_noise_density
    return float(f"{density:.2g}") if density > _EVIDENT * default else None

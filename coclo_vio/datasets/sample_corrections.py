# SPDX-License-Identifier: BSD-3-Clause
"""Corrections of single samples: units, axes, order, signs and delays, of recordings and of wires."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from coclo_vio.datasets.corrections import ACCELERATION_UNITS, RATE_UNITS, STAMP_UNITS_NS, Corrections, ImuCorrections
from coclo_vio.datasets.joint_arrangement import ForceArrangement, JointArrangement
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import TimestampError
from coclo_vio.values.measurements import (
    CameraImuSample,
    FootForceSample,
    ImuSample,
    JointSample,
    Measurement,
    StereoFrame,
    StereoTracks,
)
from coclo_vio.values.units import NS_PER_S

_LATEST_NS = 2**62
_Change = Callable[[Any], Measurement]


class SampleCorrections:
    """Corrects one sample at a time."""

    def __init__(self, corrections: Corrections, robot: RobotDescription | None) -> None:
        """Set what is changed.

        Raises:
            DatasetError: a correction of a joint or leg that the robot does not have.
        """
        self._corrections = corrections
        self._is_none = corrections.is_none
        self._delays_ns = {kind: round(delay_s * NS_PER_S) for kind, delay_s in _delays_s(corrections).items()}
        self._changes: Mapping[type, _Change] = {
            ImuSample: _imu_change(corrections.imu),
            CameraImuSample: _imu_change(corrections.camera_imu),
            JointSample: JointArrangement(corrections.joints, () if robot is None else robot.joint_names),
            FootForceSample: ForceArrangement(corrections.foot_force, () if robot is None else robot.leg_names),
            StereoFrame: self._frame,
        }

    def delay_ns(self, kind: type) -> int:
        """By how much the samples of a sensor are stamped too late, ns."""
        return self._delays_ns.get(kind, 0)

    def corrected(self, sample: Measurement) -> Measurement:
        """The sample as it should have been.

        Raises:
            TimestampError: its corrected stamp is beyond the year 2116.
        """
        if self._is_none:
            return sample
        kind = type(sample)
        change = self._changes.get(kind)
        changed = sample if change is None else change(sample)
        stamp_ns = self.stamp_ns(kind, sample.stamp_ns)
        return changed if stamp_ns == sample.stamp_ns else replace(changed, stamp_ns=stamp_ns)

    def stamp_ns(self, kind: type, stamp_ns: int) -> int:
        """The corrected stamp of a sensor, ns.

        Raises:
            TimestampError: it is beyond the year 2116.
        """
        return _in_ns(stamp_ns, self._corrections.stamp_unit) - self.delay_ns(kind)

    def _frame(self, frame: StereoFrame) -> StereoFrame:
        if not self._corrections.stereo.is_swapped:
            return frame
        return StereoFrame(frame.stamp_ns, frame.right, frame.left)


def _in_ns(stamp: int, unit: str) -> int:
    """Nanoseconds of a stamp in another unit."""
    stamp_ns = stamp * STAMP_UNITS_NS[unit]
    if abs(stamp_ns) > _LATEST_NS:
        raise TimestampError(
            f"the stamp {stamp} in {unit} is beyond the year 2116; correct stamp_unit under dataset.corrections"
        )
    return stamp_ns


def _imu_change(how: ImuCorrections) -> _Change:
    rotation: Array = how.rotation
    rate_factor = RATE_UNITS[how.rate_unit]
    force_factor = how.acceleration_sign * ACCELERATION_UNITS[how.acceleration_unit]

    def change(sample: Any) -> Measurement:
        rate, force = rotation @ sample.angular_velocity, rotation @ sample.specific_force
        changed: Measurement = type(sample)(sample.stamp_ns, rate_factor * rate, force_factor * force)
        return changed

    return change


def _delays_s(corrections: Corrections) -> dict[type, float]:
    return {
        ImuSample: corrections.imu.delay_s,
        CameraImuSample: corrections.camera_imu.delay_s,
        JointSample: corrections.joints.delay_s,
        FootForceSample: corrections.foot_force.delay_s,
        StereoFrame: corrections.stereo.delay_s,
        StereoTracks: corrections.stereo.delay_s,
    }

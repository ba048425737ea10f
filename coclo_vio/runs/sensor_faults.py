# SPDX-License-Identifier: BSD-3-Clause
"""Simulated faults of single sensors: a gyroscope's offset that steps in, late or early image stamps, a wrong mounting.

The mounting is a fault of the calibration that an estimator is given: the recording stays as it is.
"""

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BeforeValidator

from coclo_vio.datasets.sequencer import order_key
from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import ImuCalibration, StereoCalibration, matrix4
from coclo_vio.values.measurements import CameraImuSample, ImuSample, Measurement, StereoFrame, StereoTracks
from coclo_vio.values.units import NS_PER_S

_LARGEST_RADPS = 10.0
_LONGEST_S = 1e9  # thirty years


@dataclass(frozen=True, slots=True)
class GyroscopeOffset:
    """An offset of the body's gyroscope for a span of time.

    Attributes:
        start_ns: its beginning, ns after the recording's first measurement.
        end_ns: its end, which is no longer in it.
        radps: added to the reading of each axis, rad/s.
    """

    start_ns: int
    end_ns: int
    radps: float

    @classmethod
    def parse(cls, text: str) -> Self:
        """The offset of ``START:SECONDS:RADPS``.

        Raises:
            ValueError: not three numbers, or one of them out of bounds.
        """
        try:
            start_s, duration_s, radps = (float(part) for part in text.split(":"))
        except ValueError as error:
            raise ValueError(f"{text!r} is no START:SECONDS:RADPS, such as 20:1000:0.05") from error
        if not (0.0 <= start_s <= _LONGEST_S and 0.0 < duration_s <= _LONGEST_S and abs(radps) <= _LARGEST_RADPS):
            raise ValueError(
                f"{text!r}: START must be at least 0, SECONDS above 0, neither above {_LONGEST_S:.0e}, and RADPS "
                f"within {_LARGEST_RADPS:g} rad/s, such as 20:1000:0.05"
            )
        return cls(round(start_s * NS_PER_S), round((start_s + duration_s) * NS_PER_S), radps)


def _offset_text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError("must be text START:SECONDS:RADPS, such as 20:1000:0.05")
    GyroscopeOffset.parse(value)
    return value


def _one_or_more(value: Any) -> Any:
    return value if isinstance(value, Sequence) and not isinstance(value, str) else (value,)


GyroscopeOffsets = Annotated[tuple[Annotated[str, BeforeValidator(_offset_text)], ...], BeforeValidator(_one_or_more)]
Vector = tuple[float, float, float]


def offset_gyroscope(
    sample: ImuSample | CameraImuSample, after_ns: int, offsets: Sequence[GyroscopeOffset]
) -> ImuSample | CameraImuSample:
    """A reading with the offsets of its time added, the reading itself where there is none."""
    radps = sum(each.radps for each in offsets if each.start_ns <= after_ns < each.end_ns)
    if radps == 0.0:
        return sample
    return type(sample)(sample.stamp_ns, sample.angular_velocity + radps, sample.specific_force)


class DelayedImages:
    """Stamps of images are late or early, and everything comes in the order of stamps.

    Args:
        delay_s: stamp of an image less the time of its exposure, s.
    """

    def __init__(self, delay_s: float) -> None:
        self._delay_ns = round(delay_s * NS_PER_S)
        self._held: list[tuple[int, int, int, Measurement]] = []  # stamp, rank of its kind, number
        self._number = 0

    def push(self, measurement: Measurement) -> Iterator[Measurement]:
        """Take one; those that nothing can come before any more."""
        if not self._delay_ns:
            yield measurement
            return
        now_ns = measurement.stamp_ns + min(self._delay_ns, 0)
        if isinstance(measurement, StereoFrame | StereoTracks):
            measurement = replace(measurement, stamp_ns=measurement.stamp_ns + self._delay_ns)
        self._number += 1
        heapq.heappush(self._held, (*order_key(measurement), self._number, measurement))
        while self._held and self._held[0][0] < now_ns:
            yield heapq.heappop(self._held)[-1]

    def finish(self) -> Iterator[Measurement]:
        """Those that still wait."""
        while self._held:
            yield heapq.heappop(self._held)[-1]


def turned_cameras(stereo: StereoCalibration, turn_deg: Vector, shift_m: Vector) -> StereoCalibration:
    """A calibration whose mounting is wrong: turned about the left camera and shifted, in body axes.

    Args:
        stereo: the calibration.
        turn_deg: rotation vector, deg.
        shift_m: m.
    """
    left = stereo.T_body_left_camera
    wrong = _wrong_mounting(left[:3, 3], turn_deg, shift_m)
    return stereo.model_copy(
        update={
            "body_left_camera": matrix4(wrong @ left),
            "body_right_camera": matrix4(wrong @ stereo.T_body_right_camera),
        }
    )


def turned_imu(imu: ImuCalibration, stereo: StereoCalibration, turn_deg: Vector, shift_m: Vector) -> ImuCalibration:
    """The calibration of the cameras' own IMU, which is mounted to them, with their wrong mounting."""
    return imu.moved(_wrong_mounting(stereo.T_body_left_camera[:3, 3], turn_deg, shift_m))


def _wrong_mounting(about: Array, turn_deg: Vector, shift_m: Vector) -> Array:
    """The transform (4, 4), in body coordinates, from the given mounting to the wrong one."""
    turn = so3.exp(np.radians(np.array(turn_deg)))
    return se3.transform(turn, about - turn @ about + np.array(shift_m))

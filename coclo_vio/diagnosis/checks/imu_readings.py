# SPDX-License-Identifier: BSD-3-Clause
"""An IMU's readings against gravity and the range of a gyroscope: units, gravity removed, no reading at all."""

from collections.abc import Iterator

import numpy as np

from coclo_vio.datasets.corrections import ACCELERATION_UNITS
from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.finding import Finding, Stage, error, warning
from coclo_vio.diagnosis.records import InertialRecord
from coclo_vio.values.arrays import Array
from coclo_vio.values.units import GRAVITY_MPS2, NS_PER_S

_FEWEST, _FEWEST_CONSTANT = 20, 200  # samples: of any check, and of one that finds no change at all
_UNIT_TOLERANCE = 0.25  # of gravity, in another unit
_MEAN_S = 0.5
_REMOVED_MPS2 = 3.0  # a walking robot's mean reading without gravity is below
_DOUBTFUL = 0.05  # of gravity: more than any accelerometer's bias and scale
_FASTEST_RADPS = 35.0  # 2,000 deg/s, the range of the sensors on robots
_NAMES = {"imu": "body's", "camera_imu": "camera's"}


def find_readings(evidence: Evidence) -> Iterator[Finding]:
    """Readings of either IMU that contradict gravity or a sensor's range."""
    for stream, record in (("imu", evidence.imu), ("camera_imu", evidence.camera_imu)):
        if record is not None and len(record.stamps_ns) >= _FEWEST:
            yield from _accelerometer(stream, record)
            yield from _gyroscope(stream, record)


def _accelerometer(stream: str, record: InertialRecord) -> Iterator[Finding]:
    if len(record.force) >= _FEWEST_CONSTANT and not np.ptp(record.force, axis=0).any():
        yield error(
            f"{stream}_acceleration_constant",
            Stage.IMU,
            stream,
            f"the {_NAMES[stream]} accelerometer reads {_vector(record.force[0])} in all {len(record.force)} samples: "
            "it has no reading; record its accelerations, or leave the IMU out",
        )
        return
    size = _size(record)
    for unit, factor in ACCELERATION_UNITS.items():
        if factor != 1.0 and abs(size * factor / GRAVITY_MPS2 - 1.0) < _UNIT_TOLERANCE:
            yield error(
                f"{stream}_acceleration_unit",
                Stage.IMU,
                stream,
                f"the {_NAMES[stream]} accelerometer reads {size:.4g} in the median where gravity is 9.81 m/s^2: its "
                f"unit is {unit}; set dataset.corrections.{stream}.acceleration_unit={unit}",
                f"dataset.corrections.{stream}.acceleration_unit={unit}",
                is_certain=True,
            )
            return
    if size < _REMOVED_MPS2:
        yield error(
            f"{stream}_gravity_removed",
            Stage.IMU,
            stream,
            f"the {_NAMES[stream]} accelerometer reads {size:.2g} m/s^2 in the median, not 9.81: gravity was removed; "
            "record the specific force (ROS: Imu with gravity, REP 145), without it tilt is not known",
        )
    elif abs(size / GRAVITY_MPS2 - 1.0) > _UNIT_TOLERANCE:
        yield error(
            f"{stream}_acceleration_scale",
            Stage.IMU,
            stream,
            f"the {_NAMES[stream]} accelerometer reads {size:.4g} m/s^2 in the median, not 9.81: its unit is none of "
            f"{', '.join(ACCELERATION_UNITS)}; convert its readings to m/s^2",
        )
    elif abs(size / GRAVITY_MPS2 - 1.0) > _DOUBTFUL:
        yield warning(
            f"{stream}_acceleration_scale",
            Stage.IMU,
            stream,
            f"the {_NAMES[stream]} accelerometer reads {size:.4g} m/s^2 in the median, "
            f"{100 * (size / 9.81 - 1):+.0f} % "
            "from gravity (9.81): calibrate its scale and bias; a tilt follows from the wrong part",
        )


def _size(record: InertialRecord) -> float:
    """The median size of means over half a second, m/s^2: gravity, however the IMU turns."""
    step_s = float(np.median(np.diff(record.stamps_ns))) / NS_PER_S
    width = int(np.clip(round(_MEAN_S / max(step_s, 1e-4)), 1, len(record.force)))
    parts = len(record.force) // width
    means = record.force[: parts * width].reshape(parts, width, 3).mean(axis=1)
    return float(np.median(np.linalg.norm(means, axis=1)))


def _gyroscope(stream: str, record: InertialRecord) -> Iterator[Finding]:
    if len(record.rate) >= _FEWEST_CONSTANT and not np.ptp(record.rate, axis=0).any():
        yield error(
            f"{stream}_rate_constant",
            Stage.IMU,
            stream,
            f"the {_NAMES[stream]} gyroscope reads {_vector(record.rate[0])} rad/s in all {len(record.rate)} samples: "
            "it has no reading; record its rates, or leave the IMU out",
        )
        return
    fast = float(np.quantile(np.abs(record.rate).max(axis=1), 0.99))
    if fast <= _FASTEST_RADPS:
        return
    said = f"the {_NAMES[stream]} gyroscope reads {fast:.4g} rad/s, above the range of a sensor ({_FASTEST_RADPS:g})"
    if np.deg2rad(fast) > _FASTEST_RADPS:
        sentence = f"{said}: these are raw counts or another unit; convert its rates to rad/s"
        yield error(f"{stream}_rate_unit", Stage.IMU, stream, sentence)
        return
    setting = f"dataset.corrections.{stream}.rate_unit=deg/s"
    sentence = f"{said}: its unit is deg/s; set {setting}"
    yield error(f"{stream}_rate_unit", Stage.IMU, stream, sentence, setting, is_certain=True)


def _vector(values: Array) -> str:
    return f"({', '.join(f'{value:.3g}' for value in values)})"

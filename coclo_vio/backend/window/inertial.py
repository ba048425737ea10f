# SPDX-License-Identifier: BSD-3-Clause
"""IMU readings between two keyframes, preintegrated for the smoother.

Source: Forster et al., "On-manifold preintegration for real-time visual-inertial odometry", 2017 (by
GTSAM).
"""

from collections import deque
from dataclasses import dataclass
from typing import Self

import gtsam
import numpy as np

from coclo_vio.backend.window.config import InertialConfig
from coclo_vio.backend.window.lever_arm import mean_reading
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import ImuCalibration
from coclo_vio.values.measurements import InertialReading
from coclo_vio.values.units import GRAVITY_MPS2, NS_PER_S

_INTEGRATION_NOISE = 1e-4  # m/sqrt(s): error of the midpoint rule between samples
_FASTEST_RADPS, _STRONGEST_MPS2 = 100.0, 1000.0  # beyond what any such sensor can read
_HISTORY_NS = 1_000_000_000  # readings that are kept for a start in the past


def is_possible(sample: InertialReading) -> bool:
    """Whether a reading is within the range of any IMU: spikes of a broken link are not."""
    rates, forces = sample.angular_velocity.tolist(), sample.specific_force.tolist()
    return bool(
        min(rates) > -_FASTEST_RADPS
        and max(rates) < _FASTEST_RADPS
        and min(forces) > -_STRONGEST_MPS2
        and max(forces) < _STRONGEST_MPS2
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Row:
    """A reading in one array: angular velocity and specific force, (6,)."""

    stamp_ns: int
    values: Array

    @classmethod
    def of(cls, sample: InertialReading) -> Self:
        return cls(sample.stamp_ns, np.concatenate((sample.angular_velocity, sample.specific_force)))


class Preintegration:
    """The motion of the body since the last keyframe from the IMU's readings.

    Readings are interpolated linearly, also at the end of the integration.
    """

    def __init__(self, imu: ImuCalibration, config: InertialConfig) -> None:
        self._config = config
        self.T_body_imu = imu.T_body_imu
        params = gtsam.PreintegrationCombinedParams.MakeSharedU(GRAVITY_MPS2)
        gyroscope = max(imu.gyroscope_noise_density, config.gyroscope_noise_density)
        accelerometer = max(imu.accelerometer_noise_density, config.accelerometer_noise_density)
        params.setGyroscopeCovariance(np.eye(3) * gyroscope**2)
        params.setAccelerometerCovariance(np.eye(3) * accelerometer**2)
        params.setIntegrationCovariance(np.eye(3) * _INTEGRATION_NOISE**2)
        params.setBiasOmegaCovariance(np.eye(3) * max(imu.gyroscope_bias_walk, config.gyroscope_bias_walk) ** 2)
        params.setBiasAccCovariance(np.eye(3) * max(imu.accelerometer_bias_walk, config.accelerometer_bias_walk) ** 2)
        params.setBodyPSensor(gtsam.Pose3(self.T_body_imu))
        self._params = params
        self._lever_imu = self.T_body_imu[:3, :3].T @ self.T_body_imu[:3, 3]
        self._bias = np.zeros(6)  # of accelerometer and gyroscope
        self._rate: Array | None = None  # angular velocity up to which the lever arm has been accounted for
        self._pim = gtsam.PreintegratedCombinedMeasurements(params)
        self._waiting: deque[_Row] = deque()
        self._taken: deque[_Row] = deque()
        self._last: _Row | None = None  # up to which everything is integrated
        self._newest: _Row | None = None
        self.start_ns: int | None = None
        self._now_ns = 0
        self.has_gap = False

    def push(self, sample: InertialReading) -> None:
        """Add the next reading; one that is not newer than the last, or not possible, is left out."""
        newest = self._waiting[-1] if self._waiting else self._last
        if is_possible(sample) and (newest is None or sample.stamp_ns > newest.stamp_ns):
            self._waiting.append(_Row.of(sample))
        if self.start_ns is None and len(self._waiting) > 1:  # integration has not started
            self._last = self._waiting.popleft()
            self._keep(self._last)

    @property
    def measured(self) -> gtsam.PreintegratedCombinedMeasurements:
        """The preintegrated readings since the start."""
        return self._pim

    @property
    def rate_body(self) -> Array:
        """The newest integrated angular velocity, bias included, rad/s, body frame, (3,)."""
        if self._newest is None:
            return np.zeros(3)
        return np.asarray(self.T_body_imu[:3, :3] @ self._newest.values[:3])

    def restart(self, stamp_ns: int, bias: gtsam.imuBias.ConstantBias) -> None:
        """Start to integrate anew at ``stamp_ns``, at most a second before the last integrated reading."""
        while self._taken and self._taken[-1].stamp_ns > stamp_ns:
            self._waiting.appendleft(self._taken.pop())
            self._last = self._taken[-1] if self._taken else self._waiting[0]
        self._pim = gtsam.PreintegratedCombinedMeasurements(self._params, bias)
        self._bias = np.asarray(bias.vector())
        self._rate = self._rate if stamp_ns == self._now_ns else None
        self.start_ns = self._now_ns = stamp_ns
        self.has_gap = False

    def advance(self, stamp_ns: int) -> bool:
        """Integrate up to ``stamp_ns``; whether there are readings to integrate, without a gap."""
        while self._waiting and self._waiting[0].stamp_ns <= stamp_ns:
            self._take(self._waiting.popleft())
        if self._last is not None and self._now_ns < stamp_ns:
            ahead = self._waiting[0] if self._waiting else self._last
            self._note_gap(self._last, stamp_ns)
            begin, end = (_between(self._last, ahead, when_ns) for when_ns in (self._now_ns, stamp_ns))
            self._integrate(begin, end, stamp_ns)
        return self._last is not None and not self.has_gap and self._pim.deltaTij() > 0.0

    def _take(self, row: _Row) -> None:
        before, self._last = self._last or row, row
        self._keep(row)
        if row.stamp_ns > self._now_ns:
            self._note_gap(before, row.stamp_ns)
            is_whole = before.stamp_ns == self._now_ns
            begin = before.values if is_whole else _between(before, row, self._now_ns)
            self._integrate(begin, row.values, row.stamp_ns)

    def _keep(self, row: _Row) -> None:
        self._newest = row
        self._taken.append(row)
        while row.stamp_ns - self._taken[0].stamp_ns > _HISTORY_NS:
            self._taken.popleft()

    def _note_gap(self, before: _Row, stamp_ns: int) -> None:
        pause_ns = stamp_ns - min(before.stamp_ns, self._now_ns)
        self.has_gap = self.has_gap or pause_ns > self._config.max_gap_s * NS_PER_S

    def _integrate(self, begin: Array, end: Array, stamp_ns: int) -> None:
        dt_s = (stamp_ns - self._now_ns) / NS_PER_S
        rate_before = begin[:3] if self._rate is None else self._rate
        mean = mean_reading(begin, end, rate_before, self._bias, self._lever_imu, dt_s)
        self._pim.integrateMeasurement(mean[3:], mean[:3], dt_s)
        self._rate, self._now_ns = end[:3], stamp_ns


def _between(before: _Row, after: _Row, stamp_ns: int) -> Array:
    """The reading at ``stamp_ns`` interpolated between two, (6,); the nearer one outside them."""
    span_ns = after.stamp_ns - before.stamp_ns
    share = 1.0 if span_ns <= 0 else min(max((stamp_ns - before.stamp_ns) / span_ns, 0.0), 1.0)
    return np.asarray(before.values + share * (after.values - before.values))

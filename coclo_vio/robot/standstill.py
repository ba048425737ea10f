# SPDX-License-Identifier: BSD-3-Clause
"""Whether the robot stands still, and the mean of its IMU then.

At rest the mean specific force points up and the mean angular velocity is the gyroscope's bias: the filter starts from
them, and later uses the standstill itself as a measurement.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from coclo_vio.values.arrays import Array, has_nan
from coclo_vio.values.config import StageConfig
from coclo_vio.values.measurements import ImuSample, JointSample
from coclo_vio.values.units import NS_PER_S

_MIN_SAMPLES = 5
_FAST_JOINT = 3.0  # times the joint speed limit: one joint this fast ends a standstill at once, for a window
_MIN_SPAN = 0.8  # share of the window that samples have to span; those of slow sensors never span all of it


class StandstillConfig(StageConfig):
    """Limits of a standstill, each over the window; all have to be kept."""

    window_s: Annotated[float, Field(ge=0.1, le=10, description="length of the sliding window, s")] = 0.5
    gyroscope_std_radps: Annotated[
        float, Field(gt=0, le=1, description="most the angular velocity may scatter, all axes together, rad/s")
    ] = 0.05
    gyroscope_mean_radps: Annotated[
        float,
        Field(gt=0, le=1, description="largest mean angular velocity that may still be a gyroscope's bias, rad/s"),
    ] = 0.05
    accelerometer_std_mps2: Annotated[
        float, Field(gt=0, le=10, description="most the specific force may scatter, all axes together, m/s^2")
    ] = 0.4
    joint_speed_radps: Annotated[
        float, Field(gt=0, le=10, description="largest root-mean-square speed of any joint, rad/s")
    ] = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Rest:
    """Means of the IMU over the window while the robot stands still, imu frame.

    Attributes:
        stamp_ns: time of the newest sample, in nanoseconds.
        angular_velocity: rad/s, (3,): at rest the gyroscope's bias.
        specific_force: m/s^2, (3,): at rest it points up, with 9.81 and the accelerometer's bias.
        sample_count: samples in the means.
    """

    stamp_ns: int
    angular_velocity: Array
    specific_force: Array
    sample_count: int


class StandstillDetector:
    """Detects standstill from IMU and joints over a sliding window; the cost a sample does not depend on its length.

    The IMU samples have to span the window. Joints have to keep their limit where they are known; NaN is unknown. A
    steady rotation counts as motion once it is faster than a bias can be; a slower one, with still joints, cannot be
    distinguished from rest. Samples whose stamp is not later than the last of their kind are refused and counted.
    """

    def __init__(self, config: StandstillConfig | None = None) -> None:
        self.config = config or StandstillConfig()
        window_ns = round(self.config.window_s * NS_PER_S)
        self._imu = _SlidingMoments(window_ns)
        self._joints = _SlidingMoments(window_ns)
        self._fast_ns: int | None = None
        self._counts = {"standstill_stamp_refused": 0}

    @property
    def counts(self) -> Mapping[str, int]:
        """Samples refused for their stamp."""
        return self._counts

    def push(self, sample: ImuSample | JointSample) -> None:
        """Take one sample of either kind; the two need not come in step."""
        match sample:
            case ImuSample():
                values = np.concatenate((sample.angular_velocity, sample.specific_force))
                is_taken = self._imu.push(sample.stamp_ns, values)
            case JointSample():
                velocity = np.nan_to_num(sample.velocity, nan=0.0) if has_nan(sample.velocity) else sample.velocity
                is_taken = self._joints.push(sample.stamp_ns, velocity)
                fast = _FAST_JOINT * self.config.joint_speed_radps
                if is_taken and max(velocity.max(initial=0.0), -velocity.min(initial=0.0)) > fast:
                    self._fast_ns = sample.stamp_ns
        if not is_taken:
            self._counts["standstill_stamp_refused"] += 1

    @property
    def is_stationary(self) -> bool:
        """Whether every limit was kept over the whole window, and no joint was fast in it."""
        imu, config = self._imu, self.config
        if imu.count < _MIN_SAMPLES or imu.span_ns < _MIN_SPAN * imu.window_ns:
            return False
        if self._fast_ns is not None and self._fast_ns > imu.newest_ns - imu.window_ns:
            return False
        mean, variance = imu.mean(), imu.variance()
        if float(mean[:3] @ mean[:3]) > config.gyroscope_mean_radps**2:
            return False
        if float(variance[:3].sum()) > config.gyroscope_std_radps**2:
            return False
        if float(variance[3:].sum()) > config.accelerometer_std_mps2**2:
            return False
        self._joints.drop_before(imu.newest_ns - imu.window_ns)
        return self._joints.count == 0 or float(self._joints.mean_square().max()) <= config.joint_speed_radps**2

    @property
    def rest(self) -> Rest | None:
        """The means over the window while the robot stands still, otherwise None."""
        if not self.is_stationary:
            return None
        mean = self._imu.mean()
        return Rest(self._imu.newest_ns, mean[:3], mean[3:], self._imu.count)


class _SlidingMoments:
    """Mean and variance of the vectors of the last ``window_ns``, by sums of deviations from a first sample.

    A running sum gathers rounding errors of about 1e-16 times the largest square in it for each step; the sums are
    computed anew once the samples of several windows have passed.
    """

    def __init__(self, window_ns: int) -> None:
        self.window_ns = window_ns
        self._samples: deque[tuple[int, Array]] = deque()
        self._reference: Array = np.zeros(0)
        self._sum: Array = np.zeros(0)
        self._sum_of_squares: Array = np.zeros(0)
        self._dropped = 0

    @property
    def count(self) -> int:
        return len(self._samples)

    @property
    def newest_ns(self) -> int:
        return self._samples[-1][0]

    @property
    def span_ns(self) -> int:
        return self._samples[-1][0] - self._samples[0][0] if self._samples else 0

    def push(self, stamp_ns: int, values: Array) -> bool:
        """Add a sample and drop those that left the window; False where the stamp is not newer than the last."""
        if self._samples and stamp_ns <= self.newest_ns:
            return False
        self.drop_before(stamp_ns - self.window_ns)
        self._samples.append((stamp_ns, values))
        if len(self._samples) == 1 or self._dropped > 10 * len(self._samples):
            self._recompute(values)
        else:
            deviation = values - self._reference
            self._sum += deviation
            self._sum_of_squares += deviation * deviation
        return True

    def drop_before(self, stamp_ns: int) -> None:
        while self._samples and self._samples[0][0] < stamp_ns:
            deviation = self._samples.popleft()[1] - self._reference
            self._sum -= deviation
            self._sum_of_squares -= deviation * deviation
            self._dropped += 1

    def mean(self) -> Array:
        return self._reference + self._sum / len(self._samples)

    def variance(self) -> Array:
        mean_deviation = self._sum / len(self._samples)
        return np.maximum(self._sum_of_squares / len(self._samples) - mean_deviation**2, 0.0)

    def mean_square(self) -> Array:
        return self.variance() + self.mean() ** 2

    def _recompute(self, reference: Array) -> None:
        deviations = np.array([values for _, values in self._samples]) - reference
        self._reference, self._dropped = reference, 0
        self._sum = deviations.sum(axis=0)
        self._sum_of_squares = (deviations**2).sum(axis=0)

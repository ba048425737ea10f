# SPDX-License-Identifier: BSD-3-Clause
"""Whether the robot stands still, the mean of its IMU then, and when an estimator may start.

At rest the mean specific force points up and the mean angular velocity is the gyroscope's bias: the filter starts from
them, and later uses the standstill itself as a measurement.
"""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from coclo_vio.geometry.compiled import compiled
from coclo_vio.values.arrays import Array, has_nan
from coclo_vio.values.config import StageConfig
from coclo_vio.values.measurements import InertialReading, JointSample
from coclo_vio.values.units import GRAVITY_MPS2, NS_PER_S

_MIN_SAMPLES = 5
_FAST_JOINT = 3.0  # times the joint speed limit: one joint this fast ends a standstill at once, for a window
_FLAT_TRAVEL_RAD = 0.003  # two counts of an encoder of 12 bits; a sway that has less moves the body by 2 mm
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
    joint_travel_rad: Annotated[
        float | None,
        Field(
            gt=0,
            le=1,
            description="furthest that any joint may travel in two windows, rad: a slow sway is as smooth as rest; "
            "null: 0.003 for a robot with flat feet, no limit otherwise",
        ),
    ] = None

    @property
    def limits(self) -> "StandstillLimits":
        """These limits, for a robot with joints."""
        return StandstillLimits(
            window_s=self.window_s,
            gyroscope_std_radps=self.gyroscope_std_radps,
            accelerometer_std_mps2=self.accelerometer_std_mps2,
            gyroscope_mean_radps=self.gyroscope_mean_radps,
            joint_speed_radps=self.joint_speed_radps,
            joint_travel_rad=math.inf if self.joint_travel_rad is None else self.joint_travel_rad,
        )

    def limits_of(self, *, has_flat_feet: bool) -> "StandstillLimits":
        """The limits for a robot that has flat feet, and so may sway slowly over them, or has none."""
        if has_flat_feet and self.joint_travel_rad is None:
            return replace(self.limits, joint_travel_rad=_FLAT_TRAVEL_RAD)
        return self.limits


@dataclass(frozen=True, slots=True, kw_only=True)
class StandstillLimits:
    """Limits of a standstill over a window; infinity where there is none.

    Attributes:
        window_s: length of the sliding window, s.
        gyroscope_std_radps: of the scatter of the angular velocity, all axes together, rad/s.
        accelerometer_std_mps2: of the scatter of the specific force, all axes together, m/s^2.
        gyroscope_mean_radps: of the mean angular velocity, rad/s.
        joint_speed_radps: of the root-mean-square speed of any joint, rad/s.
        joint_travel_rad: of the range of any joint's position over two windows, rad.
        force_error_mps2: of the difference between the mean specific force and gravity in size, m/s^2.
    """

    window_s: float
    gyroscope_std_radps: float
    accelerometer_std_mps2: float
    gyroscope_mean_radps: float = math.inf
    joint_speed_radps: float = math.inf
    joint_travel_rad: float = math.inf
    force_error_mps2: float = math.inf


@dataclass(frozen=True, slots=True, eq=False)
class ImuMeans:
    """Means of an IMU over the window, imu frame unless rotated.

    Attributes:
        stamp_ns: time of the newest sample, in nanoseconds.
        angular_velocity: rad/s, (3,): at rest the gyroscope's bias.
        specific_force: m/s^2, (3,): at rest it points up, with 9.81 and the accelerometer's bias.
        sample_count: samples in the means.
        span_s: time from the oldest to the newest sample, s.
    """

    stamp_ns: int
    angular_velocity: Array
    specific_force: Array
    sample_count: int
    span_s: float

    def rotated(self, rotation: Array) -> "ImuMeans":
        """The same in another frame, by ``R_frame_imu`` (3, 3)."""
        rate, force = rotation @ self.angular_velocity, rotation @ self.specific_force
        return ImuMeans(self.stamp_ns, rate, force, self.sample_count, self.span_s)


class StandstillDetector:
    """Detects standstill from IMU and joints over a sliding window; the cost a sample does not depend on its length.

    The IMU samples have to span the window. Joints have to keep their limit where they are known; NaN is unknown. A
    steady rotation counts as motion once it is faster than a bias can be; a slower one, with still joints, cannot be
    distinguished from rest. Samples whose stamp is not later than the last of their kind are refused and counted.
    """

    def __init__(self, limits: StandstillLimits) -> None:
        self.limits = limits
        window_ns = round(limits.window_s * NS_PER_S)
        self._imu = _SlidingMoments(window_ns)
        self._joints = _SlidingMoments(window_ns)
        self._travel = _Travel(2 * window_ns, limits.joint_travel_rad)
        self._fast_ns: int | None = None
        self._counts = {"standstill_stamp_refused": 0}

    @property
    def counts(self) -> Mapping[str, int]:
        """Samples refused for their stamp."""
        return self._counts

    def push(self, sample: InertialReading | JointSample) -> None:
        """Take one sample of either kind; the two need not come in step."""
        match sample:
            case InertialReading():
                values = np.concatenate((sample.angular_velocity, sample.specific_force))
                is_taken = self._imu.push(sample.stamp_ns, values)
            case JointSample():
                velocity = np.nan_to_num(sample.velocity, nan=0.0) if has_nan(sample.velocity) else sample.velocity
                is_taken = self._joints.push(sample.stamp_ns, velocity)
                fast = _FAST_JOINT * self.limits.joint_speed_radps
                if is_taken and math.isfinite(self.limits.joint_travel_rad):
                    self._travel.push(sample.stamp_ns, sample.position)
                if is_taken and max(velocity.max(initial=0.0), -velocity.min(initial=0.0)) > fast:
                    self._fast_ns = sample.stamp_ns
        if not is_taken:
            self._counts["standstill_stamp_refused"] += 1

    @property
    def is_stationary(self) -> bool:
        """Whether every limit was kept over the whole window, and no joint was fast in it."""
        imu, limits = self._imu, self.limits
        if imu.count < _MIN_SAMPLES or imu.span_ns < _MIN_SPAN * imu.window_ns:
            return False
        if self._fast_ns is not None and self._fast_ns > imu.newest_ns - imu.window_ns:
            return False
        if not self._is_imu_at_rest() or self._travel.is_moving(imu.newest_ns):
            return False
        self._joints.drop_before(imu.newest_ns - imu.window_ns)
        return self._joints.count == 0 or float(self._joints.mean_square().max()) <= limits.joint_speed_radps**2

    def _is_imu_at_rest(self) -> bool:
        mean, variance, limits = self._imu.mean(), self._imu.variance(), self.limits
        if float(variance[:3].sum()) > limits.gyroscope_std_radps**2:  # most often, while the robot walks
            return False
        return bool(
            float(mean[:3] @ mean[:3]) <= limits.gyroscope_mean_radps**2
            and float(variance[3:].sum()) <= limits.accelerometer_std_mps2**2
            and abs(math.sqrt(float(mean[3:] @ mean[3:])) - GRAVITY_MPS2) <= limits.force_error_mps2
        )

    @property
    def means(self) -> ImuMeans | None:
        """The means over the window, at rest or not; None before the first IMU sample."""
        if not self._imu.count:
            return None
        mean, span_s = self._imu.mean(), self._imu.span_ns / NS_PER_S
        return ImuMeans(self._imu.newest_ns, mean[:3], mean[3:], self._imu.count, span_s)

    @property
    def rest(self) -> ImuMeans | None:
        """The means over the window while the robot stands still, otherwise None."""
        return self.means if self.is_stationary else None


class StartRule:
    """When an estimator may start: at rest, or in motion once it has waited for rest long enough.

    Args:
        rest_timeout_s: longest time to wait for rest, s.
    """

    def __init__(self, rest_timeout_s: float) -> None:
        self._timeout_ns = round(rest_timeout_s * NS_PER_S)
        self._first_ns: int | None = None

    def is_met(self, stamp_ns: int, rest: ImuMeans | None) -> bool:
        """Whether to start at ``stamp_ns``, with the means of the IMU at rest or None; waits from the first call on."""
        if self._first_ns is None:
            self._first_ns = stamp_ns
        return rest is not None or stamp_ns - self._first_ns >= self._timeout_ns


@compiled
def _accumulate(total: Array, squares: Array, values: Array, reference: Array, sign: float) -> None:
    """Add deviations from a reference to their sum and to that of their squares, or take them away."""
    for i in range(len(values)):
        deviation = values[i] - reference[i]
        total[i] += sign * deviation
        squares[i] += sign * deviation * deviation


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
            _accumulate(self._sum, self._sum_of_squares, values, self._reference, 1.0)
        return True

    def drop_before(self, stamp_ns: int) -> None:
        while self._samples and self._samples[0][0] < stamp_ns:
            _accumulate(self._sum, self._sum_of_squares, self._samples.popleft()[1], self._reference, -1.0)
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


class _Travel:
    """How far joints go within a span, as multiples of a limit.

    Twice: the range of their means over tenths of the span, in which encoder noise is small, against the limit; and
    the newest position against these means and twice the limit, so that motion shows as soon as it begins.
    """

    def __init__(self, span_ns: int, limit_rad: float) -> None:
        self._span_ns, self._part_ns, self._limit_rad = span_ns, span_ns // 10, limit_rad
        self._first_ns = 0
        self._sum: Array = np.zeros(0)
        self._count = 0
        self._means: deque[tuple[int, Array]] = deque()
        self._moved_ns: int | None = None  # when a joint last was too far from where it had been

    def push(self, stamp_ns: int, position: Array) -> None:
        """Take the joints' positions (J,), rad; NaN is unknown."""
        if self._count and stamp_ns - self._first_ns >= self._part_ns:
            self._means.append((stamp_ns, self._sum / self._count))
            while self._means[0][0] <= stamp_ns - self._span_ns:
                self._means.popleft()
            self._count = 0
            if self._exceeds(self._means[-1][1], self._limit_rad):
                self._moved_ns = stamp_ns
        if not self._count:
            self._first_ns, self._sum = stamp_ns, np.zeros(len(position))
        self._sum = self._sum + position
        self._count += 1
        if self._means and self._exceeds(position, 2.0 * self._limit_rad):
            self._moved_ns = stamp_ns

    def is_moving(self, stamp_ns: int) -> bool:
        """Whether a joint went too far at less than half a span before a time."""
        return self._moved_ns is not None and self._moved_ns > stamp_ns - self._span_ns // 2

    def _exceeds(self, position: Array, limit_rad: float) -> bool:
        away = np.array([mean for _, mean in self._means]) - position
        return bool((np.abs(away) > limit_rad).any())  # NaN is not above

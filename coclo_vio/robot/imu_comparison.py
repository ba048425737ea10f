# SPDX-License-Identifier: BSD-3-Clause
"""Two IMUs on one body against each other: mean readings over the same windows of time, whatever their rates.

Samples of two IMUs fall at other times, and the one whose sample comes last is behind the other: 5 ms are 0.1 rad/s on
a walking robot. Means over one window, of readings interpolated linearly, do not have that difference.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.measurements import InertialReading
from coclo_vio.values.units import NS_PER_S

_MOST_SAMPLES = 1000  # that are kept while the other IMU is silent
_LONGEST_PAUSE_NS = 30_000_000  # between two samples of one window


@dataclass(frozen=True, slots=True, eq=False)
class ImuDifference:
    """Mean readings of the second IMU less those of the first over a window, and what the first measured, body axes.

    Attributes:
        angular_velocity: difference, rad/s, (3,).
        specific_force: difference without that of two places on a rotating body, m/s^2, (3,).
        rate: mean angular velocity by the first, its bias included, rad/s, (3,).
        force: mean specific force by the first, its bias included, m/s^2, (3,).
        angular_acceleration: mean, by the first, rad/s^2, (3,).
        duration_s: length of the window, s.
    """

    angular_velocity: Array
    specific_force: Array
    rate: Array
    force: Array
    angular_acceleration: Array
    duration_s: float


class ImuComparison:
    """Differences of two IMUs over windows that follow one another.

    A window in which one of them pauses gives no difference.

    Args:
        T_body_first: mounting of the first IMU, (4, 4).
        T_body_second: of the second, (4, 4).
        window_s: length of a window, s.
    """

    def __init__(self, T_body_first: Array, T_body_second: Array, window_s: float = 0.1) -> None:
        self._streams = (_Stream(T_body_first[:3, :3]), _Stream(T_body_second[:3, :3]))
        self._lever_cross = so3.hat(T_body_second[:3, 3] - T_body_first[:3, 3])
        self._window_ns = round(window_s * NS_PER_S)
        self._start_ns: int | None = None

    def push(self, sample: InertialReading, *, is_second: bool) -> None:
        """Take a sample, whose stamps are in order for each of the two."""
        self._streams[is_second].push(sample)

    def next(self) -> ImuDifference | None:
        """The difference over the next window, once both have passed its end."""
        first, second = self._streams
        if not (first.samples and second.samples):
            return None
        start_ns = max(first.samples[0][0], second.samples[0][0], self._start_ns or 0)
        end_ns = start_ns + self._window_ns
        if min(first.newest_ns, second.newest_ns) < end_ns:
            return None
        self._start_ns = end_ns
        means = [stream.means(start_ns, end_ns) for stream in self._streams]
        for stream in self._streams:
            stream.drop_before(end_ns)
        if means[0] is None or means[1] is None:
            return None
        (mean, begin, end), (other, _, _) = means[0], means[1]
        duration_s = self._window_ns / NS_PER_S
        acceleration, rate = (end[:3] - begin[:3]) / duration_s, mean[:3]
        by_lever = self._lever_cross @ -acceleration - np.cross(rate, self._lever_cross @ rate)
        difference = other - mean
        return ImuDifference(difference[:3], difference[3:] - by_lever, rate, mean[3:], acceleration, duration_s)


class _Stream:
    """Samples of one IMU in body axes: stamp, angular velocity and specific force (6,)."""

    def __init__(self, rotation_body_imu: Array) -> None:
        self._rotation = rotation_body_imu
        self.samples: deque[tuple[int, Array]] = deque(maxlen=_MOST_SAMPLES)

    @property
    def newest_ns(self) -> int:
        return self.samples[-1][0]

    def push(self, sample: InertialReading) -> None:
        values = self._rotation @ np.column_stack((sample.angular_velocity, sample.specific_force))
        self.samples.append((sample.stamp_ns, values.T.ravel()))

    def means(self, start_ns: int, end_ns: int) -> tuple[Array, Array, Array] | None:
        """Mean over a window, and values at its ends, of the samples interpolated; None where they pause."""
        stamps = np.array([stamp_ns - start_ns for stamp_ns, _ in self.samples], dtype=np.float64)
        first, last = int(np.searchsorted(stamps, 0.0, "right")) - 1, int(np.searchsorted(stamps, end_ns - start_ns))
        if first < 0 or np.diff(stamps[first : last + 1]).max(initial=0.0) > _LONGEST_PAUSE_NS:
            return None
        values = np.array([self.samples[row][1] for row in range(first, last + 1)])
        stamps = stamps[first : last + 1]
        inside = stamps[(stamps > 0.0) & (stamps < end_ns - start_ns)]
        times = np.concatenate(([0.0], inside, [float(end_ns - start_ns)]))
        at = np.column_stack([np.interp(times, stamps, values[:, column]) for column in range(6)])
        return np.trapezoid(at, times, axis=0) / times[-1], at[0], at[-1]

    def drop_before(self, stamp_ns: int) -> None:
        """Keep the last sample before a time, and all from there on."""
        while len(self.samples) > 1 and self.samples[1][0] <= stamp_ns:
            self.samples.popleft()

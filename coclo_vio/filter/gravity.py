# SPDX-License-Identifier: BSD-3-Clause
"""Gravity from the accelerometer while all feet stand, without what the body itself accelerates.

A standing robot still sways and vibrates: half a m/s^2 tilts the measured vertical by three degrees, and keeps its
sign for many samples. The legs measure how the velocity changed meanwhile; over a window the mean specific force less
that change is gravity.
"""

from dataclasses import dataclass

import numpy as np

from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.stance import Reading
from coclo_vio.filter.state import RATE, VELOCITY
from coclo_vio.values.arrays import Array
from coclo_vio.values.units import NS_PER_S

_PRIOR, _MEMORY = 6.0, 60.0  # windows
_MOST_EXCESS, _MOST_SCALE = 9.0, 4.0
_TIMEOUT_NS = 100_000_000  # a window with a longer gap between samples is dropped


@dataclass(frozen=True, slots=True, eq=False)
class GravityReading:
    """Gravity as measured over one window.

    Attributes:
        force_world: mean specific force less the body's acceleration, world, m/s^2, (3,): up, and 9.81.
        duration_s: length of the window, s.
    """

    force_world: Array
    duration_s: float

    def sigma(self, core: SquareRootFilter, noise_mps2: float) -> float:
        """One sigma of each axis: of the force, and of the change of velocity by the filter's own, m/s^2."""
        variance = float(core.variance(VELOCITY).mean())
        return float(np.hypot(noise_mps2, np.sqrt(2.0 * variance) / self.duration_s))


class GravityScale:
    """The noise of gravity windows in this recording, as a multiple of the claimed one.

    How evenly a robot accelerates, and how its accelerometer bears shocks, differs by a factor of ten. The squared
    innovations, less the filter's own variance, over the claimed variance have the mean ``scale^2``. The mean fades
    with ``_MEMORY`` windows, and begins with ``_PRIOR`` windows of 1.
    Source: adaptive measurement noise by innovations, Mehra, "On the identification of variances", 1970.

    Args:
        least: below which the scale does not fall: scale factors and misaligned axes do not show in innovations.

    Attributes:
        scale: of the sigma.
    """

    def __init__(self, least: float) -> None:
        self.scale = 1.0
        self._least, self._weight, self._sum = least, _PRIOR, _PRIOR

    def learn(self, squared: float) -> None:
        """Take a window: its mean squared innovation, less the filter's variance, over the claimed variance."""
        limited = min(max(squared, 0.0), _MOST_EXCESS * self.scale**2)  # one shock does not decide
        kept = 1.0 - 1.0 / _MEMORY
        self._weight, self._sum = kept * self._weight + 1.0, kept * self._sum + limited
        self.scale = min(max(float(np.sqrt(self._sum / self._weight)), self._least), _MOST_SCALE)


class GravityWindow:
    """Collects specific force and velocity over windows that follow one another without overlap.

    A gait leaves all feet on the ground for a tenth of a second at a time, so a window that a lifting foot ends early
    still counts if it lasted half its length.

    Args:
        dwell_s: all feet must have stood for this long before a window opens, s.
        length_s: of a window, s.
    """

    def __init__(self, dwell_s: float, length_s: float) -> None:
        self._dwell_ns, self._length_ns = round(dwell_s * NS_PER_S), round(length_s * NS_PER_S)
        self._stood_since_ns: int | None = None
        self._opened_ns: int | None = None
        self._last_ns = 0
        self._impulse = self._velocity_then = self._velocity_now = np.zeros(3)

    def collect(
        self, core: SquareRootFilter, reading: Reading, force_body: Array | None, lever_cross: Array
    ) -> GravityReading | None:
        """Take the specific force since the last joint sample, and the filter's velocity at the accelerometer.

        Args:
            core: the filter.
            reading: the joint sample; without a foot in stance the window ends.
            force_body: body frame, m/s^2, (3,); None where the accelerometer is slower than the joints.
            lever_cross: of the place of the accelerometer, body frame, m: ``w @ lever_cross`` is ``w x place``, (3, 3).
        """
        mean = core.mean
        if not reading.stands:
            return self.close()
        if force_body is None:
            return None
        velocity = mean.vector[VELOCITY] + mean.rotation @ (mean.vector[RATE] @ lever_cross)
        return self.add(reading.stamp_ns, mean.rotation @ force_body, velocity)

    def close(self) -> GravityReading | None:
        """End the window because not all feet are known to stand; its reading, if it was long enough."""
        collected_ns = 0 if self._opened_ns is None else self._last_ns - self._opened_ns
        reading = self._reading() if 2 * collected_ns >= self._length_ns else None
        self._clear()
        return reading

    def add(self, stamp_ns: int, force_world: Array, velocity_world: Array) -> GravityReading | None:
        """Take a sample at which all feet stand; a reading where it completes a window.

        Args:
            stamp_ns: time in nanoseconds.
            force_world: specific force since the last sample, m/s^2, world, (3,).
            velocity_world: of the accelerometer, m/s, (3,).
        """
        if self._opened_ns is not None and stamp_ns - self._last_ns > _TIMEOUT_NS:
            self._clear()
        if self._stood_since_ns is None:
            self._stood_since_ns = stamp_ns
        if self._opened_ns is None:
            if stamp_ns - self._stood_since_ns >= self._dwell_ns:
                self._open(stamp_ns, velocity_world)
            return None
        self._impulse = self._impulse + force_world * ((stamp_ns - self._last_ns) / NS_PER_S)
        self._last_ns, self._velocity_now = stamp_ns, velocity_world
        if stamp_ns - self._opened_ns < self._length_ns:
            return None
        reading = self._reading()
        self._open(stamp_ns, velocity_world)
        return reading

    def _reading(self) -> GravityReading:
        assert self._opened_ns is not None, "a window is open"
        duration_s = (self._last_ns - self._opened_ns) / NS_PER_S
        return GravityReading((self._impulse - self._velocity_now + self._velocity_then) / duration_s, duration_s)

    def _open(self, stamp_ns: int, velocity_world: Array) -> None:
        self._opened_ns = self._last_ns = stamp_ns
        self._velocity_then = self._velocity_now = velocity_world
        self._impulse = np.zeros(3)

    def _clear(self) -> None:
        self._stood_since_ns = self._opened_ns = None

# SPDX-License-Identifier: BSD-3-Clause
"""Whether the accelerometer measures gravity where the estimated attitude has it; if not, the IMU is left out.

Whatever a robot on its feet does, over some tenths of a second its accelerations cancel and gravity is left. Axes that
are interchanged or reversed (a cable, a driver, a reset of the sensor) turn gravity by tens of degrees from one sample
to the next, and turn the gyroscope with it. A filter that takes such an accelerometer as its input is off by a metre
within a second, and its feet are then what departs. An accelerometer that has never agreed, such as one whose driver
subtracts gravity, is another matter, and its gyroscope may be right: it is left as it is.
"""

import math
from collections.abc import Sequence

import numpy as np

from coclo_vio.values.arrays import Array
from coclo_vio.values.outputs import Event
from coclo_vio.values.units import GRAVITY_MPS2, NS_PER_S

_WINDOW_S = 0.3  # of the mean; a step of a trot takes as long or less
_LARGEST_MPS2 = 20.0  # of one sample: an impact counts as no more
_CONTRADICTS_MPS2 = 6.0  # a trot, a bound or a stumble stays below 3
_AGREES_MPS2 = 2.5
_AGREES_S = 1.0  # for so long, and the IMU is used again
_LONGEST_STEP_S = 0.1  # what is further apart is no mean


class GravityCheck:
    """Follows the mean of what the accelerometer measures beside gravity.

    ``imu_set_aside`` comes where it is more than 6 m/s^2 while a foot stands, of an IMU that has agreed before, and
    ``imu_used_again`` once it has been less than 2.5 m/s^2 for a second.

    Attributes:
        is_aside: whether the IMU's samples are to be left out.
    """

    def __init__(self, name: str) -> None:
        """Take whose IMU it is, as in "body's"."""
        self.is_aside, self._name = False, name
        self._has_agreed = False  # for long enough, once
        self._mean: Array = np.zeros(3)  # body axes
        self._agreed_s, self._last_ns = 0.0, 0
        self._events: list[Event] = []

    def push(self, stamp_ns: int, force_body: Array, up_body: Array | None) -> None:
        """Take a sample.

        Args:
            stamp_ns: of the sample, in nanoseconds.
            force_body: specific force, m/s^2, body axes, (3,).
            up_body: upward direction by the estimated attitude, body axes, (3,); None while no foot stands, or before
                the start.
        """
        dt_s, self._last_ns = (stamp_ns - self._last_ns) / NS_PER_S, stamp_ns
        if up_body is None:
            return
        if dt_s > _LONGEST_STEP_S:
            self._mean, self._agreed_s = np.zeros(3), 0.0
            return
        beside = force_body - GRAVITY_MPS2 * up_body
        largest = max(math.sqrt(float(beside @ beside)), _LARGEST_MPS2)
        self._mean += dt_s / (dt_s + _WINDOW_S) * (_LARGEST_MPS2 / largest * beside - self._mean)
        size = math.sqrt(float(self._mean @ self._mean))
        self._agreed_s = self._agreed_s + dt_s if size < _AGREES_MPS2 else 0.0
        self._has_agreed = self._has_agreed or self._agreed_s > _AGREES_S
        if self.is_aside:
            if self._agreed_s > _AGREES_S:
                self._use_again(stamp_ns)
        elif self._has_agreed and size > _CONTRADICTS_MPS2:
            self._set_aside(stamp_ns, force_body, up_body, size)

    def take_events(self) -> Sequence[Event]:
        """What was found since the last call."""
        events, self._events = self._events, []
        return events

    def _set_aside(self, stamp_ns: int, force_body: Array, up_body: Array, size: float) -> None:
        self.is_aside = True
        cosine = float(force_body @ up_body) / max(float(np.linalg.norm(force_body)), 1e-9)
        degrees = float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
        detail = (
            f"the {self._name} accelerometer measures {size:.1f} m/s^2 beside gravity in the mean of {_WINDOW_S} s "
            f"(limit {_CONTRADICTS_MPS2}), and gravity {degrees:.0f} deg from where the estimated attitude has it: the "
            f"{self._name} IMU is set aside until it agrees again; check its axes, signs and mounting"
        )
        self._events.append(Event(stamp_ns, "imu_set_aside", detail))

    def _use_again(self, stamp_ns: int) -> None:
        self.is_aside = False
        detail = f"the {self._name} accelerometer has agreed with the attitude for {_AGREES_S:.0f} s: its IMU is used"
        self._events.append(Event(stamp_ns, "imu_used_again", detail))

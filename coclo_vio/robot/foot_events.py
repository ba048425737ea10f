# SPDX-License-Identifier: BSD-3-Clause
"""Events of the feet: slips, one each, and times without any foot in stance."""

from collections.abc import Sequence

from coclo_vio.robot.contact import ContactConfig
from coclo_vio.robot.leg_sensing import Reading
from coclo_vio.robot.slip import SlipConfig
from coclo_vio.robot.slip_report import SlipReport
from coclo_vio.values.outputs import Event
from coclo_vio.values.units import NS_PER_S

_UNSUPPORTED_S = 1.0  # no jump lasts so long
_GAP_S = 0.1  # without readings


class FootEvents:
    """Looks at readings, and holds the events until they are taken.

    ``no_support`` comes once no foot has been in stance for a second, as of a robot that is lifted or whose foot
    sensors fail, and ``support_again`` with the first foot that stands again. A time without readings does not count.
    """

    def __init__(self, config: SlipConfig, contact: ContactConfig, leg_names: Sequence[str]) -> None:
        """Take limits of slips, how the robot senses contact, and the names of its legs."""
        self._slips = SlipReport(config, contact, leg_names)
        self._supported_ns: int | None = None  # when a foot stood last, or readings began again
        self._last_ns: int | None = None  # of the last reading
        self._is_unsupported = False
        self._events: list[Event] = []

    def push(self, reading: Reading) -> None:
        """Take a reading."""
        self._slips.push(reading)
        stamp_ns, since_ns = reading.stamp_ns, self._supported_ns
        if self._last_ns is not None and stamp_ns - self._last_ns > _GAP_S * NS_PER_S and not self._is_unsupported:
            since_ns = self._supported_ns = stamp_ns
        self._last_ns = stamp_ns
        if since_ns is None or stamp_ns < since_ns or reading.stands:
            self._supported_ns = stamp_ns
            if self._is_unsupported and since_ns is not None:
                without_s = (stamp_ns - since_ns) / NS_PER_S
                detail = f"a foot stands again after {without_s:.1f} s without any"
                self._events.append(Event(stamp_ns, "support_again", detail))
            self._is_unsupported = False
        elif not self._is_unsupported and stamp_ns - since_ns > _UNSUPPORTED_S * NS_PER_S:
            self._is_unsupported = True
            detail = (
                f"no foot has been in stance for {_UNSUPPORTED_S:.0f} s: legs do not measure the velocity; the filter "
                "goes on by the IMU, and its covariance grows"
            )
            self._events.append(Event(stamp_ns, "no_support", detail))

    def take_events(self) -> Sequence[Event]:
        """What was found since the last call."""
        events, self._events = self._events, []
        return (*self._slips.take_events(), *events)

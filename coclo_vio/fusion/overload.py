# SPDX-License-Identifier: BSD-3-Clause
"""Measurements that are left out because they come faster than they can be processed: one event at the beginning of an
episode, one at its end. Images go first, joint samples only where that does not suffice."""

from abc import ABC, abstractmethod

from coclo_vio.values.outputs import Event
from coclo_vio.values.units import NS_PER_S

_OVER_AFTER_S = 2.0  # without anything left out


class _Overload(ABC):
    """Counts what is left out in an episode.

    An episode begins with a measurement that is left out, and ends with the first one after two seconds without any.
    """

    def __init__(self, reason: str) -> None:
        """Take the reason why measurements are left out, a clause for the event."""
        self._reason = reason
        self._left_out = 0
        self._last_ns = 0

    def leave_out(self, stamp_ns: int) -> tuple[Event, ...]:
        """A measurement of this stamp is left out; the event of an episode that begins with it."""
        self._left_out, self._last_ns = self._left_out + 1, stamp_ns
        return (self._beginning(stamp_ns),) if self._left_out == 1 else ()

    def take(self, stamp_ns: int) -> tuple[Event, ...]:
        """A measurement of this stamp is processed; the event of an episode that is over."""
        if not self._left_out or abs(stamp_ns - self._last_ns) / NS_PER_S < _OVER_AFTER_S:
            return ()
        left_out, self._left_out = self._left_out, 0
        return (self._end(stamp_ns, left_out),)

    @abstractmethod
    def _beginning(self, stamp_ns: int) -> Event:
        """Of an episode."""

    @abstractmethod
    def _end(self, stamp_ns: int, left_out: int) -> Event:
        """Of an episode."""


class ImageOverload(_Overload):
    """Images that are left out."""

    def _beginning(self, stamp_ns: int) -> Event:
        detail = (
            f"{self._reason}; images are left out before joints and IMUs are: lower the rate or the size of the "
            "images, or set frontend.tracks lower"
        )
        return Event(stamp_ns, "images_left_out", detail)

    def _end(self, stamp_ns: int, left_out: int) -> Event:
        return Event(stamp_ns, "images_in_time", f"all images are processed again, after {left_out} left out")


class JointOverload(_Overload):
    """Joint samples that are left out, where leaving out images does not suffice."""

    def _beginning(self, stamp_ns: int) -> Event:
        detail = (
            f"{self._reason}, even where images are left out; joint samples are left out, one of two at first: set "
            "online.joint_interval_s to the interval that this computer keeps pace with, such as 0.004"
        )
        return Event(stamp_ns, "joints_left_out", detail)

    def _end(self, stamp_ns: int, left_out: int) -> Event:
        return Event(stamp_ns, "joints_in_time", f"all joint samples are processed again, after {left_out} left out")

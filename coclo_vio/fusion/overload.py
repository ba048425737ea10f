# SPDX-License-Identifier: BSD-3-Clause
"""Images that are left out because they come faster than they can be processed: one event at the beginning of such an
episode, one at its end."""

from coclo_vio.values.outputs import Event
from coclo_vio.values.units import NS_PER_S

_OVER_AFTER_S = 2.0  # without an image left out


class ImageOverload:
    """Counts the images left out in an episode.

    An episode begins with an image that is left out, and ends with the first image after two seconds without any.
    """

    def __init__(self, reason: str) -> None:
        """Take the reason why images are left out, a clause for the event."""
        self._reason = reason
        self._left_out = 0
        self._last_ns = 0

    def leave_out(self, stamp_ns: int) -> tuple[Event, ...]:
        """An image of this stamp is left out; the event of an episode that begins with it."""
        self._left_out, self._last_ns = self._left_out + 1, stamp_ns
        if self._left_out > 1:
            return ()
        detail = (
            f"{self._reason}; images are left out, joints and IMUs are not: lower the rate or the size of the images, "
            "or set frontend.tracks lower"
        )
        return (Event(stamp_ns, "images_left_out", detail),)

    def take(self, stamp_ns: int) -> tuple[Event, ...]:
        """An image of this stamp is processed; the event of an episode that is over."""
        if not self._left_out or (stamp_ns - self._last_ns) / NS_PER_S < _OVER_AFTER_S:
            return ()
        left_out, self._left_out = self._left_out, 0
        return (Event(stamp_ns, "images_in_time", f"all images are processed again, after {left_out} left out"),)

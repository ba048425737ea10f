# SPDX-License-Identifier: BSD-3-Clause
"""Slips of feet as events of an estimator, one each."""

from collections.abc import Sequence

from coclo_vio.robot.contact import ContactConfig
from coclo_vio.robot.kinematic_contact import MOST_LEGS
from coclo_vio.robot.leg_sensing import Reading
from coclo_vio.robot.slip import SlipConfig, SlipSearch
from coclo_vio.values.outputs import SlipEvent
from coclo_vio.values.thinning import Thinning

_LEGS_BY_DEFAULT = 4  # the search goes through all sets of legs: twice as long with one leg more


class SlipReport:
    """Searches readings for slips, and holds the events until they are taken."""

    def __init__(self, config: SlipConfig, contact: ContactConfig, leg_names: Sequence[str]) -> None:
        """Take limits.

        Args:
            config: limits.
            contact: how the robot senses contact; nothing is searched with more legs than it can follow by motion.
            leg_names: of the robot.
        """
        self._names = tuple(leg_names)
        is_wanted = len(self._names) <= _LEGS_BY_DEFAULT if config.is_enabled is None else config.is_enabled
        is_possible = is_wanted and len(self._names) <= MOST_LEGS
        self._search = SlipSearch(config, contact.kinematic, len(self._names)) if is_possible else None
        self._thinning = Thinning(config.interval_s)
        self._events: list[SlipEvent] = []

    def push(self, reading: Reading) -> None:
        """Take a reading."""
        if self._search is None or reading.motion is None or self._thinning.leaves_out(reading.stamp_ns):
            return
        for slip in self._search.push(reading.motion, reading.contact.is_stance):
            foot = self._names[slip.leg]
            detail = (
                f"foot {foot} slid {1e3 * slip.distance_m:.0f} mm in {slip.duration_s:.2f} s while its contact was in "
                "stance; the filter weighs or rejects its leg by how fast the foot moves"
            )
            self._events.append(
                SlipEvent(slip.start_ns, "foot_slipped", detail, foot, slip.duration_s, slip.distance_m)
            )

    def take_events(self) -> Sequence[SlipEvent]:
        """The slips that were over since the last call."""
        events, self._events = self._events, []
        return events

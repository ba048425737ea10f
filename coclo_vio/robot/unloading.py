# SPDX-License-Identifier: BSD-3-Clause
"""Feet that lift off, by joint torques, while a foot sensor still reads a load.

A pressure sensor in a rubber foot falls some 10 to 20 ms after a foot has lifted off. Meanwhile the foot extends and
swings, and would count as standing. Joint torques fall at once. In the air they show the inertia of the leg as well as
a load, so they only end a stance, and only one in which they had shown a load: torques that are zero, or far off,
change nothing.
"""

from dataclasses import replace

import numpy as np

from coclo_vio.robot.contact import ContactState
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.units import NS_PER_S

_BEARS = 2.0  # a foot bears a load by its torques from this multiple of the limit on
_RETURN_NS = round(0.15 * NS_PER_S)  # a foot that bears so long stands after all: in swing it seems to for 0.1 s


class Unloading:
    """Ends stances by the load that joint torques show.

    Args:
        limit_n: a foot that has borne a load and whose load falls below this lifts off, N.
        legs: how many.
    """

    def __init__(self, limit_n: float, legs: int) -> None:
        self._limit_n = limit_n
        self._has_borne: BoolArray = np.zeros(legs, dtype=np.bool_)
        self._has_lifted: BoolArray = np.zeros(legs, dtype=np.bool_)
        self._bears_since_ns = np.zeros(legs, dtype=np.int64)

    def corrected(self, stamp_ns: int, contact: ContactState, load_n: Array) -> ContactState:
        """The contact at a joint sample without the feet that have lifted off.

        Args:
            stamp_ns: of the sample, in nanoseconds.
            contact: by the foot sensors.
            load_n: on each foot by joint torques, N, (n,); NaN where unknown.
        """
        stands, bears = contact.is_stance, load_n > _BEARS * self._limit_n
        self._bears_since_ns = np.where(bears, self._bears_since_ns, stamp_ns)
        stands_after_all = bears & (stamp_ns - self._bears_since_ns > _RETURN_NS)
        lifts = self._has_borne & (load_n < self._limit_n)
        self._has_lifted = stands & (self._has_lifted | lifts) & ~stands_after_all
        self._has_borne = stands & ~self._has_lifted & (self._has_borne | bears)
        if not self._has_lifted.any():
            return contact
        probability = np.where(self._has_lifted, 0.0, contact.probability)
        return replace(contact, probability=probability, is_stance=stands & ~self._has_lifted)

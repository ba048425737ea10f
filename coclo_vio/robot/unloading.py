# SPDX-License-Identifier: BSD-3-Clause
"""Feet that lift off, by joint torques, while a foot sensor still reads a load.

A pressure sensor in a rubber foot falls some 10 to 20 ms after a foot has lifted off. Meanwhile the foot extends and
swings, and would count as standing. Joint torques fall at once. In the air they show the inertia of the leg as well as
a load, so they only end a stance, and only one in which they had shown a load: torques that are zero, or far off,
change nothing.
"""

from dataclasses import replace

import numpy as np

from coclo_vio.geometry.compiled import compiled
from coclo_vio.robot.contact import ContactState
from coclo_vio.values.arrays import Array, BoolArray, IntArray
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
        stands = contact.is_stance
        if not _follow(
            stamp_ns, stands, load_n, self._limit_n, self._has_borne, self._has_lifted, self._bears_since_ns
        ):
            return contact
        probability = np.where(self._has_lifted, 0.0, contact.probability)
        return replace(contact, probability=probability, is_stance=stands & ~self._has_lifted)


@compiled
def _follow(
    stamp_ns: int,
    stands: BoolArray,
    load_n: Array,
    limit_n: float,
    has_borne: BoolArray,
    has_lifted: BoolArray,
    bears_since_ns: IntArray,
) -> bool:
    """Follow which feet have borne a load, have lifted off, and since when they bear, (n,); whether any has lifted."""
    any_lifted = False
    for leg in range(len(stands)):
        bears = load_n[leg] > _BEARS * limit_n
        if not bears:
            bears_since_ns[leg] = stamp_ns
        lifts = has_lifted[leg] or (has_borne[leg] and load_n[leg] < limit_n)
        stands_after_all = bears and stamp_ns - bears_since_ns[leg] > _RETURN_NS
        has_lifted[leg] = stands[leg] and lifts and not stands_after_all
        has_borne[leg] = stands[leg] and not has_lifted[leg] and (has_borne[leg] or bears)
        any_lifted = any_lifted or has_lifted[leg]
    return any_lifted

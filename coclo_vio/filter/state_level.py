# SPDX-License-Identifier: BSD-3-Clause
"""The level of a decaying state, such as slip: learnt for this recording from what corrections show of the state.

How much feet slip differs by a factor of ten from ground to ground, and decides what legs weigh against vision. A state
``x`` that decays to zero, with a random walk that keeps its variance at ``s^2``, has ``E[x^2] = s^2``, and given the
data ``E[x^2] = mean^2 + variance``. The mean of that over time is the next ``s^2`` (expectation maximisation). Where
nothing observes the state its variance is ``s^2``, and the level stays where it is.

Vision of weak texture does not observe a slip of a few per mille, so by that alone exact legs would weigh no more than
poor ones. Redundant legs show it: n feet that slip by ``s`` each, independently, differ by about ``s`` and have
``s / sqrt(n)`` in common. So where four feet or more stand at a time, how they differ bounds the level, with a margin.
Slip that is the same for all feet, as on ground that moves, does not show. The random walk of a foot in stance is
learnt in the same way: as much of it as the differences of legs from interval to interval show, and all of it where
legs differ for long too: feet that slide down a slope in jumps do both, and what they have in common shows nowhere.
Source: Dempster, Laird and Rubin, "Maximum likelihood from incomplete data via the EM algorithm", 1977.
"""

from typing import TypeGuard

import numpy as np

from coclo_vio.filter.leg_consistency import LegConsistency
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.state import StateLayout
from coclo_vio.filter.state_blocks import StateBlock

_LIMITS = (0.2, 4.0)  # of the level
_PRIOR_MEMORIES = 2.0  # the declared sigma counts as much as data of so many time constants of the state
_FADING_MEMORIES = 6.0  # data fade with so many time constants
_LEAST_LEGS, _LEAST_STANCES = 3.5, 8.0  # of a comparison of legs that says how much they slip in common
_COMMON = 1.5  # most of a common slip, as a multiple of how legs differ


class StateLevel:
    """The sigma of a block as a multiple of the declared one, and its random walk accordingly.

    Attributes:
        level: that multiple.
    """

    def __init__(self, block: StateBlock) -> None:
        """Take a block that decays and has a random walk."""
        self.level = 1.0
        self._block = block
        self._sigma = float(np.mean(np.asarray(block.sigma)))
        self._weight, self._sum = 0.0, 0.0
        self._stamp_ns: int | None = None

    def learn(self, core: SquareRootFilter, stamp_ns: int, largest: float = np.inf) -> None:
        """Take the state after a correction from outside, and set its random walk.

        Args:
            core: the filter; its layout's walks are set in place.
            stamp_ns: of the filter, in nanoseconds.
            largest: level, by other evidence.
        """
        before, self._stamp_ns = self._stamp_ns, stamp_ns
        if before is None or stamp_ns <= before:
            return
        layout = core.mean.layout
        at = layout.at(self._block.name)
        squared = float(np.mean(np.square(core.mean.vector[at]) + core.variance(at))) / self._sigma**2
        new = (stamp_ns - before) * 1e-9 / self._block.memory_s
        kept = float(np.exp(-new / _FADING_MEMORIES))
        self._weight, self._sum = kept * self._weight + new, kept * self._sum + new * squared
        self.level = float(np.sqrt((_PRIOR_MEMORIES + self._sum) / (_PRIOR_MEMORIES + self._weight)))
        self.level = float(np.clip(min(self.level, largest), *_LIMITS))
        layout.walks[at] = self._block.walk * self.level


class SlipLevels:
    """The levels of all blocks of a state that decay and have a random walk, and that of a foot in stance."""

    def __init__(self, layout: StateLayout, slip_share: float) -> None:
        """Take the state, and the declared sigma of the slip."""
        self._levels = [StateLevel(each) for each in layout.blocks if np.isfinite(each.memory_s) and each.walk > 0.0]
        self._slip_share = slip_share

    def learn(self, core: SquareRootFilter, stamp_ns: int, consistency: LegConsistency | None) -> float:
        """Learn them after a correction from outside; returns ``creep_level``.

        Args:
            core: the filter.
            stamp_ns: of the filter, in nanoseconds.
            consistency: of the legs; None where they are not compared.
        """
        largest = largest_level(consistency, self._slip_share)
        for level in self._levels:
            level.learn(core, stamp_ns, largest)
        return creep_level(consistency, self._slip_share)


def _is_comparison(consistency: LegConsistency | None) -> TypeGuard[LegConsistency]:
    """Whether it says how much legs have in common."""
    return consistency is not None and consistency.legs >= _LEAST_LEGS and consistency.stances >= _LEAST_STANCES


def creep_level(consistency: LegConsistency | None, slip_share: float) -> float:
    """The random walk of a foot in stance by how legs differ, as a multiple of the declared one, at most 1.

    Args:
        consistency: of the legs; None where they are not compared.
        slip_share: the declared sigma of the slip.
    """
    if not _is_comparison(consistency) or slip_share == 0.0:
        return 1.0
    return float(np.sqrt(min(1.0, consistency.noise_factor + (consistency.lasting_share / slip_share) ** 2)))


def largest_level(consistency: LegConsistency | None, slip_share: float) -> float:
    """The largest level of slip by how legs differ; infinite where they are too few or were compared too seldom.

    Args:
        consistency: of the legs; None where they are not compared.
        slip_share: the declared sigma of the slip.
    """
    if not _is_comparison(consistency) or slip_share == 0.0:
        return np.inf
    return _COMMON * consistency.lasting_share / slip_share

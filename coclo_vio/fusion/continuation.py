# SPDX-License-Identifier: BSD-3-Clause
"""Estimators that go on after an interruption, and start with what an earlier one has learnt, by their filter."""

from typing import Protocol, runtime_checkable

from coclo_vio.filter.interruption import Learnt


@runtime_checkable
class ContinuingFilter(Protocol):
    """A filter that can be interrupted, and takes over what another one has learnt."""

    def interrupt(self, gap_sigma_s: float) -> None:
        """An unknown time passes before the next measurement; one sigma of it, s."""

    @property
    def learnt(self) -> Learnt:
        """Constants as estimated."""

    def start_with(self, learnt: Learnt) -> None:
        """Take over constants."""


class Continuing:
    """What an estimator with a filter does beyond ``push`` and ``finish``; without effect where its filter cannot."""

    @property
    def learnt(self) -> Learnt:
        """Constants that the filter has learnt; empty for one that learns none."""
        continuing = self._continuing
        return {} if continuing is None else continuing.learnt

    def interrupt(self, gap_sigma_s: float) -> bool:
        """An unknown time passes before the next measurement; whether the filter allows for it.

        Args:
            gap_sigma_s: one sigma of that time, s.
        """
        continuing = self._continuing
        if continuing is not None:
            continuing.interrupt(gap_sigma_s)
        return continuing is not None

    def start_with(self, learnt: Learnt) -> None:
        """Start with what an earlier filter has learnt; before the first measurement."""
        continuing = self._continuing
        if continuing is not None:
            continuing.start_with(learnt)

    @property
    def _continuing(self) -> ContinuingFilter | None:
        own = getattr(self, "_filter", None)
        return own if isinstance(own, ContinuingFilter) else None

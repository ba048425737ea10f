# SPDX-License-Identifier: BSD-3-Clause
"""Leg odometry as an estimator: any filter of joint samples, its states under a name."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Protocol, runtime_checkable

from coclo_vio.fusion.continuation import Continuing
from coclo_vio.fusion.streaming import StreamingEstimator
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.measurements import Measurement
from coclo_vio.values.outputs import Estimate, Event, Innovation, Output


class StateFilter(Protocol):
    """A filter that gives a state where a measurement completes a step."""

    def push(self, measurement: Measurement) -> StateEstimate | None:
        """Take one measurement; the new state, or None."""

    @property
    def counts(self) -> Mapping[str, int]:
        """How often each unusual thing happened."""


@runtime_checkable
class ReportsEvents(Protocol):
    """A filter that reports unusual conditions."""

    def take_events(self) -> Sequence[Event | Innovation]:
        """What was reported since the last call."""


class LegOdometry(Continuing, StreamingEstimator):
    """A filter's states, each as an ``Estimate`` of one trajectory."""

    def __init__(self, name: str, state_filter: StateFilter) -> None:
        """Take a filter.

        Args:
            name: of the trajectory.
            state_filter: a fresh one.
        """
        super().__init__()
        self._name, self._filter = name, state_filter
        self._reports = state_filter if isinstance(state_filter, ReportsEvents) else None

    @property
    def counts(self) -> Mapping[str, int]:
        """What the filter counted."""
        return self._filter.counts

    def _process(self, measurement: Measurement) -> Iterator[Output]:
        state = self._filter.push(measurement)
        if state is not None:
            yield Estimate(self._name, state)
            if self._reports is not None:
                yield from self._reports.take_events()

# SPDX-License-Identifier: BSD-3-Clause
"""An estimator that an error of one measurement does not end, with the events of the wire among its outputs."""

from collections.abc import Callable, Iterable, Iterator, Mapping

import numpy as np

from coclo_vio.live.wire_events import WireEvents
from coclo_vio.online.guarded_estimator import GuardedEstimator
from coclo_vio.values.errors import CocloError, shortened
from coclo_vio.values.measurements import Measurement
from coclo_vio.values.outputs import Output

_REFUSALS = (CocloError, ArithmeticError, ValueError, IndexError, np.linalg.LinAlgError)


class UnendingEstimator:
    """Passes measurements on to another estimator; what it raises becomes an event, and the next one is passed on."""

    def __init__(
        self, estimator: GuardedEstimator, events: WireEvents, arrival_ns: Callable[[], int | None] = lambda: None
    ) -> None:
        """Take the estimator and the events of the wire.

        Args:
            estimator: behind the guard.
            events: of the wire; gets what the estimator raises.
            arrival_ns: when the measurement that is pushed came, by a clock that never steps; None if that is unknown.
        """
        self._estimator, self._events, self._arrival_ns = estimator, events, arrival_ns

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Earliest and latest stamp of the samples that the estimator used; None before any."""
        return self._estimator.span_ns

    def push(self, measurement: Measurement) -> Iterator[Output]:
        """The outputs of one measurement, then the events that are due."""
        name = type(measurement).__name__
        yield from self._guarded(lambda: self._estimator.push(measurement, self._arrival_ns()), name)
        yield from self._events.due(measurement.stamp_ns)

    def finish(self) -> Iterator[Output]:
        """The outputs of what is still held back, then all events that are left."""
        last_ns = 0
        for output in self._guarded(self._estimator.finish, "the end"):
            last_ns = getattr(output, "stamp_ns", last_ns)
            yield output
        yield from self._events.due(last_ns, is_last=True)

    @property
    def counts(self) -> Mapping[str, int]:
        """What the estimator counted."""
        return self._estimator.counts

    def _guarded(self, call: Callable[[], Iterable[Output]], what: str) -> Iterator[Output]:
        try:
            yield from call()
        except _REFUSALS as error:
            self._events.report(what, f"the estimator refused it: {shortened(error)}", kind="measurement_refused")

# SPDX-License-Identifier: BSD-3-Clause
"""``push`` and ``finish`` of estimators: measurements on one clock in, outputs out, none of them lost by an error."""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence

from coclo_vio.fusion.image_clock import ImageClock
from coclo_vio.values.errors import CocloError
from coclo_vio.values.measurements import Measurement
from coclo_vio.values.outputs import Output


class StreamingEstimator(ABC):
    """An estimator that processes measurements one by one, in the order of the IMU's clock.

    Invariant: where processing fails, the outputs before come first. The error is raised by the next ``push``, and in
    ``finish`` after its outputs.
    """

    def __init__(self, clock: ImageClock | None = None) -> None:
        """Take a clock.

        Args:
            clock: that of the cameras against the others'; None where there is but one.
        """
        self._clock = clock or ImageClock(0.0, waits=False)
        self._error: CocloError | None = None
        self._counted: Counter[str] = Counter()

    def push(self, measurement: Measurement) -> Sequence[Output]:
        """Take one measurement; the outputs that it leads to, in order.

        Raises:
            CocloError: the estimator cannot go on.
        """
        return self._outputs(self._clock.push(measurement))

    def finish(self) -> Iterator[Output]:
        """The outputs of measurements that wait for others, once no measurement comes any more.

        They are worked out as they are taken, so that none is lost by an error: take them all.

        Raises:
            CocloError: the estimator cannot go on.
        """
        yield from self._outputs(self._clock.finish())
        self._raise_error()
        yield from self._end()

    @property
    def counts(self) -> Mapping[str, int]:
        """How often each unusual thing happened, by name."""
        return {**self._counted, **self._clock.counts}

    def _end(self) -> Iterator[Output]:
        """What is left once all measurements are processed; nothing unless an estimator holds results back."""
        yield from ()

    @abstractmethod
    def _process(self, measurement: Measurement) -> Iterator[Output]:
        """The outputs of a measurement that is next in order."""

    def _outputs(self, due: Iterable[Measurement]) -> Sequence[Output]:
        self._raise_error()
        outputs: list[Output] = []
        try:
            for measurement in due:
                for output in self._process(measurement):
                    outputs.append(output)
        except CocloError as error:
            if not outputs:
                raise
            self._error = error
        return outputs

    def _raise_error(self) -> None:
        """Raise the error that was held back, if there is one."""
        if self._error is not None:
            error, self._error = self._error, None
            raise error

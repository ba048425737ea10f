# SPDX-License-Identifier: BSD-3-Clause
"""Outputs by the clock that a run began with, also after the clock of all streams has stepped.

An estimator's outputs carry the stamps of the samples, which go back where the clock does. The files of a run have them
by its first clock, so that stamps only rise there and one ground truth fits all of them.
"""

from collections.abc import Iterator
from dataclasses import replace

from coclo_vio.values.outputs import ClockStepEvent, Estimate, Output


class FirstClock:
    """Undoes the steps of a clock, output by output, in their order.

    A stamp alone may be one of several epochs: of these it is the one that is next to the latest output and, of an
    estimate, after the last one of its trajectory.
    """

    def __init__(self) -> None:
        self._from_ns: list[int] = []  # beginnings of the epochs after the first, by the first clock
        self._shifts_ns = [0]  # by epoch: its clock less the first one
        self._latest_ns = 0
        self._last_ns: dict[str, int] = {}  # by trajectory

    def undone(self, output: Output) -> Output:
        """An output by the first clock."""
        if isinstance(output, ClockStepEvent):
            self._from_ns.append(output.at_ns)
            self._shifts_ns.append(self._shifts_ns[-1] + output.step_ns)
            self._latest_ns = max(self._latest_ns, output.at_ns)
            return replace(output, stamp_ns=output.at_ns)
        if isinstance(output, Estimate):
            given_ns = output.state.stamp_ns
            stamp_ns = self._stamp_ns(given_ns, self._last_ns.get(output.name))
            self._last_ns[output.name] = stamp_ns
            self._latest_ns = max(self._latest_ns, stamp_ns)
            return output if stamp_ns == given_ns else replace(output, state=replace(output.state, stamp_ns=stamp_ns))
        stamp_ns = self._stamp_ns(output.stamp_ns)
        return output if stamp_ns == output.stamp_ns else replace(output, stamp_ns=stamp_ns)

    def _stamp_ns(self, given_ns: int, after_ns: int | None = None) -> int:
        if not self._from_ns:
            return given_ns
        found = list(self._candidates(given_ns, after_ns))
        return min(found, key=lambda each: abs(each - self._latest_ns), default=given_ns - self._shifts_ns[-1])

    def _candidates(self, given_ns: int, after_ns: int | None) -> Iterator[int]:
        """What the stamp may be, the newest epoch first."""
        for epoch in reversed(range(len(self._shifts_ns))):
            stamp_ns = given_ns - self._shifts_ns[epoch]
            is_late_enough = epoch == 0 or stamp_ns >= self._from_ns[epoch - 1]
            is_early_enough = epoch == len(self._from_ns) or stamp_ns < self._from_ns[epoch]
            if is_late_enough and is_early_enough and (after_ns is None or stamp_ns > after_ns):
                yield stamp_ns

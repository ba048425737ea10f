# SPDX-License-Identifier: BSD-3-Clause
"""From the clock of the estimator, which never steps, to that of the samples, in which outputs are stamped."""

from bisect import bisect_right
from dataclasses import replace

from coclo_vio.values.outputs import Estimate, Output


class Epochs:
    """Spans of the estimator's clock, each with one offset of the samples' clock."""

    def __init__(self) -> None:
        self._from_ns: list[int] = []
        self._shifts_ns: list[int] = [0]

    def add(self, from_ns: int, step_ns: int) -> None:
        """The clock of the samples steps.

        Args:
            from_ns: from there on, by the clock of the estimator.
            step_ns: new clock less old one.
        """
        self._from_ns.append(from_ns)
        self._shifts_ns.append(self._shifts_ns[-1] + step_ns)

    def stamp_ns(self, inner_ns: int) -> int:
        """A stamp of the estimator by the clock of the samples."""
        return inner_ns + self._shifts_ns[bisect_right(self._from_ns, inner_ns)]

    def stamped(self, output: Output) -> Output:
        """An output with its stamp by the clock of the samples."""
        if not self._from_ns and not self._shifts_ns[0]:
            return output
        if isinstance(output, Estimate):
            state = replace(output.state, stamp_ns=self.stamp_ns(output.state.stamp_ns))
            return Estimate(output.name, state)
        return replace(output, stamp_ns=self.stamp_ns(output.stamp_ns))

# SPDX-License-Identifier: BSD-3-Clause
"""The stretch of time for which a simulated fault lasts."""

from dataclasses import dataclass
from typing import Self

from coclo_vio.values.units import NS_PER_S

_LONGEST_S = 1e9  # thirty years


@dataclass(frozen=True, slots=True)
class Span:
    """A stretch of time.

    Attributes:
        start_ns: its beginning, ns after the recording's first measurement.
        end_ns: its end, which is no longer in it.
    """

    start_ns: int
    end_ns: int

    @classmethod
    def parse(cls, text: str) -> Self:
        """The span of ``START:SECONDS``.

        Raises:
            ValueError: not two numbers, a start before the recording, or no time at all.
        """
        start, _, seconds = text.partition(":")
        try:
            start_s, duration_s = float(start), float(seconds)
        except ValueError as error:
            raise ValueError(f"{text!r} is no START:SECONDS, such as 20:5 for five seconds") from error
        if not (0.0 <= start_s <= _LONGEST_S and 0.0 < duration_s <= _LONGEST_S):
            raise ValueError(
                f"{text!r}: START must be at least 0 and SECONDS above 0, neither above {_LONGEST_S:.0e}, such as 20:5"
            )
        return cls(round(start_s * NS_PER_S), round((start_s + duration_s) * NS_PER_S))

    def __contains__(self, after_ns: int) -> bool:
        return self.start_ns <= after_ns < self.end_ns

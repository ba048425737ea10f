# SPDX-License-Identifier: BSD-3-Clause
"""Poses of a run whose clock was set back: stamps of one trajectory increase, so one stretch of them is read."""

from collections.abc import Sequence
from itertools import pairwise

from coclo_vio.values.units import NS_PER_S

_DIGITS = len(str(NS_PER_S)) - 1


def longest_stretch(lines: Sequence[str]) -> tuple[slice, str | None]:
    """The longest stretch of poses between two steps back of the clock, and a note on the others.

    Args:
        lines: of a TUM file as a run writes it, a pose each.

    Returns:
        Which lines; all of them, and None, where no stamp goes back or a line has none.
    """
    try:
        stamps_ns = [_stamp_ns(line) for line in lines]
    except ValueError:  # whoever reads the poses says which line it is
        return slice(None), None
    starts = [0, *(i for i in range(1, len(stamps_ns)) if stamps_ns[i] < stamps_ns[i - 1]), len(stamps_ns)]
    if len(starts) <= 2:
        return slice(None), None
    start, end = max(pairwise(starts), key=lambda ends: ends[1] - ends[0])
    return slice(start, end), (
        f"{len(lines) - (end - start)} of {len(lines)} estimates are left out: the clock of the sensors was set back, "
        f"and these are the {end - start} of the longest time between"
    )


def _stamp_ns(line: str) -> int:
    seconds, _, fraction = line.split(maxsplit=1)[0].partition(".") if line.strip() else ("", "", "")
    return int(seconds) * NS_PER_S + int(fraction.ljust(_DIGITS, "0")[:_DIGITS])

# SPDX-License-Identifier: BSD-3-Clause
"""Notes of several evaluations merged: sentences that differ in numbers only become one with a range."""

import re
from collections.abc import Mapping, Sequence

_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


def merged_notes(notes: Mapping[str, Sequence[str]]) -> list[str]:
    """Each sentence once, preceded by the names it applies to unless it applies to all.

    Args:
        notes: sentences by name of the trajectory.
    """
    numbers_by_text: dict[tuple[str, ...], dict[str, list[str]]] = {}
    for name, sentences in notes.items():
        for sentence in sentences:
            numbers_by_text.setdefault(tuple(_NUMBER.split(sentence)), {})[name] = _NUMBER.findall(sentence)
    lines = []
    for (first, *rest), numbers in numbers_by_text.items():
        ranges = (_range(column) for column in zip(*numbers.values(), strict=True))
        sentence = first + "".join(number + text for number, text in zip(ranges, rest, strict=True))
        lines.append(sentence if set(numbers) == set(notes) else f"{', '.join(numbers)}: {sentence}")
    return lines


def _range(values: Sequence[str]) -> str:
    low, high = min(values, key=float), max(values, key=float)
    return low if float(low) == float(high) else f"{low} to {high}"

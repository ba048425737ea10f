# SPDX-License-Identifier: BSD-3-Clause
"""Notes of several evaluations told once: what differs in numbers only becomes one sentence with a range."""

import re
from collections.abc import Mapping, Sequence

_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


def merged_notes(notes: Mapping[str, Sequence[str]]) -> list[str]:
    """Each sentence once, with the names in front that it is about, unless it is about all.

    Args:
        notes: sentences by name of the estimator.
    """
    told: dict[tuple[str, ...], dict[str, list[str]]] = {}
    for name, sentences in notes.items():
        for sentence in sentences:
            told.setdefault(tuple(_NUMBER.split(sentence)), {})[name] = _NUMBER.findall(sentence)
    lines = []
    for (first, *words), numbers in told.items():
        ranges = (_range(column) for column in zip(*numbers.values(), strict=True))
        sentence = first + "".join(one + word for one, word in zip(ranges, words, strict=True))
        lines.append(sentence if set(numbers) == set(notes) else f"{', '.join(numbers)}: {sentence}")
    return lines


def _range(values: Sequence[str]) -> str:
    low, high = min(values, key=float), max(values, key=float)
    return low if float(low) == float(high) else f"{low} to {high}"

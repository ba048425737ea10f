# SPDX-License-Identifier: BSD-3-Clause
"""What a command answers."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Answer:
    """Exit status, and what went to standard output and standard error."""

    status: int
    out: str
    err: str


Coclo = Callable[..., Answer]


def is_one_sentence(answer: Answer) -> bool:
    """Whether all that was said is one line, and no traceback."""
    return answer.err.startswith("coclo-vio: ") and answer.err.count("\n") == 1 and "Traceback" not in answer.err

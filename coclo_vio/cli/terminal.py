# SPDX-License-Identifier: BSD-3-Clause
"""What goes where: results on standard output, messages about them on standard error."""

import json
import sys
from collections.abc import Mapping
from typing import Any

from rich.console import Console

out = Console()
err = Console(stderr=True)


def say(sentence: str) -> None:
    """A line for a person, neither coloured nor folded."""
    err.print(sentence, soft_wrap=True, highlight=False, markup=False)


def give(sentence: str) -> None:
    """A line of the result, not folded, so that a path in it can be copied."""
    out.print(sentence, soft_wrap=True, markup=False)


def give_json(values: Mapping[str, Any]) -> None:
    """One JSON object, never coloured or folded."""
    sys.stdout.write(json.dumps(values, indent=2, allow_nan=False) + "\n")
